// One chart over the shaft angle. Its elements stay while a slider moves: only what has changed is written anew.

import { apart, draw, put, shown, ticks } from "./dom.js";
import { sample } from "./linkage.js";
import { dots, polyline } from "./polyline.js";

const LEFT = 52, RIGHT = 16, TITLE = 22, BOTTOM = 18, PLOT = 125, ROW = 13, LETTER = 6.2, TICKS = 5;
const LEVEL = 1e-4;
const MEASURED = "• measured";

export class Chart {
  constructor(title, names, onTurn) {
    Object.assign(this, { title, names, onTurn, others: new Map(), curves: new Map(), legend: new Map() });
    this.dwells = draw("path", { class: "dwell" });
    this.marks = draw("path", { stroke: "var(--muted)", "stroke-dasharray": "2 3" });
    this.recording = draw("path", { stroke: "var(--c6)", "stroke-width": 3, "stroke-linecap": "round", fill: "none" });
    this.cursor = draw("path", { stroke: "var(--ink)", "stroke-width": 1 });
    names.forEach((name, k) => {
      const stroke = `var(--c${k % 7})`;
      this.others.set(name, draw("path", { stroke, "stroke-width": 1.2, "stroke-dasharray": "5 4", fill: "none" }));
      this.curves.set(name, draw("path", { stroke, "stroke-width": 1.8, fill: "none", "data-curve": `${title}/${name}` }));
      this.legend.set(name, draw("text", { y: 13, "text-anchor": "end", style: `fill: ${stroke}` }, name));
    });
    this.frame = draw("g");
    this.named = draw("g");
    const pairs = names.flatMap((name) => [this.others.get(name), this.curves.get(name)]);
    this.svg = draw("svg", { class: "chart", role: "img", "aria-label": `${title} over the shaft angle` },
      this.dwells, this.frame, this.marks, this.named, this.recording, ...pairs, ...this.legend.values(), this.cursor);
    this.#turning();
  }

  // `chart` with its curves, `other` the same of the design compared with, `measured` a recording; `named` are the marks'
  // labels where this chart bears them.
  show(chart, other, measured, analysis, width, named) {
    Object.assign(this, { chart, width, inner: width - LEFT - RIGHT });
    const free = this.inner + LEFT - 7 * (this.title.length + chart.unit.length + 2);
    this.lower = this.#legend(Boolean(measured)) > free ? ROW : 0; // the legend stands under the title where it has no room beside it
    this.head = TITLE + this.lower;
    this.top = this.head + ROW * Math.max(0, ...named.map((label) => label.row + 1));
    this.bottom = this.top + PLOT;
    const axis = around([...Object.values(chart.curves), ...(other ? Object.values(other.curves) : []), ...(measured ? [measured.torque] : [])]);
    const x = (degrees) => LEFT + (this.inner * degrees) / 360, y = (value) => this.bottom - (PLOT * (value - axis.low)) / (axis.high - axis.low);
    this.#frame(axis, x, y, Boolean(measured));
    this.#marks(analysis, x);
    this.#names(named);
    put(this.recording, "class", measured ? "recording" : "");
    put(this.recording, "d", measured ? dots(measured.theta, measured.torque, x, y) : "");
    for (const name of this.names) {
      put(this.others.get(name), "d", other?.curves[name] ? polyline(other.curves[name], x, y) : "");
      put(this.curves.get(name), "d", polyline(chart.curves[name], x, y));
    }
  }

  // Axes, title and where the legend stands; the same as long as the axes are.
  #frame(axis, x, y, measured) {
    const key = [axis.low, axis.high, this.width, this.bottom, this.lower, measured].join();
    if (key === this.framed) return;
    this.framed = key;
    const height = this.bottom + BOTTOM, right = this.width - RIGHT, parts = [];
    put(this.svg, "viewBox", `0 0 ${this.width} ${height}`);
    this.svg.style.height = `${height}px`;
    const values = ticks(axis.low, axis.high, TICKS), texts = apart(values);
    values.forEach((value, k) => {
      parts.push(draw("line", { x1: LEFT, x2: right, y1: y(value), y2: y(value), stroke: "var(--line)" }));
      parts.push(draw("text", { x: LEFT - 5, y: y(value) + 4, "text-anchor": "end" }, texts[k]));
    });
    for (let degrees = 0; degrees <= 360; degrees += 60) {
      parts.push(draw("text", { x: x(degrees), y: this.bottom + BOTTOM - 4, "text-anchor": "middle" }, `${degrees}°`));
    }
    parts.push(draw("text", { x: 2, y: 13, class: "title" }, `${this.title}, ${this.chart.unit}`));
    let place = right;
    for (const name of [...this.names].reverse()) {
      put(this.legend.get(name), "x", place);
      put(this.legend.get(name), "y", 13 + this.lower);
      place -= this.#room(name);
    }
    if (measured) parts.push(draw("text", { x: place, y: 13 + this.lower, "text-anchor": "end", style: "fill: var(--c6)" }, MEASURED));
    this.frame.replaceChildren(...parts);
  }

  // How wide the legend is, and a name in it.
  #legend(measured) {
    return this.names.reduce((sum, name) => sum + this.#room(name), measured ? LETTER * MEASURED.length : 0);
  }

  #room(name) {
    return LETTER * (name.length + (this.#tells ? 11 : 2)) + 8;
  }

  #names(named) {
    const key = JSON.stringify([named, this.head]);
    if (key === this.labelled) return;
    this.labelled = key;
    this.named.replaceChildren(...named.map((label) => draw("text", { x: label.x, y: this.head + ROW * (label.row + 1) - 4, class: "mark" }, label.name)));
  }

  #marks(analysis, x) {
    const spans = analysis.dwells.flatMap(([, begin, end]) => (begin <= end ? [[begin, end]] : [[begin, 360], [0, end]]));
    put(this.dwells, "d", spans.map(([from, to]) => `M${x(from).toFixed(1)} ${this.top}H${x(to).toFixed(1)}V${this.bottom}H${x(from).toFixed(1)}Z`).join(""));
    put(this.marks, "d", analysis.marks.map(([, degrees]) => `M${x(degrees).toFixed(1)} ${this.top}V${this.bottom}`).join(""));
  }

  // Few curves have room for their values beside their names.
  get #tells() {
    return this.names.length < 4;
  }

  turn(angle) {
    const degrees = ((((angle * 180) / Math.PI) % 360) + 360) % 360, place = (LEFT + (this.inner * degrees) / 360).toFixed(1);
    put(this.cursor, "d", `M${place} ${this.top}V${this.bottom}`);
    if (!this.#tells) return;
    for (const [name, text] of this.legend) put(text, "", `${name} ${shown(sample(this.chart.curves[name], angle), 4)}`);
  }

  #turning() {
    const turn = (event) => {
      const box = this.svg.getBoundingClientRect(), px = ((event.clientX - box.left) / box.width) * this.width;
      this.onTurn(Math.min(1, Math.max(0, (px - LEFT) / this.inner)) * 2 * Math.PI);
    };
    this.svg.addEventListener("pointerdown", (event) => { this.svg.setPointerCapture(event.pointerId); turn(event); });
    this.svg.addEventListener("pointermove", (event) => { if (event.buttons) turn(event); });
  }
}

// Names of marks and dwells above a plot, in as many rows as they need so that none lies on another.
export function labels(analysis, width) {
  const spans = analysis.dwells.map(([name, begin, end]) => [`${name} ${shown((end - begin + 360) % 360, 4)}°`, begin]);
  const ends = [];
  return [...analysis.marks, ...spans].sort((a, b) => a[1] - b[1]).map(([name, degrees]) => {
    const size = LETTER * name.length, begin = Math.min(LEFT + ((width - LEFT - RIGHT) * degrees) / 360 + 2, width - RIGHT - size);
    let row = ends.findIndex((end) => end < begin);
    if (row < 0) row = ends.length;
    ends[row] = begin + size + 6;
    return { name, x: +begin.toFixed(1), row };
  });
}

// An axis around curves, its ends on quarters of a tick so that it stays while they change a little.
function around(curves) {
  let low = Infinity, high = -Infinity;
  for (const values of curves) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!Number.isFinite(low)) return { low: 0, high: 1 };
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (high - low < LEVEL * size) low = high = 0.5 * (low + high); // rounding makes no curve of what stays the same
  const room = 0.04 * (high - low) || 0.1 * size || 1, marks = ticks(low - room, high + room, TICKS);
  const step = (marks.length > 1 ? marks[1] - marks[0] : high - low + 2 * room) / 4;
  return { low: step * Math.floor((low - room) / step), high: step * Math.ceil((high + room) / step) };
}
