// Position, velocity and acceleration over the last seconds. The time axis scrolls with the bus clock in every frame;
// samples only add to the line ahead of what is shown.

import { h, heading, setAttribute, setText } from "./dom.js";
import { accelerationUnit, fixed, velocityUnit, whole } from "./format.js";
import { part } from "./frames.js";
import { encoder, on as listen, past, store } from "./store.js";
import { colour, onTheme } from "./theme.js";

const SPANS = [5, 10, 30, 60];
const LINES = [
  { key: "position", label: "Position", unit: () => "units" },
  { key: "velocity", label: "Velocity", unit: velocityUnit },
  { key: "acceleration", label: "Acceleration", unit: accelerationUnit },
];

/** Steps of a y axis: all values are whole. */
const STEPS = Array.from({ length: 11 }, (_, power) => [1, 2, 5].map((digit) => digit * 10 ** power)).flat();

let span = 10;

/** Fills the card. */
export function makeCharts(card) {
  const lines = LINES.map(makeLine);
  const spans = h("div", { class: "segmented", role: "group", "aria-label": "Length of the time axis" },
    SPANS.map((each) => h("button", { type: "button", "data-span": each, "aria-pressed": String(each === span), onclick: (event) => {
      span = each;
      for (const other of event.target.parentNode.children) other.setAttribute("aria-pressed", String(other === event.target));
    } }, `${each} s`)));
  card.append(heading("charts-title", "Motion", h("span", { class: "subtle", id: "chart-at" }), spans),
    h("div", { class: "chart-rows" }, lines.map((line) => line.element)));
  const resize = new ResizeObserver(() => lines.forEach((line) => line.fit()));
  lines.forEach((line) => resize.observe(line.place));
  onTheme(() => lines.forEach((line) => line.build()));
  listen("selected", () => lines.forEach((line) => line.forget()));
  const machine = makeMachineSpeed();
  part({ frame: (time) => lines.forEach((line) => line.frame(time)) });
  const at = card.querySelector("#chart-at");
  return () => {
    const on = encoder();
    if (!on) return;
    machine.update(on);
    lines.forEach((line) => line.update(on, machine));
    const pointed = lines.find((line) => line.pointed !== null);
    setText(at, pointed ? `at ${fixed(pointed.pointed, 2)} s` : "");
  };
}

/** The speed in the machine's unit: told, or the way between two snapshots. */
function makeMachineSpeed() {
  let last = null;
  const self = { speed: NaN, update };
  function update(on) {
    if (!on.machine) {
      self.speed = NaN;
    } else if (Number.isFinite(on.machine.speed)) {
      self.speed = on.machine.speed;
    } else if (last?.name === on.name && on.at_ns - last.at > 150e6) {
      self.speed = ((on.machine.position - last.position) * 1e9) / (on.at_ns - last.at);
    } else if (last?.name === on.name) return;
    last = on.machine ? { name: on.name, at: on.at_ns, position: on.machine.position } : null;
  }
  return self;
}

function makeLine({ key, label, unit }, i) {
  const value = h("output", { class: "big", id: `value-${key}` }, "–");
  const units = h("span", { class: "unit" });
  const also = h("span", { class: "also" });
  const place = h("div", { class: "plot", role: "img", "aria-label": `${label} over time` });
  const element = h("div", { class: `chart-row ${key}` },
    h("div", { class: "reading" }, h("h3", {}, label), value, h("span", { class: "units" }, units, also)), place);
  const range = makeRange();
  const self = { element, place, pointed: null, fit, build, frame, forget, update };
  let plot = null;
  let drawn = -1;

  function build() {
    plot?.destroy();
    const ink = colour("--ink-3");
    const axis = { stroke: ink, grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false }, font: "11px 'Source Sans 3', sans-serif" };
    plot = new uPlot({
      width: Math.max(80, place.clientWidth), height: Math.max(40, place.clientHeight),
      padding: [8, 10, i === 2 ? 0 : 4, 0],
      legend: { show: false },
      cursor: { sync: { key: "motion" }, drag: { x: false, y: false }, points: { size: 6 }, y: false },
      scales: { x: { time: false, auto: false }, y: { auto: true, range: (_, low, high) => range(low, high) } },
      axes: [
        { ...axis, size: i === 2 ? 22 : 0, gap: 4, values: (_, splits) => splits.map((at) => (i === 2 && at >= 0 ? clockWord(at) : "")), space: 60 },
        { ...axis, size: 62, gap: 6, space: 24, incrs: STEPS, values: (_, splits) => splits.map(short) },
      ],
      series: [{}, { stroke: colour(`--line-${key}`), width: 1.75, points: { show: false }, paths: line }],
      hooks: { setCursor: [pointedAt] },
    }, data(), place);
    drawn = -1;
  }

  function data() {
    const kept = past();
    return [kept.time, kept[key]];
  }

  function pointedAt(u) {
    const at = u.cursor.idx;
    const inside = at !== null && at !== undefined && u.cursor.left >= 0;
    self.pointed = inside ? past().time[at] : null;
    self.pointedValue = inside ? past()[key][at] : null;
    if (encoder()) update(encoder());
  }

  function fit() {
    if (!plot) build();
    else plot.setSize({ width: Math.max(80, place.clientWidth), height: Math.max(40, place.clientHeight) });
  }

  function forget() {
    range.forget();
    drawn = -1;
  }

  function frame(time) {
    if (!plot || place.offsetParent === null) return;
    if (store.connection !== "live") return;
    plot.batch(() => {
      if (drawn !== store.snapshots) {
        drawn = store.snapshots;
        plot.setData(data(), false);
      }
      plot.setScale("x", { min: time - span, max: time });
    });
  }

  function update(on, machine) {
    const live = on.device?.[key];
    const shown = self.pointed === null ? live : self.pointedValue;
    setText(value, shown === null || shown === undefined ? "–" : whole(shown));
    setAttribute(value, "class", `big${self.pointed === null ? "" : " pointed"}`);
    setText(units, unit(on.device));
    if (machine) setText(also, inMachine(key, on, machine));
  }
  return self;
}

/** The path of a line; where nothing is known it is lifted. (uPlot's own clips gaps, and shows a hair where they are narrow.) */
function line(u, series, from, to) {
  const stroke = new Path2D();
  const [xs, ys] = [u.data[0], u.data[series]];
  let down = false;
  for (let i = from; i <= to; i++) {
    if (ys[i] === null) {
      down = false;
      continue;
    }
    const x = u.valToPos(xs[i], "x", true);
    const y = u.valToPos(ys[i], "y", true);
    if (down) stroke.lineTo(x, y);
    else stroke.moveTo(x, y);
    down = true;
  }
  return { stroke, fill: null, clip: null };
}

function inMachine(key, on, machine) {
  if (key === "position") return on.machine ? `${fixed(on.machine.position, 3)} ${on.machine.unit}` : "";
  if (key === "velocity") return on.machine ? `${fixed(machine.speed, 3)} ${on.machine.unit}/s` : `${fixed(on.rpm, 1)} RPM`;
  return "";
}

/**
 * The y range: round limits that grow at once and shrink only when much smaller ones would do for a while, so that the axis
 * does not breathe.
 */
function makeRange() {
  let kept = null;
  let smallerSince = null;
  const range = (low, high) => {
    if (low === null || high === null) return kept ?? [-1, 1];
    const next = roundOut(low, high);
    if (!kept || next[0] < kept[0] || next[1] > kept[1]) {
      kept = kept && smallerSince === null && overlap(kept, next) ? [Math.min(kept[0], next[0]), Math.max(kept[1], next[1])] : next;
      smallerSince = null;
    } else if (next[1] - next[0] < 0.6 * (kept[1] - kept[0])) {
      smallerSince ??= performance.now();
      if (performance.now() - smallerSince > 700) {
        kept = next;
        smallerSince = null;
      }
    } else smallerSince = null;
    return kept;
  };
  range.forget = () => { kept = null; };
  return range;
}

const overlap = (a, b) => a[0] < b[1] && b[0] < a[1];

function roundOut(low, high) {
  if (high - low < 4) [low, high] = [low - 2, high + 2];
  const size = high - low;
  const step = 10 ** Math.floor(Math.log10(size)) / 2;
  const pad = size * 0.06;
  return [Math.floor((low - pad) / step) * step, Math.ceil((high + pad) / step) * step];
}

const clockWord = (at) => (at < 60 ? `${Math.round(at * 10) / 10} s` : `${Math.floor(at / 60)}:${String(Math.round(at % 60)).padStart(2, "0")}`);

/** A number for an axis: its width must not change the layout. */
function short(value) {
  const size = Math.abs(value);
  const sign = value < 0 ? "\u2212" : "";
  if (size >= 1e9) return `${sign}${trim(size / 1e9)} G`;
  if (size >= 1e6) return `${sign}${trim(size / 1e6)} M`;
  if (size >= 1e4) return `${sign}${trim(size / 1e3)} k`;
  return sign + trim(size);
}

const trim = (value) => String(Number(value.toPrecision(6)));
