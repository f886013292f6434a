// A rotary switch with 16 positions. Turned by a click (one on; with Shift one back), by dragging, with the arrow keys,
// or by typing the hex digit.

import { s, setAttribute } from "./dom.js";

const RADIUS = 42;

const angleOf = (value) => (value / 16) * 360;

/** Makes one with its middle at (x, y). `onturn(value)` is called for each new position. */
export function rotarySwitch(name, x, y, onturn) {
  const rotor = s("g", { class: "rotor" },
    s("circle", { cx: x, cy: y, r: 21, class: "rotor-disc" }),
    s("path", { d: `M${x - 3.5} ${y + 15}v-27l3.5 -6l3.5 6v27z`, class: "rotor-arrow" }));
  const digits = Array.from({ length: 16 }, (_, value) => {
    const angle = (angleOf(value) - 90) * (Math.PI / 180);
    return s("text", {
      x: (x + 33.5 * Math.cos(angle)).toFixed(1), y: (y + 33.5 * Math.sin(angle) + 3.6).toFixed(1), class: "digit", "text-anchor": "middle",
    }, value.toString(16).toUpperCase());
  });
  const element = s("g", {
    class: "rotary", role: "slider", tabindex: 0, "aria-label": `Rotary switch ${name}`,
    "aria-valuemin": 0, "aria-valuemax": 15, "aria-valuenow": 0, "data-switch": name,
  },
  s("circle", { cx: x, cy: y, r: RADIUS, class: "rotary-body" }), digits, rotor,
  s("text", { x, y: y + RADIUS + 13, class: "rotary-name", "text-anchor": "middle" }, name));

  const self = { element, value: 0, show };
  let shownAngle = 0;
  let heldUntil = 0; // what was just turned here is not turned back by a snapshot that is older

  function put(value) {
    self.value = value;
    // The short way round, so that F -> 0 is one step.
    const step = ((((angleOf(value) - shownAngle) % 360) + 540) % 360) - 180;
    shownAngle += step;
    rotor.style.transform = `rotate(${shownAngle}deg)`;
    setAttribute(element, "aria-valuenow", String(value));
    setAttribute(element, "aria-valuetext", `${value.toString(16).toUpperCase()}`);
    for (const [i, digit] of digits.entries()) digit.classList.toggle("chosen", i === value);
  }

  function show(value) {
    if (performance.now() > heldUntil && (value !== self.value || !element.kept?.["aria-valuetext"])) put(value);
  }

  function turn(value) {
    const to = (value + 16) % 16;
    if (to === self.value) return;
    heldUntil = performance.now() + 700;
    put(to);
    onturn(to);
  }

  rotor.style.transformOrigin = `${x}px ${y}px`;
  put(0);
  element.addEventListener("keydown", (event) => {
    const steps = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    if (steps) turn(self.value + steps);
    else if (event.key === "Home") turn(0);
    else if (event.key === "End") turn(15);
    else if (/^[0-9a-fA-F]$/.test(event.key) && !event.ctrlKey && !event.metaKey) turn(parseInt(event.key, 16));
    else return;
    event.preventDefault();
  });
  makeDraggable(element, x, y, self, turn);
  return self;
}

function makeDraggable(element, x, y, self, turn) {
  let moved = false;
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    moved = false;
    const at = middle(element, x, y);
    const begun = Math.atan2(event.clientY - at.y, event.clientX - at.x);
    const from = self.value;
    const drag = (move) => {
      const angle = Math.atan2(move.clientY - at.y, move.clientX - at.x) - begun;
      const steps = Math.round((angle / (2 * Math.PI)) * 16);
      if (steps !== 0) moved = true;
      if (moved) turn(from + steps + 32);
    };
    element.addEventListener("pointermove", drag);
    element.addEventListener("lostpointercapture", () => element.removeEventListener("pointermove", drag), { once: true });
  });
  element.addEventListener("click", (event) => {
    if (!moved) turn(self.value + (event.shiftKey ? -1 : 1));
  });
}

function middle(element, x, y) {
  const point = element.ownerSVGElement.createSVGPoint();
  point.x = x;
  point.y = y;
  return point.matrixTransform(element.getScreenCTM());
}
