// What the encoder says of itself: sentences, alarms first, beside the octets that say so.

import { h, heading, setAttribute, setText } from "./dom.js";
import { FUNCTIONALITIES, STATES, whole } from "./format.js";
import { makeOctets } from "./octets.js";
import { encoder } from "./store.js";

const ORDER = { alarm: 0, warning: 1, note: 2, fine: 3 };
const WORD = { alarm: "Alarm", warning: "Warning", note: "Note", fine: "Fine" };

/** Fills the card. */
export function makeDiagnosis(card) {
  const state = h("span", { class: "pill", id: "dp-state" });
  const octets = makeOctets("Octets of the diagnosis");
  const facts = h("p", { class: "facts" });
  const words = h("ul", { class: "words", id: "words" });
  const around = h("ul", { class: "reasons" });
  card.append(heading("diagnosis-title", "Diagnosis", state), facts, h("div", { class: "words-scroll", tabindex: 0, role: "region", "aria-label": "Diagnosis in words" }, words, around),
    h("div", { class: "octet-place" }, h("h3", {}, "As octets"), octets.element));
  let shown = null;
  let shownReasons = null;
  return () => {
    const on = encoder();
    if (!on) return;
    showState(on, state, facts);
    const diagnosis = on.device?.diagnosis;
    octets.show(diagnosis?.octets ?? "");
    const key = JSON.stringify(diagnosis?.words ?? null);
    if (key !== shown) {
      shown = key;
      octets.unlink();
      words.replaceChildren(...sentences(diagnosis?.words, on, octets));
    }
    const reasons = JSON.stringify(on.reasons);
    if (reasons !== shownReasons) {
      shownReasons = reasons;
      around.replaceChildren(...on.reasons.map(({ text }) => h("li", {}, text)));
    }
  };
}

function showState(on, state, facts) {
  const name = on.device?.state ?? "off";
  setText(state, STATES[name] ?? name);
  setAttribute(state, "class", `pill ${{ data_exchange: "good", off: "off" }[name] ?? "waiting"}`);
  const { device } = on;
  setText(facts, !device ? "Without power nobody answers."
    : device.state === "data_exchange"
      ? `Master ${device.master} · ${FUNCTIONALITIES[device.functionality] ?? ""} · ${whole(device.measuring_units_per_revolution)} units/rev. of ${whole(device.total_measuring_range)}`
      : `${device.address === null ? "Off the bus" : `Address ${device.address}`} · no master owns it · offset ${whole(device.offset)}`);
}

const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1)}.`;

function sentences(list, on, octets) {
  if (!list) return [h("li", { class: "none" }, on.device ? "No diagnosis yet." : "The encoder is off: there is no diagnosis.")];
  // What the device reports (octet 7 and up) comes before the bits of the station that go with it.
  const rank = ({ level, octets: range }) => 2 * ORDER[level] + (range && range[0] < 7 ? 1 : 0);
  const sorted = [...list].sort((a, b) => rank(a) - rank(b));
  return sorted.map(({ octets: range, level, text, advice }) => {
    const item = h("li", { class: level, tabindex: 0 },
      h("span", { class: "level" }, WORD[level] ?? level),
      h("div", {}, h("p", { class: "what" }, sentence(text)), advice ? h("p", { class: "advice" }, sentence(advice)) : null),
      range ? h("span", { class: "where" }, range[0] === range[1] ? `${range[0]}` : `${range[0]}–${range[1]}`) : null);
    if (range) octets.link(range[0], range[1], item);
    return item;
  });
}
