// What the built-in master does for the person at the desk: preset, parameters, address, Sync and Freeze.

import { master } from "./api.js";
import { button, choice, h, numberField, setText } from "./dom.js";
import { attempt } from "./notes.js";
import { whole } from "./format.js";
import { encoder, on as listen, store } from "./store.js";

/** Fills the panel. */
export function makeMaster(panel) {
  const foreign = h("div", { class: "foreign", hidden: true },
    h("h3", {}, "The master is yours"),
    h("p", {}, "This bus has a master of its own, which owns the encoders: presets and parameters are its business, and a second master would only disturb. Set them in its project, and watch here what arrives."),
    h("p", {}, "To try them from this page, start one with a built-in master: ", h("code", {}, "sch108bex demo --http")));
  const own = h("div", { class: "master-groups" }, preset(), parameters(), address(), together());
  panel.append(foreign, own);
  return () => {
    const theirs = store.stage?.master === "foreign";
    foreign.hidden = !theirs;
    own.hidden = theirs;
    updates.forEach((f) => f());
  };
}

const updates = [];
const name = () => encoder()?.name;

function preset() {
  const value = numberField("New position", 1000, "units", { min: 0, max: 2147483647, step: 1 });
  const result = h("output", { class: "result", id: "preset-result" });
  const send = async () => {
    const on = encoder();
    const before = on?.device?.position;
    if (!(await attempt(() => master({ do: "preset", encoder: name(), value: value.value })))) return;
    // The encoder says itself what it took, as an event; this is what stood before.
    setText(result, `Asked for ${whole(value.value)}; it was at ${whole(before)}.`);
  };
  listen("event", (event) => {
    if (event.who !== name()) return;
    if (event.kind === "preset_taken") setText(result, `${whole(event.from)} became ${whole(event.to)}. Offset ${whole(event.offset)}.`);
    if (event.kind === "preset_refused") setText(result, event.text);
  });
  updates.push(() => {
    const device = encoder()?.device;
    setText(now, device ? `${whole(device.position)} now, offset ${whole(device.offset)}` : "no power");
  });
  const now = h("p", { class: "subtle" });
  return h("form", { class: "fault-group", onsubmit: (event) => { event.preventDefault(); send(); } }, h("h3", {}, "Preset"), now,
    h("div", { class: "fault-row" }, value.element, h("button", { type: "submit", class: "primary", id: "preset" }, "Preset")), result);
}

function parameters() {
  const functionality = choice("Functionality", [["scancon_2", "Scancon 2.0"], ["class_2", "Class 2"], ["class_1", "Class 1"]], () => fit());
  const sequence = choice("Counts up", [["clockwise", "clockwise"], ["counter_clockwise", "counter-clockwise"]]);
  const base = choice("Time base", [["10_ms", "10 ms"], ["100_ms", "100 ms"], ["1000_ms", "1000 ms"], ["rpm", "RPM"]]);
  base.select.value = "100_ms";
  const scaling = h("input", { type: "checkbox", id: "scaling", checked: true, onchange: () => fit() });
  const units = numberField("Units a turn", 4096, "", { min: 1, max: 4294967295, step: 1 });
  const range = numberField("Units in all", 134217728, "", { min: 1, max: 4294967295, step: 1 });
  const fit = () => {
    const kind = functionality.select.value;
    scaling.disabled = kind === "class_1";
    base.select.disabled = kind !== "scancon_2";
    units.input.disabled = range.input.disabled = kind === "class_1" || !scaling.checked;
  };
  const send = () => {
    const request = { do: "parameterize", encoder: name(), functionality: functionality.select.value, code_sequence: sequence.select.value };
    if (functionality.select.value !== "class_1") request.scaling = scaling.checked;
    if (request.scaling) Object.assign(request, { measuring_units_per_revolution: units.value, total_measuring_range: range.value });
    if (functionality.select.value === "scancon_2") request.time_base = base.select.value;
    attempt(() => master(request), "The encoder took the parameters.");
  };
  fit();
  return h("form", { class: "fault-group wide", onsubmit: (event) => { event.preventDefault(); send(); } }, h("h3", {}, "Parameters"),
    h("div", { class: "parameter-grid" }, functionality.element, sequence.element, base.element,
      h("label", { class: "check", for: "scaling" }, scaling, "Scaling"), units.element, range.element),
    h("button", { type: "submit", class: "primary", id: "parameterize" }, "Parameterize"));
}

function address() {
  const from = numberField("From", 126, "", { min: 0, max: 126, step: 1 });
  const to = numberField("to", 5, "", { min: 1, max: 125, step: 1 });
  return h("form", { class: "fault-group", onsubmit: (event) => {
    event.preventDefault();
    attempt(() => master({ do: "set_address", from: from.value, to: to.value }), "The address is set.");
  } }, h("h3", {}, "Address"), h("p", { class: "subtle" }, "Only with the switches at 7E (126)"),
  h("div", { class: "fault-row" }, from.element, to.element, h("button", { type: "submit" }, "Set")));
}

function together() {
  const ask = (what, text) => button(text, () => attempt(() => master({ do: what, encoder: name() }), `${text}: done.`));
  return h("div", { class: "fault-group" }, h("h3", {}, "Global control"),
    h("div", { class: "fault-row" }, ask("sync", "Sync"), ask("unsync", "Unsync")),
    h("div", { class: "fault-row" }, ask("freeze", "Freeze"), ask("unfreeze", "Unfreeze")),
    h("div", { class: "fault-row" }, ask("unlock", "Unlock")));
}
