// Curves over the shaft angle, with marks, a cursor at the angle shown, a second design dashed, and a recording.

import { draw, shown, ticks } from "./dom.js";
import { sample } from "./linkage.js";

const LEFT = 52, RIGHT = 16, TITLE = 20, BOTTOM = 18, PLOT = 125, ROW = 13;

export class Charts {
  constructor(box, onTurn) {
    Object.assign(this, { box, onTurn, angle: 0, held: [] });
    new ResizeObserver(() => this.analysis && this.show(this.analysis, this.pinned, this.recording)).observe(box);
  }

  show(analysis, pinned, recording) {
    Object.assign(this, { analysis, pinned, recording });
    const width = Math.max(240, this.box.clientWidth - 20);
    this.held = analysis.charts.map((chart, k) => this.#chart(chart, width, k));
    this.box.replaceChildren(...this.held.map((held) => held.svg));
    this.turn(this.angle);
  }

  stale(on) {
    for (const { svg } of this.held) svg.classList.toggle("stale", on);
  }

  #chart(chart, width, number) {
    const other = this.pinned?.charts.find((c) => c.title === chart.title);
    const measured = chart.title.startsWith("Torque") ? this.recording : null;
    const all = [...Object.values(chart.curves), ...(other ? Object.values(other.curves) : []), ...(measured ? [measured.torque] : [])];
    let [low, high] = extent(all);
    const room = 0.06 * (high - low) || 1;
    [low, high] = [low - room, high + room];
    const inner = width - LEFT - RIGHT, x = (degrees) => LEFT + (inner * degrees) / 360;
    const named = number === 0 ? this.#named(x, width - RIGHT) : []; // the first chart names the marks of all
    const top = TITLE + ROW * Math.max(0, ...named.map((label) => label.row + 1)), bottom = top + PLOT;
    const y = (value) => bottom - (PLOT * (value - low)) / (high - low);
    const svg = draw("svg", { class: "chart", viewBox: `0 0 ${width} ${bottom + BOTTOM}`, style: `height: ${bottom + BOTTOM}px`, role: "img", "aria-label": `${chart.title} over the shaft angle` });
    for (const [, begin, end] of this.analysis.dwells) {
      for (const [from, to] of begin <= end ? [[begin, end]] : [[begin, 360], [0, end]]) {
        svg.append(draw("rect", { x: x(from), y: top, width: x(to) - x(from), height: PLOT, class: "dwell" }));
      }
    }
    for (const value of ticks(low, high, 3)) {
      svg.append(draw("line", { x1: LEFT, x2: width - RIGHT, y1: y(value), y2: y(value), stroke: "var(--line)" }));
      svg.append(draw("text", { x: LEFT - 5, y: y(value) + 4, "text-anchor": "end" }, shown(value, 4)));
    }
    for (let degrees = 0; degrees <= 360; degrees += 60) {
      svg.append(draw("text", { x: x(degrees), y: bottom + BOTTOM - 4, "text-anchor": "middle" }, `${degrees}°`));
    }
    for (const [, degrees] of this.analysis.marks) {
      svg.append(draw("line", { x1: x(degrees), x2: x(degrees), y1: top, y2: bottom, stroke: "var(--muted)", "stroke-dasharray": "2 3" }));
    }
    for (const label of named) svg.append(draw("text", { x: label.x, y: TITLE + ROW * (label.row + 1) - 4, class: "mark" }, label.name));
    svg.append(draw("text", { x: 2, y: 13, class: "title" }, `${chart.title}, ${chart.unit}`));
    if (measured) svg.append(draw("path", { d: dots(measured.theta, measured.torque, x, y), stroke: "var(--c6)", "stroke-width": 3, "stroke-linecap": "round", fill: "none", class: "recording" }));
    const labels = [];
    let right = width - RIGHT;
    const names = Object.keys(chart.curves);
    names.forEach((name, k) => {
      if (other?.curves[name]) svg.append(draw("path", { d: path(other.curves[name], x, y), stroke: `var(--c${k % 7})`, "stroke-width": 1.2, "stroke-dasharray": "5 4", fill: "none" }));
      svg.append(draw("path", { d: path(chart.curves[name], x, y), stroke: `var(--c${k % 7})`, "stroke-width": 1.8, fill: "none", "data-curve": `${chart.title}/${name}` }));
    });
    for (let k = names.length - 1; k >= 0; k--) {
      const text = draw("text", { x: right, y: 13, "text-anchor": "end", style: `fill: var(--c${k % 7})` }, names[k]);
      labels.push({ text, name: names[k], values: chart.curves[names[k]] });
      right -= 6.2 * (names[k].length + (names.length < 4 ? 11 : 2)) + 8;
      svg.append(text);
    }
    if (measured) svg.append(draw("text", { x: right, y: 13, "text-anchor": "end", style: "fill: var(--c6)" }, "• measured"));
    const cursor = draw("line", { y1: top, y2: bottom, stroke: "var(--ink)", "stroke-width": 1 });
    svg.append(cursor);
    const turn = (event) => {
      const box = svg.getBoundingClientRect(), px = ((event.clientX - box.left) / box.width) * width;
      this.onTurn((Math.min(1, Math.max(0, (px - LEFT) / inner)) * 2 * Math.PI));
    };
    svg.addEventListener("pointerdown", (event) => { svg.setPointerCapture(event.pointerId); turn(event); });
    svg.addEventListener("pointermove", (event) => { if (event.buttons) turn(event); });
    return { svg, cursor, x, labels: names.length < 4 ? labels : [] };
  }

  // Names of marks and dwells above the plot, in as many rows as they need so that none lies on another.
  #named(x, right) {
    const spans = this.analysis.dwells.map(([name, begin, end]) => [`${name} ${shown((end - begin + 360) % 360, 4)}°`, begin]);
    const ends = [];
    return [...this.analysis.marks, ...spans].sort((a, b) => a[1] - b[1]).map(([name, degrees]) => {
      const size = 6.2 * name.length, begin = Math.min(x(degrees) + 2, right - size);
      let row = ends.findIndex((end) => end < begin);
      if (row < 0) row = ends.length;
      ends[row] = begin + size + 6;
      return { name, x: begin, row };
    });
  }

  turn(angle) {
    this.angle = angle;
    const degrees = ((((angle * 180) / Math.PI) % 360) + 360) % 360;
    for (const { cursor, x, labels } of this.held) {
      cursor.setAttribute("x1", x(degrees));
      cursor.setAttribute("x2", x(degrees));
      for (const { text, name, values } of labels) text.textContent = `${name} ${shown(sample(values, angle), 4)}`;
    }
  }
}

function extent(curves) {
  let low = Infinity, high = -Infinity;
  for (const values of curves) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return Number.isFinite(low) ? [low, high] : [0, 1];
}

function path(values, x, y) {
  let d = "", on = false;
  const n = values.length;
  for (let k = 0; k <= n; k++) {
    const value = values[k % n];
    if (Number.isFinite(value)) d += `${on ? "L" : "M"}${x((360 * k) / n).toFixed(1)} ${y(value).toFixed(1)}`;
    on = Number.isFinite(value);
  }
  return d;
}

function dots(theta, values, x, y) {
  let d = "";
  for (let k = 0; k < theta.length; k++) {
    if (Number.isFinite(values[k])) d += `M${x((theta[k] * 180) / Math.PI).toFixed(1)} ${y(values[k]).toFixed(1)}h0`;
  }
  return d;
}
