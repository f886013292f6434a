// The end cap as one finds it after pulling it out: rotary switches, termination, terminals (manual 2, 3.3, 3.4),
// and beside it what supplies it.

import { command } from "./api.js";
import { button, h, heading, s, setAttribute, setClass, setText } from "./dom.js";
import { fixed, hex2 } from "./format.js";
import { attempt } from "./notes.js";
import { rotarySwitch } from "./rotary.js";
import { encoder, segmentOf, store } from "./store.js";

const TERMINALS = ["VSUP", "GND", "A", "B", "SHD"];
const BLOCKS = [36, 180]; // where the terminal blocks begin
const PITCH = 25.5;
const pin = (x, i) => x + 15 + i * PITCH;

/** What the switches mean at the next power-on; `null` is off the bus (manual 3.4). */
export function addressOf(switches, stored) {
  if (switches >= 1 && switches <= 125) return switches;
  return switches === 126 ? stored ?? 126 : null;
}

const inWords = (address) => (address === null ? "off the bus" : `address ${address}`);

function turned(x16, x1) {
  const on = encoder();
  if (on) attempt(() => command({ do: "switches", encoder: on.name, switches: hex2(16 * x16 + x1) }));
}

/** Fills the card. Gives the function that shows the newest snapshot. */
export function makeCap(card) {
  const x16 = rotarySwitch("X16", 84, 78, (value) => turned(value, x1.value));
  const x1 = rotarySwitch("X1", 186, 78, (value) => turned(x16.value, value));
  const first = slideSwitch("S1", 262, 50, () => terminate("terminated_first"));
  const second = slideSwitch("S2", 296, 50, () => terminate("terminated_second"));
  const led = s("circle", { cx: 250, cy: 136, r: 5, class: "led" });
  const volts = s("text", { x: 262, y: 140.5, class: "cap-volts" });
  const wires = s("g", { class: "wires" });
  const drawing = s("svg", { viewBox: "0 0 348 238", class: "cap-drawing", role: "group", "aria-label": "End cap" },
    s("rect", { x: 10, y: 1, width: 328, height: 222, rx: 34, class: "cap-body" }),
    s("rect", { x: 22, y: 11, width: 304, height: 202, rx: 24, class: "cap-board" }),
    [[24, 15], [324, 15], [24, 209], [324, 209]].map(([x, y]) => screw(x, y)),
    s("text", { x: 135, y: 27, class: "cap-label", "text-anchor": "middle" }, "ADDRESS, HEX"),
    s("text", { x: 279, y: 27, class: "cap-label", "text-anchor": "middle" }, "TERMINATION"),
    x16.element, x1.element, first.element, second.element, led,
    wires, block("BUS IN", BLOCKS[0]), block("BUS OUT", BLOCKS[1]), volts);
  const note = h("p", { class: "cap-note", id: "cap-note" });
  const cycle = button("Power off and on", () => power("cycle"), { class: "small", id: "power-cycle" });
  const terminated = h("p", { class: "cap-note", id: "cap-termination" });
  const supply = makeSupply();
  card.append(
    heading("cap-title", "End cap", h("span", { class: "subtle", id: "cap-ident" })),
    drawing,
    h("div", { class: "cap-words" }, h("div", { class: "cap-line" }, note, cycle), terminated),
    supply.element);
  const ident = card.querySelector("#cap-ident");
  return () => {
    const on = encoder();
    if (!on) return;
    const switches = parseInt(on.switches, 16);
    x16.show(switches >> 4);
    x1.show(switches & 15);
    first.show(on.cap?.terminated_first ?? false);
    second.show(on.cap?.terminated_second ?? false);
    setText(ident, `${on.bits} bits · No. ${on.serial_number}`);
    showAddress(on, switches, note, cycle);
    showTermination(on, terminated);
    showSupply(on, led, volts, wires);
    supply.update(on);
  };
}

function showAddress(on, switches, note, cycle) {
  const next = addressOf(switches, on.device?.stored_address ?? null);
  const effective = on.device?.address ?? null;
  const pending = on.device !== null && next !== effective;
  setClass(note, "pending", pending);
  setText(note, !on.device ? `Switches ${on.switches}h: ${inWords(next)} at power-on`
    : pending ? `Turned to ${on.switches}h (${inWords(next)}): counts at the next power-on. Now ${inWords(effective)}`
    : `Switches ${on.switches}h: ${inWords(effective)}${switches === 126 && effective !== 126 ? ", set over the bus" : ""}`);
  setAttribute(cycle, "hidden", !pending);
}

function showTermination(on, place) {
  const { terminated_first: a, terminated_second: b } = on.cap ?? {};
  const here = segmentOf(on)?.termination?.find((text) => text.includes(on.name));
  const wrong = here ?? (a !== b ? "One termination switch alone is wrong at any place: both on, or both off" : null);
  setClass(place, "pending", wrong !== null);
  setText(place, wrong ?? (a ? "Terminated: an end of the cable" : "Not terminated: not an end of the cable"));
}

function showSupply(on, led, volts, wires) {
  const reversed = on.volts < 0 && !on.injected.switched_off;
  const lit = on.device !== null;
  const alarm = on.device?.alarms.includes("supply_voltage");
  setAttribute(led, "class", `led ${lit ? (alarm ? "alarm" : "on") : ""}`);
  setText(volts, on.injected.switched_off ? "switched off" : reversed ? `${fixed(on.volts, 1)} V reversed` : `${fixed(on.volts, 1)} V`);
  setAttribute(volts, "class", `cap-volts ${alarm || reversed ? "bad" : ""}`);
  if (wires.reversed === reversed) return;
  wires.reversed = reversed;
  const colours = reversed ? ["minus", "plus", "a", "b", "shield"] : ["plus", "minus", "a", "b", "shield"];
  wires.replaceChildren(...BLOCKS.flatMap((x) => colours.map((colour, i) =>
    s("path", { d: `M${pin(x, i)} 186v50`, class: `wire ${colour}` }))));
}

function terminate(which) {
  const on = encoder();
  if (!on) return;
  const cap = { ...on.cap, [which]: !on.cap[which] };
  attempt(() => command({ do: "termination", encoder: on.name, first: cap.terminated_first, second: cap.terminated_second }));
}

function power(state) {
  const on = encoder();
  if (on) attempt(() => command({ do: "power", encoder: on.name, state }));
}

function screw(x, y) {
  return s("g", { class: "screw" }, s("circle", { cx: x, cy: y, r: 5 }), s("path", { d: `M${x - 3} ${y - 3}l6 6` }));
}

function block(name, x) {
  return s("g", { class: "block" },
    s("text", { x: x + 1, y: 150, class: "cap-label" }, name),
    s("rect", { x, y: 154, width: 132, height: 40, rx: 3 }),
    TERMINALS.map((terminal, i) => [
      s("circle", { cx: pin(x, i), cy: 182, r: 6, class: "terminal" }),
      s("path", { d: `M${pin(x, i) - 4} 182h8`, class: "terminal-slot" }),
      s("text", { x: pin(x, i), y: 168, class: "terminal-name", "text-anchor": "middle" }, terminal)]).flat(),
    s("title", {}, `${name}: ${TERMINALS.join(", ")}`));
}

function slideSwitch(name, x, y, onturn) {
  const knob = s("rect", { x: x - 7, y: y + 24, width: 14, height: 16, rx: 2, class: "slide-knob" });
  const element = s("g", {
    class: "slide", role: "switch", tabindex: 0, "aria-label": `Termination switch ${name}`, "aria-checked": "false",
    onclick: onturn,
    onkeydown: (event) => {
      if (event.key === " " || event.key === "Enter") {
        event.preventDefault();
        onturn();
      }
    },
  },
  s("rect", { x: x - 12, y: y - 20, width: 24, height: 78, rx: 4, class: "hit" }),
  s("rect", { x: x - 9, y: y - 2, width: 18, height: 44, rx: 3, class: "slide-slot" }), knob,
  s("text", { x, y: y - 8, class: "slide-name", "text-anchor": "middle" }, "ON"),
  s("text", { x, y: y + 54, class: "slide-name", "text-anchor": "middle" }, name));
  return {
    element,
    show(isOn) {
      setAttribute(element, "aria-checked", String(isOn));
      setAttribute(knob, "transform", isOn ? "translate(0 -24)" : null);
    },
  };
}

/** Power switch and voltage. */
function makeSupply() {
  const toggle = h("button", { type: "button", role: "switch", class: "power", id: "power", "aria-checked": "true",
    onclick: () => power(encoder()?.injected.switched_off ? "on" : "off") }, h("span", { class: "power-mark" }), h("span", { class: "power-word" }, "Power"));
  const slider = h("input", { type: "range", min: -30, max: 36, step: 0.5, id: "volts", "aria-label": "Supply voltage" });
  const number = h("input", { type: "number", min: -100, max: 100, step: 0.5, id: "volts-number", "aria-label": "Supply voltage in volts" });
  let waiting = null;
  let busy = false;
  const send = async (volts) => {
    waiting = volts;
    if (busy) return;
    busy = true;
    while (waiting !== null) {
      const next = waiting;
      waiting = null;
      await attempt(() => command({ do: "supply", encoder: encoder()?.name, volts: next }));
    }
    busy = false;
  };
  slider.addEventListener("input", () => {
    number.value = slider.value;
    send(slider.valueAsNumber);
  });
  number.addEventListener("change", () => Number.isFinite(number.valueAsNumber) && send(number.valueAsNumber));
  const scale = h("span", { class: "volt-scale", "aria-hidden": "true" }, h("i", { class: "allowed" }));
  return {
    element: h("div", { class: "supply" }, toggle, h("span", { class: "volt-slider" }, slider, scale), h("span", { class: "with-unit" }, number, h("span", { class: "unit" }, "V"))),
    update(on) {
      setAttribute(toggle, "aria-checked", String(!on.injected.switched_off));
      if (busy || store.connection !== "live") return;
      if (document.activeElement !== number && number.valueAsNumber !== on.volts) number.value = on.volts;
      if (slider.valueAsNumber !== on.volts) slider.value = on.volts;
    },
  };
}
