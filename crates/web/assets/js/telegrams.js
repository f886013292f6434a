// Telegrams as they pass: a list of which only the rows in sight exist, and the one that is looked at, octet by octet.

import { button, choice, h, setClass, setText } from "./dom.js";
import { fixed, whole } from "./format.js";
import { part } from "./frames.js";
import { makeOctets } from "./octets.js";
import { on as listen, store } from "./store.js";

const ROW = 24;
const KEPT = 5000;
const KINDS = {
  all: ["all", () => true],
  acyclic: ["without cyclic data", (t) => !t.cyclic && t.kind !== "token"],
  refused: ["refused or damaged", (t) => t.refused || t.kind === "damaged"],
  encoder: ["of this encoder", (t) => {
    const address = store.encoders.get(store.selected)?.device?.address;
    return t.from === address || t.to === address;
  }],
};

/** Fills the panel. */
export function makeTelegrams(panel) {
  const log = makeLog();
  const rows = makeRows(log);
  const detail = makeDetail();
  const kind = choice("Show", Object.entries(KINDS).map(([value, [text]]) => [value, text]), (value) => { log.filter(value, search.value); rows.reset(); });
  const search = h("input", { type: "search", placeholder: "words, address or octets", "aria-label": "Filter telegrams", id: "telegram-filter",
    oninput: () => { log.filter(kind.select.value, search.value); rows.reset(); } });
  const pause = button("Pause", () => {
    log.pause(!log.paused);
    setText(pause, log.paused ? "Go on" : "Pause");
    pause.setAttribute("aria-pressed", String(log.paused));
    if (!log.paused) rows.reset();
  }, { id: "telegram-pause", "aria-pressed": "false" });
  const count = h("span", { class: "subtle", id: "telegram-count" });
  rows.onchoose = (telegram) => detail.show(telegram);
  panel.append(
    h("div", { class: "bar" }, kind.element, search, pause, button("Clear", () => { log.clear(); rows.reset(); detail.show(null); }), count),
    h("div", { class: "telegram-body" }, rows.element, detail.element));
  listen("telegrams", (batch) => log.take(batch));
  listen("plant", () => { log.clear(); rows.reset(); detail.show(null); });
  part({ frame: () => { if (!panel.hidden && panel.offsetParent) rows.frame(); } });
  return () => setText(count, `${whole(log.shown.length)} of ${whole(log.seen)}${log.dropped ? `, ${whole(log.dropped)} not shown` : ""}${log.paused && log.waiting.length ? ` · ${whole(log.waiting.length)} wait` : ""}`);
}

/** What is kept, and what of it passes the filter. */
function makeLog() {
  const log = { all: [], shown: [], waiting: [], seen: 0, dropped: 0, paused: false, version: 0, take, pause, clear, filter };
  let wanted = () => true;

  function take({ dropped, telegrams }) {
    log.dropped += dropped;
    log.seen += telegrams.length;
    for (const telegram of telegrams) {
      telegram.cyclic = telegram.service ? telegram.service === "Data_Exchange" : /^Data_Exchange/.test(telegram.what);
      (log.paused ? log.waiting : log.all).push(telegram);
      if (!log.paused && wanted(telegram)) log.shown.push(telegram);
    }
    if (log.waiting.length > KEPT) log.waiting.splice(0, log.waiting.length - KEPT);
    if (log.all.length > 2 * KEPT) log.all.splice(0, log.all.length - KEPT);
    if (log.shown.length > 2 * KEPT) log.shown.splice(0, log.shown.length - KEPT);
    log.version++;
  }

  function pause(on) {
    log.paused = on;
    if (on) return;
    log.all.push(...log.waiting);
    log.waiting = [];
    log.shown = log.all.filter(wanted);
    log.version++;
  }

  function clear() {
    Object.assign(log, { all: [], shown: [], waiting: [], seen: 0, dropped: 0 });
    log.version++;
  }

  function filter(kind, text) {
    const needle = text.trim().toLowerCase();
    const ofKind = KINDS[kind][1];
    wanted = (t) => ofKind(t) && (needle === "" || `${t.from ?? ""} -> ${t.to ?? ""} ${t.what} ${t.refused ?? ""} ${t.octets}`.toLowerCase().includes(needle));
    log.shown = log.all.filter(wanted);
    log.version++;
  }
  return log;
}

function makeRows(log) {
  const space = h("div", { class: "telegram-space" });
  const list = h("div", { class: "telegram-list", id: "telegrams", role: "listbox", tabindex: 0, "aria-label": "Telegrams" }, space);
  const rows = [];
  const self = { element: list, onchoose: () => {}, frame, reset };
  let chosen = null;
  let follow = true;
  let own = null; // where the list was scrolled to from here
  let drawn = "";

  function row() {
    const made = { number: h("span", { class: "t-n" }), at: h("span", { class: "t-at" }), way: h("span", { class: "t-way" }), what: h("span", { class: "t-what" }), octets: h("span", { class: "t-octets" }) };
    made.element = h("div", { class: "telegram", role: "option", onpointerdown: () => choose(made.telegram) }, made.number, made.at, made.way, made.what, made.octets);
    space.append(made.element);
    return made;
  }

  function choose(telegram) {
    if (!telegram) return;
    chosen = telegram;
    follow = follow && log.paused;
    drawn = "";
    self.onchoose(telegram);
  }

  function frame() {
    const { shown } = log;
    const height = list.clientHeight;
    const needed = Math.ceil(height / ROW) + 1;
    const key = `${log.version} ${list.scrollTop} ${height}`;
    if (key === drawn) return;
    while (rows.length < needed) rows.push(row());
    space.style.height = `${shown.length * ROW}px`;
    if (follow) {
      list.scrollTop = shown.length * ROW;
      own = list.scrollTop;
    }
    const top = Math.max(0, Math.min(Math.floor(list.scrollTop / ROW), shown.length - needed + 1));
    rows.forEach((each, i) => fill(each, shown[top + i], (top + i) * ROW, chosen));
    drawn = `${log.version} ${list.scrollTop} ${height}`;
  }

  function reset() {
    follow = true;
    drawn = "";
  }

  list.addEventListener("wheel", (event) => { if (event.deltaY < 0) follow = false; }, { passive: true });
  list.addEventListener("scroll", () => {
    // Its own scrolling to the end decides nothing: somebody may have chosen a row since.
    if (list.scrollTop === own) {
      own = null;
      return;
    }
    // By what is laid out, not by the log: telegrams may have come since the last frame.
    follow = list.scrollTop + list.clientHeight >= list.scrollHeight - ROW;
  }, { passive: true });
  list.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    const { shown } = log;
    const from = chosen ? shown.indexOf(chosen) : shown.length - 1;
    const to = Math.max(0, Math.min(shown.length - 1, from + by));
    follow = false;
    choose(shown[to]);
    // Telegrams may have come since the last frame: without their height the end would be in the way.
    space.style.height = `${shown.length * ROW}px`;
    if (to * ROW < list.scrollTop) list.scrollTop = to * ROW;
    if ((to + 1) * ROW > list.scrollTop + list.clientHeight) list.scrollTop = (to + 1) * ROW - list.clientHeight;
    own = list.scrollTop;
  });
  return self;
}

function fill(row, telegram, top, chosen) {
  setClass(row.element, "empty", !telegram);
  row.telegram = telegram;
  if (!telegram) return;
  if (row.top !== top) {
    row.top = top;
    row.element.style.transform = `translateY(${top}px)`;
  }
  setText(row.number, whole(telegram.n));
  setText(row.at, fixed(telegram.at_ns / 1e9, 4));
  setText(row.way, way(telegram));
  setText(row.what, telegram.refused ? `${telegram.what}: ${telegram.refused}` : telegram.what);
  setText(row.octets, telegram.octets);
  const kind = `telegram ${telegram.kind}${telegram.refused ? " refused" : ""}${telegram === chosen ? " chosen" : ""}`;
  if (row.kind !== kind) {
    row.kind = kind;
    row.element.className = kind;
    row.element.setAttribute("aria-selected", String(telegram === chosen));
  }
}

const station = (address) => (address === null || address === undefined ? "?" : address === 127 ? "all" : String(address));
const way = (t) => (t.kind === "damaged" && t.from === null ? "damaged" : `${station(t.from)} \u2192 ${station(t.to)}`);

const HINT = "Choose a telegram: its octets and fields stand here, and point at each other.";

function makeDetail() {
  const title = h("h3", {}, "No telegram chosen");
  const refused = h("p", { class: "refusal" });
  const octets = makeOctets("Octets of the telegram", 12);
  const fields = h("ul", { class: "fields" });
  const hint = h("p", { class: "subtle" }, HINT);
  const element = h("div", { class: "detail", id: "telegram-detail" }, title, refused, octets.element, hint, h("div", { class: "fields-scroll" }, fields));
  return {
    element,
    show(telegram) {
      octets.unlink();
      octets.show("");
      octets.show(telegram?.octets ?? "");
      setText(title, telegram ? `${whole(telegram.n)} · ${way(telegram)} · ${telegram.what}` : "No telegram chosen");
      setText(refused, telegram?.refused ?? telegram?.notes?.join(" ") ?? "");
      hint.hidden = telegram !== null && (telegram.fields ?? []).length > 0;
      setText(hint, telegram ? "What it holds was not taken apart: too many of its kind came at once." : HINT);
      fields.replaceChildren(...(telegram?.fields ?? []).map((field) => {
        const item = h("li", { tabindex: 0, class: "field-row" },
          h("span", { class: "where" }, field.first === field.last ? `${field.first}` : `${field.first}–${field.last}`),
          h("span", { class: "name" }, field.bits ? `${field.name} (bit${field.bits[0] === field.bits[1] ? ` ${field.bits[0]}` : `s ${field.bits[0]}\u2013${field.bits[1]}`})` : field.name), h("span", { class: "value" }, String(field.value ?? "")),
          h("span", { class: "text" }, field.text ?? ""));
        octets.link(field.first, field.last, item);
        return item;
      }));
    },
  };
}
