// The shaft's card: the dial, where it is, and what drives it.

import { command } from "./api.js";
import { button, choice, h, heading, numberField, setText } from "./dom.js";
import { countsPerTurn, makeDial } from "./dial.js";
import { fixed, whole } from "./format.js";
import { attempt } from "./notes.js";
import { part } from "./frames.js";
import { encoder, on as listen } from "./store.js";

/** The movements of the choice: fields with their values in turns, and the unit that goes with each. */
const MOVES = {
  constant: { text: "Constant", fields: [["rpm", "Speed", 60, "RPM"]] },
  ramp: { text: "Ramp", fields: [["to_rpm", "To", 120, "RPM"], ["over_s", "Over", 5, "s"]] },
  sine: { text: "Sine", fields: [["amplitude", "Amplitude", 2, "U"], ["period_s", "Period", 8, "s"]] },
  hoist: { text: "Hoist", fields: [["by", "Travel", 6, "U"], ["speed", "Speed", 1.5, "U/s"], ["acceleration", "Accel.", 1, "U/s²"], ["pause_s", "Pause", 1, "s"]] },
};

/** Fills the card. */
export function makeShaft(card) {
  const dial = makeDial();
  const readouts = makeReadouts();
  const drive = makeDrive();
  card.append(
    heading("shaft-title", "Shaft", h("span", { class: "subtle move", id: "shaft-words" })),
    h("div", { class: "shaft-body" },
      h("div", { class: "dial-place" }, dial.element), readouts.element),
    h("p", { id: "dial-help", class: "sr" }, "Drag, or arrow keys: a 64th of a turn, with Shift one count; Page keys: one turn; Home: zero."),
    drive.element);
  const words = card.querySelector("#shaft-words");
  part({ frame: dial.frame });
  return () => {
    const on = encoder();
    if (!on) return;
    dial.update();
    readouts.update(on);
    drive.update(on);
    setText(words, on.shaft.length > 44 ? `${on.shaft.slice(0, 43)}…` : on.shaft);
  };
}

function makeReadouts() {
  const rows = Object.fromEntries([["machine", "Machine"], ["turns", "Turns"], ["angle", "Angle"], ["raw", "Counts"], ["rpm", "Speed"]]
    .map(([name, text]) => [name, { label: h("dt", {}, text), value: h("dd", { id: `shaft-${name}` }) }]));
  const { machine } = rows;
  return {
    element: h("dl", { class: "readouts" }, Object.values(rows).flatMap(({ label, value }) => [label, value])),
    update(on) {
      const perTurn = countsPerTurn(on);
      setText(machine.value, on.machine ? `${fixed(on.machine.position, 3)} ${on.machine.unit}` : "not told");
      setText(rows.turns.value, fixed(on.shaft_position / perTurn, 3));
      setText(rows.angle.value, `${fixed((((on.shaft_position % perTurn) + perTurn) % perTurn) / perTurn * 360, 2)}°`);
      setText(rows.raw.value, whole(on.shaft_position));
      setText(rows.rpm.value, `${fixed(on.rpm, 1)} RPM`);
    },
  };
}

function makeDrive() {
  const place = h("div", { class: "drive-fields" });
  const kind = choice("Movement", Object.entries(MOVES).map(([value, { text }]) => [value, text]), () => build());
  let inputs = [];
  let unit = null;
  const build = () => {
    inputs = MOVES[kind.select.value].fields.map(([name, label, value, of]) =>
      ({ name, field: numberField(label, value, of.replace("U", unit?.name ?? "turns")) }));
    place.replaceChildren(...inputs.map(({ field }) => field.element));
  };
  const run = () => {
    const shaft = { kind: kind.select.value };
    for (const { name, field } of inputs) shaft[name] = field.value;
    if (unit && ["sine", "hoist"].includes(shaft.kind)) Object.assign(shaft, { unit: unit.name, per_turn: unit.perTurn });
    attempt(() => command({ do: "shaft", encoder: encoder()?.name, shaft }));
  };
  const stop = () => attempt(() => command({ do: "shaft", encoder: encoder()?.name, shaft: { kind: "still" } }));
  const speed = makeSpeed();
  build();
  listen("selected", () => { unit = null; build(); });
  return {
    element: h("div", { class: "drive" }, speed.element,
      h("form", { class: "drive-form", onsubmit: (event) => { event.preventDefault(); run(); } },
        kind.element, place, h("button", { type: "submit", class: "primary", id: "drive-start" }, "Start"),
        button("Stop", stop, { id: "drive-stop" }))),
    update(on) {
      const known = on.machine?.per_turn ? { name: on.machine.unit, perTurn: on.machine.per_turn } : null;
      if (known?.name !== unit?.name || known?.perTurn !== unit?.perTurn) {
        unit = known;
        build();
      }
      speed.update(on);
    },
  };
}

/** The speed slider: fine in the middle, up to 3000 RPM at its ends (manual 6). */
function makeSpeed() {
  const toRpm = (at) => Math.sign(at) * Math.round((Math.abs(at) / 100) ** 2.5 * 3000);
  const toPlace = (rpm) => Math.sign(rpm) * Math.min(1, Math.abs(rpm) / 3000) ** 0.4 * 100;
  const slider = h("input", { type: "range", min: -100, max: 100, step: 1, value: 0, id: "speed", "aria-label": "Speed of the shaft" });
  const word = h("output", { class: "speed-word", for: "speed" }, "0 RPM");
  let waiting = null;
  let busy = false;
  let heldUntil = 0;
  slider.addEventListener("input", async () => {
    heldUntil = performance.now() + 800;
    // Around the middle it rests at 0, so that the shaft can be stopped by hand.
    waiting = Math.abs(slider.valueAsNumber) < 4 ? 0 : toRpm(slider.valueAsNumber);
    say(waiting);
    if (busy) return;
    busy = true;
    while (waiting !== null) {
      const rpm = waiting;
      waiting = null;
      await attempt(() => command({ do: "shaft", encoder: encoder()?.name, shaft: rpm === 0 ? { kind: "still" } : { kind: "constant", rpm } }));
    }
    busy = false;
  });
  const say = (rpm) => {
    setText(word, `${fixed(rpm, 0)} RPM`);
    slider.setAttribute("aria-valuetext", `${Math.round(rpm)} RPM`);
  };
  return {
    element: h("div", { class: "speed" }, h("span", { class: "speed-end", "aria-hidden": "true" }, "⟲"), slider, h("span", { class: "speed-end", "aria-hidden": "true" }, "⟳"), word),
    update(on) {
      if (busy || performance.now() < heldUntil) return;
      const at = Math.round(toPlace(on.rpm));
      if (slider.valueAsNumber !== at) slider.value = at;
      say(on.rpm);
    },
  };
}
