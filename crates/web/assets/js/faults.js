// What can be made to go wrong, by whom it befalls. What is wrong now is listed first, each with its end.

import { command } from "./api.js";
import { button, h, numberField } from "./dom.js";
import { badge } from "./desk.js";
import { attempt } from "./notes.js";
import { encoder, segmentOf } from "./store.js";

const forEncoder = (request) => () => attempt(() => command({ encoder: encoder()?.name, ...request }), "Done.");
const forSegment = (request) => () => {
  const segment = segmentOf(encoder())?.name;
  return attempt(() => command({ ...(segment ? { segment } : {}), ...request }), "Done.");
};

/** What is wrong now: [text, how to end it]. */
function active(on, segment) {
  const { injected } = on;
  const noise = segment?.line;
  return [
    [injected.sensor_fault, "The sensor reports a fault", forEncoder({ do: "sensor", fault: "off" })],
    [injected.turns_lost_at_power_on, "The next power-on finds the turn count lost", forEncoder({ do: "sensor", fault: "off" })],
    [injected.writes_fail, "Writes to the memory fail", forEncoder({ do: "memory", fault: "off" })],
    [injected.torn_write, "The power goes during the next write", forEncoder({ do: "memory", fault: "off" })],
    [injected.memory_lost_at_power_on, "The next power-on finds the memory lost", forEncoder({ do: "memory", fault: "off" })],
    [injected.off_the_bus, "It is off the bus", forEncoder({ do: "join" })],
    [segment?.cable.cut_after !== null && segment?.cable.cut_after !== undefined, `The cable is cut after ${segment?.cable.cut_after} devices`, forSegment({ do: "mend" })],
    [noise, "The line is noisy", forSegment({ do: "line" })],
    [segment?.cable.reflections, "Wrong termination reflects", forSegment({ do: "reflections", on: false })],
    [on.light === "low", "The reserve of the LED's light is used up", forEncoder({ do: "light", state: "ok" })],
    [on.battery !== "ok", `The battery is ${on.battery}`, forEncoder({ do: "battery", state: "ok" })],
    [on.celsius > 65 || on.celsius < -40, `${Math.round(on.celsius)} degrees inside`, forEncoder({ do: "temperature", celsius: 20 })],
    [on.volts < 9 || on.volts > 30, `The supply is at ${on.volts} V`, forEncoder({ do: "supply", volts: 24 })],
  ].filter(([is]) => is);
}

/** Fills the panel. */
export function makeFaults(panel) {
  const list = h("ul", { class: "active-faults", id: "active-faults" });
  panel.append(h("div", { class: "faults-now" }, h("h3", {}, "Wrong now"), list), h("div", { class: "fault-groups" }, groups()));
  let shown = "";
  return () => {
    const on = encoder();
    if (!on) return;
    const now = active(on, segmentOf(on));
    badge("faults", now.length);
    const key = now.map(([, text]) => text).join();
    if (key === shown) return;
    shown = key;
    list.replaceChildren(...now.map(([, text, end]) => h("li", {}, h("span", {}, text), button("End it", end, { class: "small" }))));
  };
}

function group(title, ...content) {
  return h("fieldset", { class: "fault-group" }, h("legend", {}, title), content);
}

const row = (...content) => h("div", { class: "fault-row" }, content);
const fault = (text, request, properties) => button(text, forEncoder(request), properties);

function groups() {
  return [
    group("Sensor",
      row(fault("Fault once", { do: "sensor", fault: "once" }, { id: "fault-sensor-once" }), fault("Fault held", { do: "sensor", fault: "held" })),
      row(fault("Position error", { do: "sensor", fault: "position_error" }), fault("Lose turns", { do: "sensor", fault: "turns_lost" })),
      row(fault("LED weak", { do: "light", state: "low" }, { id: "fault-light" }), fault("Battery low", { do: "battery", state: "low" }), fault("Battery empty", { do: "battery", state: "empty" }))),
    group("Memory",
      row(fault("Writes fail", { do: "memory", fault: "writes_fail" }), fault("Torn write", { do: "memory", fault: "torn_write" })),
      row(fault("Damage A", { do: "memory", fault: "damage_a" }), fault("Damage B", { do: "memory", fault: "damage_b" })),
      row(fault("Lost at power-on", { do: "memory", fault: "lost_at_power_on" }))),
    group("Supply and heat", brownOut(), heat()),
    group("Line by chance", ...noise()),
    group("Line by request", ...requested()),
    group("Cable and bus", ...cable()),
  ];
}

function brownOut() {
  const volts = numberField("Drop to", 8, "V", { min: -100, max: 100 });
  const seconds = numberField("for", 0.5, "s", { min: 0 });
  return row(volts.element, seconds.element, button("Brown-out", () => forEncoder({ do: "brown_out", volts: volts.value, for_s: seconds.value })()));
}

function heat() {
  const celsius = numberField("Inside", 70, "°C", { min: -300, max: 300 });
  return row(celsius.element, button("Heat", () => forEncoder({ do: "temperature", celsius: celsius.value })(), { id: "fault-heat" }));
}

function noise() {
  const fields = [["bit_errors", "Bit errors", 0.0001], ["lost_requests", "Lost requests", 0], ["lost_replies", "Lost replies", 0.01], ["late_replies", "Late replies", 0]]
    .map(([name, label, value]) => ({ name, field: numberField(label, value, "", { min: 0, max: 1 }) }));
  return [
    h("div", { class: "fault-grid" }, fields.map(({ field }) => field.element)),
    row(button("Make noise", () => {
      const request = { do: "line", seed: 7, late_by_us: 500 };
      for (const { name, field } of fields) if (field.value > 0) request[name] = field.value;
      forSegment(request)();
    }, { id: "fault-noise" }), button("Quiet", forSegment({ do: "line" }))),
  ];
}

function requested() {
  const count = numberField("How many", 1, "", { min: 1, max: 1000, step: 1 });
  const delay = numberField("Delay", 500, "µs", { min: 1 });
  const counted = (what) => () => forSegment({ do: what, count: count.value })();
  return [
    row(count.element, delay.element),
    row(button("Lose requests", counted("lose_requests")), button("Lose replies", counted("lose_replies"))),
    row(button("Double requests", counted("double_requests")), button("Double replies", counted("double_replies"))),
    row(button("Delay replies", () => forSegment({ do: "delay_replies", by_us: delay.value, count: count.value })()),
      button("Damage reply", forSegment({ do: "damage_reply", octet: 8, mask: "01" }))),
  ];
}

function cable() {
  const after = numberField("After", 1, "devices", { min: 1, step: 1 });
  return [
    row(after.element, button("Cut cable", () => forSegment({ do: "cut", after: after.value })(), { id: "fault-cut" }), button("Mend", forSegment({ do: "mend" }))),
    row(fault("Leave the bus", { do: "leave" }), fault("Join it", { do: "join" })),
    row(button("Reflections on", forSegment({ do: "reflections", on: true })), button("off", forSegment({ do: "reflections", on: false }))),
  ];
}
