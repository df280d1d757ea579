// Every parameter as slider and number; ticked ones are free for the search.

import { make, numberIn, put, shown } from "./dom.js";

const HEADS = { mm: "Lengths", deg: "Angles", kg: "Masses", "kg m²": "Inertias", N: "Forces", "": "Others" };

export class Parameters {
  constructor(box, { onChange, onFree }) {
    Object.assign(this, { box, onChange, onFree });
    this.rows = new Map();
    this.gesture = 0;
  }

  show(design) {
    const key = design.name + design.parameters.map((p) => p.name).join();
    if (key !== this.key) this.#build(design, key);
    for (const p of design.parameters) this.#put(p);
  }

  // Names of the free parameters.
  get free() {
    return [...this.rows.values()].filter((row) => row.free.checked).map((row) => row.p);
  }

  setFree(names) {
    for (const row of this.rows.values()) row.free.checked = names.includes(row.p.name) && !row.free.disabled;
  }

  #build(design, key) {
    this.key = key;
    this.rows.clear();
    const groups = new Map();
    for (const p of design.parameters) {
      const head = HEADS[p.unit] ?? HEADS[""];
      if (!groups.has(head)) groups.set(head, []);
      groups.get(head).push(p);
    }
    const parts = [make("h2", {}, design.name.replaceAll("_", " ")), make("p", { class: "hint" }, design.description)];
    for (const [head, list] of groups) parts.push(make("h3", {}, head), ...list.map((p) => this.#row(p)));
    this.box.replaceChildren(...parts);
  }

  #row(p) {
    const id = `p_${p.name}`, short = p.text;
    const free = make("input", { type: "checkbox", title: `${short}: free for the search`, "aria-label": `${short} is free for the search`, disabled: !p.searchable, onchange: () => this.onFree() });
    const slider = make("input", { type: "range", id: `s_${p.name}`, "aria-label": short, step: p.whole ? 1 : "any", tabindex: 0 });
    const field = make("input", { type: "number", id, step: "any", inputmode: "decimal", placeholder: "give" });
    const name = make("label", { for: id, class: "name", title: `${p.name}; double-click sets it back` }, short);
    const row = { p, free, slider, field, box: null };
    slider.addEventListener("input", () => this.#send(row, slider.valueAsNumber));
    slider.addEventListener("change", () => { this.gesture += 1; });
    field.addEventListener("change", () => {
      const value = numberIn(field);
      this.gesture += 1;
      if (value === null) this.onChange(null, `${short}: this is no number`);
      else this.#send(row, value);
    });
    name.addEventListener("dblclick", () => { if (row.p.base !== null) { this.gesture += 1; this.#send(row, row.p.base); } });
    row.box = make("div", { class: "parameter" }, free, name, slider, field, make("span", { class: "unit" }, p.unit));
    this.rows.set(p.name, row);
    return row.box;
  }

  #send(row, value) {
    if (document.activeElement !== row.field) row.field.value = shown(value, 6);
    this.onChange({ [row.p.name]: value }, null, `${row.p.name} ${this.gesture}`);
  }

  #put(p) {
    const row = this.rows.get(p.name), { slider, field } = row;
    row.p = p;
    const low = p.value === null ? p.low : Math.min(p.low, p.value), high = p.value === null ? p.high : Math.max(p.high, p.value);
    const dragged = document.activeElement === slider && slider.matches(":active");
    if (!dragged) {
      put(slider, "min", low);
      put(slider, "max", high);
      write(slider, p.value ?? low);
    }
    if (document.activeElement !== field || !field.matches("[aria-invalid=true]")) {
      write(field, p.value === null ? "" : shown(p.value, 6));
      if (field.matches("[aria-invalid=true]")) field.setAttribute("aria-invalid", "false");
    }
    row.box.classList.toggle("changed", p.value !== p.base);
  }
}

// The value of a field, where it is another one.
function write(field, value) {
  if (field.value !== String(value)) field.value = value;
}
