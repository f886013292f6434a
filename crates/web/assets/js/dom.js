// Elements made and changed with as little work as possible.

const SVG = "http://www.w3.org/2000/svg";

/** Makes an element of HTML. Keys beginning with `on` are listeners, `class` and `text` what they say, the rest attributes. */
export function h(tag, properties, ...children) {
  return fill(document.createElement(tag), properties, children);
}

/** Makes an element of SVG, likewise. */
export function s(tag, properties, ...children) {
  return fill(document.createElementNS(SVG, tag), properties, children);
}

function fill(element, properties, children) {
  for (const [key, value] of Object.entries(properties ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "text") element.textContent = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  for (const child of children.flat()) {
    if (child !== null && child !== undefined && child !== false) element.append(child);
  }
  return element;
}

/** Sets a text only if it is another one: the browser then has nothing to lay out. */
export function setText(element, text) {
  if (element.shown !== text) {
    element.shown = text;
    element.textContent = text;
  }
}

/** Sets an attribute only if it is another one; `null` and `false` remove it. */
export function setAttribute(element, name, value) {
  const kept = (element.kept ??= {});
  if (kept[name] === value) return;
  kept[name] = value;
  if (value === null || value === false || value === undefined) element.removeAttribute(name);
  else element.setAttribute(name, value === true ? "" : value);
}

/** Sets a class or takes it away, only on a change. */
export function setClass(element, name, on) {
  if (element.classList.contains(name) !== on) element.classList.toggle(name, on);
}

/** A button. */
export function button(text, onclick, properties) {
  return h("button", { type: "button", onclick, ...properties }, text);
}

let fields = 0;

/** A number field with label and unit; `.value` is a number, or NaN if none is written. */
export function numberField(label, value, unit, limits = {}) {
  const id = `field-${++fields}`;
  const input = h("input", { id, type: "number", value, step: "any", ...limits });
  const element = h("span", { class: "field" },
    h("label", { for: id }, label),
    h("span", { class: "with-unit" }, input, unit ? h("span", { class: "unit" }, unit) : null));
  return { element, input, get value() { return input.valueAsNumber; }, set value(to) { input.value = to; } };
}

/** A choice with a label. `options` are [value, text] pairs. */
export function choice(label, options, onchange) {
  const id = `field-${++fields}`;
  const select = h("select", { id, onchange: () => onchange?.(select.value) },
    options.map(([value, text]) => h("option", { value }, text)));
  return { element: h("span", { class: "field" }, h("label", { for: id }, label), select), select };
}

/** The panel's heading, and what stands at its right end. */
export function heading(id, text, ...right) {
  return h("header", { class: "card-head" }, h("h2", { id }, text), h("div", { class: "card-side" }, right));
}
