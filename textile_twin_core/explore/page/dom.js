// Small helpers to make and find elements.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

export function make(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

export function draw(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// Write an attribute, or the text where no name is given, but only where it changes: the browser then has less to lay out.
export function put(element, name, value) {
  const held = (element.held ??= new Map()), text = String(value);
  if (held.get(name) === text) return;
  held.set(name, text);
  if (name) element.setAttribute(name, text);
  else element.textContent = text;
}

export function shown(value, digits = 5) {
  if (value == null || !Number.isFinite(value)) return "–";
  if (Math.abs(value) < 1e-12) return "0";
  const plain = +value.toPrecision(digits);
  return Math.abs(plain) < 1e-3 || Math.abs(plain) >= 1e7 ? plain.toExponential() : String(plain);
}

// Numbers as short as lets each be told from its neighbours.
export function apart(values, digits = 4) {
  for (let k = digits; k < 15; k++) {
    const texts = values.map((value) => shown(value, k));
    if (new Set(texts).size === values.length) return texts;
  }
  return values.map(String);
}

// The number in a field; null and a mark on the field where there is none.
export function numberIn(field, { empty = false } = {}) {
  const value = field.valueAsNumber;
  const fine = Number.isFinite(value) || (empty && field.value === "" && !field.validity.badInput);
  field.setAttribute("aria-invalid", String(!fine));
  return Number.isFinite(value) ? value : null;
}

// Round steps of an axis that covers low to high in about `count` steps.
export function ticks(low, high, count = 4) {
  const rough = (high - low) / count || 1, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((k) => k * power >= rough) * power;
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(+(k * step).toPrecision(12));
  return found;
}
