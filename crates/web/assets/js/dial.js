// The shaft seen from its side: the hollow bore with its clamp. It can be dragged, and turned with the keys.

import { command } from "./api.js";
import { s, setAttribute } from "./dom.js";
import { attempt } from "./notes.js";
import { encoder, past, store } from "./store.js";

const R = 100;

/** Counts of one revolution of an encoder with "16x15" bits. */
export const countsPerTurn = (of) => 2 ** parseInt(of.bits, 10);

/** Counts of the whole range. */
export const countsInAll = (of) => of.bits.split("x").reduce((all, bits) => all * 2 ** Number(bits), 1);

/** Makes the drawing. */
export function makeDial() {
  const pointer = s("g", { class: "pointer" },
    s("circle", { r: 56, class: "hollow-shaft" }),
    s("circle", { r: 40, class: "bore" }),
    s("path", { d: "M-9 -48h18v-12h-18z", class: "clamp" }),
    s("circle", { cy: -54, r: 2.6, class: "clamp-screw" }),
    s("path", { d: "M0 -82l6 15h-12z", class: "index" }));
  const ticks = Array.from({ length: 72 }, (_, i) => s("path", {
    d: `M0 ${-R + 8}v${i % 6 === 0 ? 9 : 4.5}`, transform: `rotate(${i * 5})`, class: i % 6 === 0 ? "tick major" : "tick",
  }));
  const labels = [0, 90, 180, 270].map((degrees) => {
    const angle = (degrees - 90) * (Math.PI / 180);
    return s("text", { x: (116 * Math.cos(angle)).toFixed(1), y: (112 * Math.sin(angle) + 5).toFixed(1), "text-anchor": "middle", class: "tick-label" }, `${degrees}°`);
  });
  const element = s("svg", {
    viewBox: "-136 -126 272 252", class: "dial", role: "slider", tabindex: 0, "aria-label": "Shaft",
    "aria-valuemin": 0, "aria-valuenow": 0, "aria-describedby": "dial-help",
  },
  s("circle", { r: R, class: "face" }), ticks, labels,
  [45, 135, 225, 315].map((angle) => s("circle", { r: 3.5, cy: -74, transform: `rotate(${angle})`, class: "bolt" })),
  pointer);
  const self = { element, dragging: false, raw: 0 };
  const send = sender(self);
  makeKeys(element, self, send);
  makeDrag(element, self, send);
  self.frame = (time) => {
    const on = encoder();
    if (!on) return;
    const perTurn = countsPerTurn(on);
    const raw = self.dragging ? self.raw : past().rawAt(time);
    if (raw === self.drawn) return;
    self.drawn = raw;
    pointer.style.transform = `rotate(${(((raw % perTurn) / perTurn) * 360).toFixed(2)}deg)`;
  };
  self.update = () => {
    const on = encoder();
    if (!on) return;
    const perTurn = countsPerTurn(on);
    const all = countsInAll(on);
    setAttribute(element, "aria-valuemax", String(all - 1));
    setAttribute(element, "aria-valuenow", String(((on.shaft_position % all) + all) % all));
    setAttribute(element, "aria-valuetext", `${(on.shaft_position / perTurn).toFixed(2)} turns`);
  };
  return self;
}

/** Sends the newest position only, one request at a time: a slow line must not pile them up. */
function sender(self) {
  let waiting = null;
  let busy = false;
  return async (raw) => {
    self.raw = raw;
    waiting = Math.round(raw);
    if (busy) return;
    busy = true;
    while (waiting !== null) {
      const next = waiting;
      waiting = null;
      const on = encoder();
      const all = countsInAll(on);
      if (!(await attempt(() => command({ do: "shaft", encoder: on.name, shaft: { kind: "still", raw: ((next % all) + all) % all } })))) break;
    }
    busy = false;
  };
}

function makeKeys(element, self, send) {
  element.addEventListener("keydown", (event) => {
    const on = encoder();
    if (!on || store.connection !== "live") return;
    const perTurn = countsPerTurn(on);
    const step = event.shiftKey ? 1 : perTurn / 64;
    const by = { ArrowRight: step, ArrowUp: step, ArrowLeft: -step, ArrowDown: -step, PageUp: perTurn, PageDown: -perTurn }[event.key];
    if (by === undefined && event.key !== "Home") return;
    event.preventDefault();
    // Key after key counts from what was asked for last; after a pause from where the shaft is.
    if (performance.now() - (self.keyAt ?? -1e9) > 600) self.raw = on.shaft_position;
    self.keyAt = performance.now();
    send(by === undefined ? 0 : Math.round(self.raw + by));
  });
}

function makeDrag(element, self, send) {
  const angleAt = (event) => {
    const box = element.getBoundingClientRect();
    return Math.atan2(event.clientY - box.y - box.height / 2, event.clientX - box.x - box.width / 2);
  };
  element.addEventListener("pointerdown", (event) => {
    const on = encoder();
    if (!on || store.connection !== "live") return;
    event.preventDefault();
    element.focus({ focusVisible: false });
    element.setPointerCapture(event.pointerId);
    const perTurn = countsPerTurn(on);
    let angle = angleAt(event);
    self.dragging = true;
    send(on.shaft_position);
    const drag = (move) => {
      const next = angleAt(move);
      let by = next - angle;
      if (by > Math.PI) by -= 2 * Math.PI;
      if (by < -Math.PI) by += 2 * Math.PI;
      angle = next;
      send(self.raw + (by / (2 * Math.PI)) * perTurn);
    };
    element.addEventListener("pointermove", drag);
    element.addEventListener("lostpointercapture", () => {
      element.removeEventListener("pointermove", drag);
      // The shown time is a little behind: let it catch up before the drawing follows it again.
      setTimeout(() => { self.dragging = false; }, 300);
    }, { once: true });
  });
}
