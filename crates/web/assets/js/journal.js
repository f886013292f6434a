// What happened, newest first; refusals with their reasons.

import { choice, h } from "./dom.js";
import { badge } from "./desk.js";
import { fixed } from "./format.js";
import { on as listen, store } from "./store.js";

const REFUSALS = new Set(["parameters_refused", "configuration_refused", "address_refused", "preset_refused", "refused"]);
const LEVEL = {
  alarm_raised: "alarm", position_error: "alarm", segment_broke: "alarm", power_off: "warning", warning_raised: "warning", master_left: "warning",
  waiting_for_parameters: "warning", left_bus: "warning", termination: "warning", too_fast: "warning", preset_bit_held: "warning", jump_at_overflow: "warning",
  data_exchange_entered: "fine", alarm_cleared: "fine", warning_cleared: "fine", preset_taken: "fine", power_on: "fine",
};
const SHOWN = 200;

export const isRefusal = (event) => REFUSALS.has(event.kind);

/** Fills the panel. */
export function makeJournal(panel) {
  const list = h("ol", { class: "journal", id: "journal" });
  let seen = -1;
  let refusals = 0;
  const kind = choice("Show", [["all", "all events"], ["refusals", "refusals"], ["mine", "of this encoder"]], () => { seen = -1; fill(); });
  panel.append(h("div", { class: "bar" }, kind.element), h("div", { class: "journal-scroll", tabindex: 0, role: "region", "aria-label": "Events" }, list));
  listen("event", (event) => {
    if (isRefusal(event) && panel.hidden) badge("journal", ++refusals);
  });

  function wanted(event) {
    if (kind.select.value === "refusals") return isRefusal(event);
    return kind.select.value === "all" || event.who === store.selected;
  }

  function fill() {
    refusals = 0;
    badge("journal", 0);
    if (seen === store.eventCount) return;
    const fresh = seen < 0 ? store.events : store.events.slice(-(store.eventCount - seen));
    if (seen < 0) list.replaceChildren();
    seen = store.eventCount;
    list.prepend(...fresh.filter(wanted).slice(-SHOWN).reverse().map(line));
    while (list.children.length > SHOWN) list.lastChild.remove();
    list.classList.toggle("nothing", list.children.length === 0);
  }
  return fill;
}

function line(event) {
  const level = isRefusal(event) ? "refused" : LEVEL[event.kind] ?? "note";
  return h("li", { class: level },
    h("span", { class: "t-at" }, event.at_ns === undefined ? "" : fixed(event.at_ns / 1e9, 3)), h("span", { class: "who" }, event.who ?? ""), h("span", { class: "t-what" }, event.text));
}
