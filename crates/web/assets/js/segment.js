// All encoders at once: small multiples. A choice of one leads to it.

import { h, heading, setAttribute, setText } from "./dom.js";
import { fixed, hex2, STATES, whole } from "./format.js";
import { part } from "./frames.js";
import { countsPerTurn } from "./dial.js";
import { on as listen, past, segmentOf, select, store } from "./store.js";
import { colour, onTheme } from "./theme.js";

const SPAN_S = 10;

/** Fills the card. `open` is called when an encoder was chosen. */
export function makeSegment(card, open) {
  const grid = h("div", { class: "tiles", id: "tiles", role: "listbox", "aria-label": "Encoders" });
  const canvas = h("canvas", { class: "tiles-canvas", "aria-hidden": "true" });
  const count = h("span", { class: "subtle" });
  card.append(heading("segment-title", "Encoders", count), h("div", { class: "tiles-place" }, grid, canvas));
  const sheet = makeSheet(canvas, grid);
  let tiles = [];
  listen("plant", () => {
    tiles = [...store.encoders.keys()].map((name) => makeTile(name, open));
    grid.replaceChildren(...tiles.map((tile) => tile.element));
    grid.classList.toggle("few", tiles.length <= 6);
    grid.classList.toggle("many", tiles.length > 12);
    sheet.measure(tiles);
  });
  grid.addEventListener("keydown", (event) => walk(event, grid));
  new ResizeObserver(() => sheet.measure(tiles)).observe(grid);
  grid.addEventListener("scroll", () => sheet.measure(tiles), { passive: true });
  const inSight = () => card.offsetParent !== null;
  part({ frame: (time) => {
    if (store.connection === "live" && inSight()) sheet.frame(tiles, time);
  } });
  return () => {
    if (!inSight()) return;
    const exchanging = [...store.encoders.values()].filter((each) => each.device?.state === "data_exchange").length;
    setText(count, `${exchanging} of ${tiles.length} exchange data`);
    tiles.forEach((tile) => tile.update());
  };
}

/**
 * One canvas over all tiles, for lines and needles: one each would cost a browser without a graphics card most of its time.
 * Lines become paths when a snapshot comes, and are only moved in the frames between.
 */
function makeSheet(canvas, grid) {
  const context = canvas.getContext("2d");
  let ink = {};
  const paint = () => { ink = { line: colour("--line-position"), needle: colour("--bad") }; };
  onTheme(paint);

  function measure(tiles) {
    const ratio = devicePixelRatio || 1;
    const width = Math.round(grid.clientWidth * ratio);
    const height = Math.round(grid.clientHeight * ratio);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) {
      Object.assign(canvas, { width, height });
      canvas.style.width = `${grid.clientWidth}px`;
      canvas.style.height = `${grid.clientHeight}px`;
    }
    const origin = grid.getBoundingClientRect();
    for (const tile of tiles) tile.measure(origin, ratio, height);
    paint();
  }

  function frame(tiles, time) {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.lineWidth = Math.max(1.25, 1.25 * (devicePixelRatio || 1));
    context.strokeStyle = ink.line;
    for (const tile of tiles) tile.drawLine(context, time);
    context.strokeStyle = ink.needle;
    context.lineWidth = 2 * (devicePixelRatio || 1);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.beginPath();
    for (const tile of tiles) tile.drawNeedle(context, time);
    context.stroke();
  }
  return { measure, frame };
}

function walk(event, grid) {
  const all = [...grid.children];
  const at = all.indexOf(document.activeElement);
  const perRow = all.findIndex((each) => each.offsetTop > all[0].offsetTop);
  const by = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: perRow < 0 ? all.length : perRow, ArrowUp: -(perRow < 0 ? all.length : perRow) }[event.key];
  if (by === undefined || at < 0) return;
  event.preventDefault();
  all[Math.max(0, Math.min(all.length - 1, at + by))].focus();
}

function makeTile(name, open) {
  const line = h("span", { class: "tile-line" });
  const dial = h("span", { class: "tile-dial" });
  const address = h("span", { class: "tile-address" });
  const value = h("span", { class: "tile-value" });
  const state = h("span", { class: "tile-state" });
  const element = h("button", { type: "button", class: "tile", role: "option", "data-encoder": name, onclick: () => { select(name); open(); } },
    h("span", { class: "tile-head" }, h("span", { class: "tile-name" }, name), address),
    h("span", { class: "tile-body" }, dial, value), line, state);
  let perTurn = 65536;
  let box = null; // where the line goes, in the canvas; nothing while out of sight
  let middle = null;
  let path = null;
  let pathEnd = 0;

  function measure(origin, ratio, height) {
    const at = line.getBoundingClientRect();
    const of = dial.getBoundingClientRect();
    box = { x: (at.x - origin.x) * ratio, y: (at.y - origin.y) * ratio, width: at.width * ratio, height: at.height * ratio };
    middle = { x: (of.x + of.width / 2 - origin.x) * ratio, y: (of.y + of.height / 2 - origin.y) * ratio, r: (of.width / 2 - 3) * ratio };
    if (box.y > height || middle.y + of.height < 0) box = middle = null;
    path = null;
  }

  function update() {
    const each = store.encoders.get(name);
    if (!each) return;
    perTurn = countsPerTurn(each);
    path = null;
    const { device } = each;
    setText(address, device ? (device.address === null ? "off bus" : `${device.address} · ${hex2(device.address)}h`) : "off");
    setText(value, each.machine ? `${fixed(each.machine.position, 3)} ${each.machine.unit}` : whole(device?.position ?? NaN));
    const wrong = device ? [...device.alarms, ...device.warnings].map((text) => text.replaceAll("_", " ")) : [];
    setText(state, wrong.length ? wrong.join(", ") : each.injected.off_the_bus ? "off the bus" : each.injected.cut_off ? "behind the cut" : STATES[device?.state ?? "off"]);
    const level = device?.alarms.length ? "alarm" : device?.warnings.length ? "warning" : device?.state === "data_exchange" ? "good" : device ? "waiting" : "off";
    setAttribute(element, "data-level", level);
    setAttribute(element, "aria-selected", String(name === store.selected));
  }

  function drawLine(context, time) {
    if (!box) return;
    const kept = past(name);
    if (!path) {
      path = lineOf(kept, time, box);
      pathEnd = kept.time.at(-1);
    }
    context.setTransform(1, 0, 0, 1, box.x + box.width + ((pathEnd - time) * box.width) / SPAN_S, box.y);
    context.stroke(path);
  }

  function drawNeedle(context, time) {
    if (!middle) return;
    const angle = ((past(name).rawAt(time) % perTurn) / perTurn) * 2 * Math.PI;
    context.moveTo(middle.x, middle.y);
    context.lineTo(middle.x + middle.r * Math.sin(angle), middle.y - middle.r * Math.cos(angle));
  }
  return { element, measure, update, drawLine, drawNeedle };
}

/** The position over the last seconds, its newest sample at x = 0. */
function lineOf({ time: times, position }, time, { width, height }) {
  const path = new Path2D();
  const end = times.length;
  let begin = end;
  let low = Infinity;
  let high = -Infinity;
  while (begin > 0 && times[begin - 1] > time - SPAN_S) {
    begin--;
    const at = position[begin];
    if (at === null) continue;
    if (at < low) low = at;
    if (at > high) high = at;
  }
  if (low === Infinity) return path;
  const scale = high === low ? 0 : (height - 4) / (high - low);
  const floor = high === low ? height / 2 : height - 2;
  // A narrow line needs no more than one point for two pixels. Which samples stay must not change from frame to frame.
  const every = Math.max(1, Math.floor(((end - begin) / width) * 2));
  let down = false;
  for (let i = begin; i < end; i++) {
    if (position[i] === null) {
      down = false;
      continue;
    }
    if (down && i % every !== 0 && i < end - 1 && position[i + 1] !== null) continue;
    const x = ((times[i] - times[end - 1]) * width) / SPAN_S;
    const y = floor - (position[i] - low) * scale;
    if (down) path.lineTo(x, y);
    else path.moveTo(x, y);
    down = true;
  }
  return path;
}
