// The lower part: one panel at a time, chosen by tabs.

import { h } from "./dom.js";

/** Fills the card with tabs. `panels` are [id, text, make] with `make(panel)` giving an optional update function. */
export function makeDesk(card, panels) {
  const tabs = panels.map(([id, text], i) => h("button", {
    type: "button", role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}`, "aria-selected": String(i === 0), tabindex: i === 0 ? 0 : -1,
    onclick: () => choose(i),
  }, text, h("span", { class: "badge", id: `badge-${id}`, hidden: true })));
  const places = panels.map(([id], i) => h("div", { role: "tabpanel", id: `panel-${id}`, "aria-labelledby": `tab-${id}`, class: `panel panel-${id}`, hidden: i !== 0 }));
  card.append(h("div", { role: "tablist", class: "tabs", "aria-label": "Panels", onkeydown: keys }, tabs), ...places);
  const updates = panels.map(([, , make], i) => make(places[i]));
  let chosen = 0;

  function choose(i) {
    chosen = i;
    tabs.forEach((tab, j) => {
      tab.setAttribute("aria-selected", String(i === j));
      tab.tabIndex = i === j ? 0 : -1;
      places[j].hidden = i !== j;
    });
    updates[i]?.();
  }

  function keys(event) {
    const next = { ArrowRight: chosen + 1, ArrowLeft: chosen - 1, Home: 0, End: tabs.length - 1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    choose((next + tabs.length) % tabs.length);
    tabs[chosen].focus();
  }
  return () => updates[chosen]?.();
}

/** Shows a count on a tab; 0 hides it. */
export function badge(id, count) {
  const element = document.getElementById(`badge-${id}`);
  if (!element || element.count === count) return;
  element.count = count;
  element.hidden = count === 0;
  element.textContent = count > 99 ? "99+" : String(count);
}
