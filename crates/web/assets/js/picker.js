// Which encoder is looked at, and whether one or all are.

import { h, setText } from "./dom.js";
import { on as listen, select, store } from "./store.js";

/** Fills the place. Gives a function that shows a view: `encoder` or `segment`. */
export function makePicker(place) {
  const views = [["encoder", "Encoder"], ["segment", "All"]].map(([view, text]) =>
    h("button", { type: "button", "data-view": view, "aria-pressed": "false", onclick: () => show(view) }, text));
  const list = h("select", { id: "encoder", "aria-label": "Encoder", onchange: () => { select(list.value); show("encoder"); } });
  const alone = h("span", { class: "alone" });
  place.append(list, alone, h("div", { class: "segmented", role: "group", "aria-label": "View" }, views));

  function show(view) {
    document.body.dataset.view = view;
    for (const each of views) each.setAttribute("aria-pressed", String(each.dataset.view === view));
  }

  listen("plant", () => {
    list.replaceChildren(...[...store.encoders.keys()].map((name) => h("option", { value: name }, name)));
    list.value = store.selected;
    list.hidden = store.encoders.size < 2;
    alone.hidden = !list.hidden;
    setText(alone, store.selected ?? "");
  });
  listen("selected", (name) => { list.value = name; });
  show("encoder");
  return show;
}
