// Light and dark: as the system says, or as chosen.

import { h } from "./dom.js";

const listeners = [];
const probe = h("i", { hidden: true });

/** Calls `f` when colours change. */
export function onTheme(f) {
  listeners.push(f);
}

/** A colour of the style sheet, as a canvas takes it. */
export function colour(name) {
  if (!probe.isConnected) document.body.append(probe);
  probe.style.color = `var(${name})`;
  return getComputedStyle(probe).color;
}

/** The switch: system, light, dark. */
export function makeTheme(place) {
  const root = document.documentElement;
  const names = [["", "Auto"], ["light", "Light"], ["dark", "Dark"]];
  const show = () => {
    for (const each of place.firstChild.children) each.setAttribute("aria-pressed", String(each.value === (root.dataset.theme ?? "")));
  };
  place.append(h("div", { class: "segmented", role: "group", "aria-label": "Colours" }, names.map(([value, text]) =>
    h("button", { type: "button", value, onclick: () => {
      if (value) root.dataset.theme = value;
      else delete root.dataset.theme;
      try {
        if (value) localStorage.setItem("theme", value);
        else localStorage.removeItem("theme");
      } catch { /* storage may be forbidden: the choice then lasts as long as the page */ }
      show();
      listeners.forEach((f) => f());
    } }, text))));
  show();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => listeners.forEach((f) => f()));
}
