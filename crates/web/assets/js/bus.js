// The segments: who is there, in which state, at which rate, owned by whom; what was counted, and the cable.

import { h, setAttribute, setText } from "./dom.js";
import { rate, STATES, whole } from "./format.js";
import { select, store } from "./store.js";

const COUNTERS = { telegrams: "telegrams", replies: "replies", line_errors: "line errors", collisions: "collisions", late: "too late", dropped: "dropped", refused_masters: "masters refused" };

/** Fills the panel. */
export function makeBus(panel) {
  const place = h("div", { class: "bus-scroll", tabindex: 0, role: "region", "aria-label": "Stations on the bus" });
  panel.append(place);
  let shape = "";
  let parts = [];
  return () => {
    const { snapshot } = store;
    if (!snapshot) return;
    const next = snapshot.encoders.map((each) => `${each.segment}/${each.name}`).join();
    if (next !== shape) {
      shape = next;
      parts = snapshot.segments.map(({ name }) => makeSegment(name));
      place.replaceChildren(...parts.map((part) => part.element));
    }
    parts.forEach((part) => part.update());
  };
}

function makeSegment(name) {
  const title = h("h3", {});
  const counters = h("p", { class: "subtle" });
  const warning = h("p", { class: "refusal" });
  const body = h("tbody");
  const rows = [...store.encoders.values()].filter((each) => (each.segment ?? name) === name).map((each) => makeRow(each.name));
  const master = makeMasterRow();
  body.append(master.element, ...rows.map((row) => row.element));
  const element = h("div", { class: "bus-segment" }, h("div", { class: "bus-head" }, title, counters), warning,
    h("table", {}, h("thead", {}, h("tr", {}, ["Addr.", "Station", "State", "Master", "Rate", "Telegrams", "Replies", "Line errors"].map((text, i) => h("th", { scope: "col", class: i > 3 ? "number" : null }, text)))), body));
  return {
    element,
    update() {
      const segment = store.segments.get(name);
      if (!segment) return;
      setText(title, `${segment.name} · ${rate(segment.rate)} · ${segment.port}`);
      setText(counters, Object.entries(COUNTERS).filter(([key]) => segment.counters[key] || key === "telegrams")
        .map(([key, text]) => `${whole(segment.counters[key])} ${text}`).join(" · "));
      setText(warning, [segment.cable.cut_after !== null ? `The cable is cut after ${segment.cable.cut_after} devices.` : "", ...segment.termination].filter(Boolean).join(" "));
      master.update(segment);
      rows.forEach((row) => row.update());
    },
  };
}

function cells(count, numbersFrom) {
  return Array.from({ length: count }, (_, i) => h("td", { class: i >= numbersFrom ? "number" : null }));
}

function makeMasterRow() {
  const all = cells(8, 4);
  return {
    element: h("tr", { class: "master-row" }, all),
    update(segment) {
      const owners = new Set([...store.encoders.values()].filter((each) => (each.segment ?? segment.name) === segment.name).map((each) => each.device?.master).filter((owner) => owner !== null && owner !== undefined));
      const texts = [owners.size ? [...owners].join(", ") : "–", store.stage?.master === "built_in" ? "master, built in" : "master, yours", owners.size ? "owns stations" : "owns none", "", rate(segment.rate), "", "", ""];
      texts.forEach((text, i) => setText(all[i], text));
    },
  };
}

function makeRow(name) {
  const all = cells(8, 4);
  const state = h("span", { class: "state" });
  const open = h("button", { type: "button", class: "link", onclick: () => select(name) }, name);
  all[1].append(open);
  all[2].append(state);
  const element = h("tr", {}, all);
  return {
    element,
    update() {
      const each = store.encoders.get(name);
      if (!each) return;
      const { device, counters } = each;
      setAttribute(element, "class", name === store.selected ? "selected" : null);
      setText(all[0], device ? (device.address === null ? "none" : String(device.address)) : "–");
      const key = each.injected.off_the_bus ? "left" : each.injected.cut_off ? "cut" : device?.state ?? "off";
      setText(state, { left: "off the bus", cut: "behind the cut" }[key] ?? STATES[key]);
      setAttribute(state, "class", `state ${key}${device?.alarms.length ? " alarm" : ""}`);
      setText(all[3], device?.master === null || device?.master === undefined ? "–" : String(device.master));
      setText(all[4], device ? rate(device.rate) : "–");
      setText(all[5], whole(counters.telegrams));
      setText(all[6], whole(counters.replies));
      setText(all[7], whole(counters.line_errors));
    },
  };
}
