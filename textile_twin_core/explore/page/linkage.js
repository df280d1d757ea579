// The moving linkage: links, joints, paths, guides and gears at the shaft's angle; the crank can be dragged.

import { byId, draw, put } from "./dom.js";
import { loop } from "./polyline.js";

const COLOURS = 7;

export class Linkage {
  constructor(svg, onTurn) {
    this.svg = svg;
    this.onTurn = onTurn;
    this.view = null;
    this.coupler = { link: "", along: 0, across: 0 };
    this.still = draw("g");
    this.moved = draw("g");
    svg.append(this.still, this.moved);
    this.#dragging();
    new ResizeObserver(([entry]) => {
      this.size = [entry.contentRect.width || 400, entry.contentRect.height || 300];
      this.view = null;
      this.draw();
    }).observe(svg);
  }

  show(analysis, pinned) {
    const renewed = this.analysis && this.analysis.bars.map((b) => b[0]).join() !== analysis.bars.map((b) => b[0]).join();
    if (renewed) this.view = null;
    this.analysis = analysis;
    this.pinned = pinned;
    this.#paths();
    this.#fit();
    this.draw();
  }

  turn(angle) {
    this.angle = angle;
    if (this.analysis) this.#move();
  }

  #extent() {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const name of [...this.moving, ...this.analysis.fixed]) {
      const [xs, ys] = this.analysis.points[name];
      for (let k = 0; k < xs.length; k += 6) {
        if (xs[k] < box[0]) box[0] = xs[k];
        if (xs[k] > box[2]) box[2] = xs[k];
        if (ys[k] < box[1]) box[1] = ys[k];
        if (ys[k] > box[3]) box[3] = ys[k];
      }
    }
    const round = this.analysis.bars.flatMap(([, start, , axes, gears]) => [...(axes ? [[start, 1.6 * axes[0]]] : []), ...gears]);
    for (const [centre, reach] of round) {
      const [x, y] = [this.analysis.points[centre][0][0], this.analysis.points[centre][1][0]];
      box[0] = Math.min(box[0], x - reach); box[1] = Math.min(box[1], y - reach);
      box[2] = Math.max(box[2], x + reach); box[3] = Math.max(box[3], y + reach);
    }
    return box;
  }

  // The view stays while a slider moves, until the linkage leaves it or fills little of it.
  #fit() {
    const [x0, y0, x1, y1] = this.#extent(), size = Math.max(x1 - x0, y1 - y0, 1e-6);
    const v = this.view;
    if (v && x0 >= v.x0 && y0 >= v.y0 && x1 <= v.x1 && y1 <= v.y1 && size > 0.55 * v.size) return;
    const margin = 0.09 * size;
    this.view = { x0: x0 - margin, y0: y0 - margin, x1: x1 + margin, y1: y1 + margin, size };
  }

  #scale() {
    const [w, h] = (this.size ??= [this.svg.clientWidth || 400, this.svg.clientHeight || 300]), v = this.view;
    const k = Math.min(w / (v.x1 - v.x0), h / (v.y1 - v.y0));
    put(this.svg, "viewBox", `0 0 ${w} ${h}`);
    const dx = (w - k * (v.x1 - v.x0)) / 2, dy = (h - k * (v.y1 - v.y0)) / 2;
    return { k, x: (x) => dx + k * (x - v.x0), y: (y) => h - dy - k * (y - v.y0), back: (px, py) => [(px - dx) / k + v.x0, (h - dy - py) / k + v.y0] };
  }

  #paths() {
    const gears = this.analysis.bars.filter((bar) => bar[3]).map((bar) => bar[2]);
    this.moving = Object.keys(this.analysis.points).filter((name) => !this.analysis.fixed.includes(name) && !gears.includes(name));
  }

  #at(name, a = this.analysis) {
    const [xs, ys] = a.points[name];
    return [sample(xs, this.angle), sample(ys, this.angle)];
  }

  // A point fixed on a link, at every sample.
  couplerPath() {
    const bar = this.analysis.bars.find((b) => b[0] === this.coupler.link);
    if (!bar || (!this.coupler.along && !this.coupler.across)) return null;
    const [sx, sy] = this.analysis.points[bar[1]], [ex, ey] = this.analysis.points[bar[2]];
    const xs = new Float32Array(sx.length), ys = new Float32Array(sx.length);
    const u = this.coupler.along / 1e3, v = this.coupler.across / 1e3;
    for (let k = 0; k < sx.length; k++) {
      const dx = ex[k] - sx[k], dy = ey[k] - sy[k], n = Math.hypot(dx, dy) || 1;
      xs[k] = sx[k] + (u * dx - v * dy) / n;
      ys[k] = sy[k] + (u * dy + v * dx) / n;
    }
    return [xs, ys];
  }

  // All of it: what stands still, the paths of the points and the guides, and then what moves.
  draw() {
    const a = this.analysis;
    if (!a) return;
    if (!this.view) this.#fit();
    const s = this.scale = this.#scale(), parts = [];
    const d = this.moving.map((name) => loop(...a.points[name], s.x, s.y)).join("");
    parts.push(draw("path", { d, fill: "none", stroke: "var(--path)", "stroke-width": 1 }));
    this.extra = this.couplerPath();
    if (this.extra) parts.push(draw("path", { d: loop(...this.extra, s.x, s.y), fill: "none", stroke: "var(--c3)", "stroke-width": 1.8, class: "coupler" }));
    for (const [x, y, ux, uy] of a.guides) {
      const reach = 2 * this.view.size;
      parts.push(draw("line", { x1: s.x(x - reach * ux), y1: s.y(y - reach * uy), x2: s.x(x + reach * ux), y2: s.y(y + reach * uy), stroke: "var(--line)", "stroke-width": 6 }));
    }
    this.still.replaceChildren(...parts);
    this.#move();
  }

  #move() {
    const { analysis: a, scale: s, extra } = this, parts = [];
    if (this.pinned) this.#bars(parts, this.pinned, s, true);
    this.#bars(parts, a, s, false);
    for (const name of Object.keys(a.points)) this.#joint(parts, name, s);
    if (extra) parts.push(draw("circle", { cx: s.x(sample(extra[0], this.angle)), cy: s.y(sample(extra[1], this.angle)), r: 4, fill: "var(--c3)" }));
    this.moved.replaceChildren(...parts);
  }

  #bars(parts, a, s, ghost) {
    const degrees = (this.angle * 180) / Math.PI;
    const crossed = new Set(a.clashes.filter((c) => within(degrees, c[2], c[3])).flatMap((c) => [c[0], c[1]]));
    a.bars.forEach(([name, start, end, axes, gears], k) => {
      const [x1, y1] = this.#at(start, a), [x2, y2] = this.#at(end, a);
      const colour = ghost ? "var(--muted)" : crossed.has(name) ? "var(--bad)" : `var(--c${k % COLOURS})`;
      if (axes) {
        const tilt = (-Math.atan2(y2 - y1, x2 - x1) * 180) / Math.PI, cx = s.x((x1 + x2) / 2), cy = s.y((y1 + y2) / 2);
        parts.push(draw("ellipse", { cx, cy, rx: s.k * axes[0], ry: s.k * axes[1], transform: `rotate(${tilt} ${cx} ${cy})`, fill: colour, "fill-opacity": ghost ? 0 : 0.09, stroke: colour, "stroke-width": 1.4, "stroke-dasharray": ghost ? "4 4" : "none" }));
        return;
      }
      for (const [centre, radius] of gears) {
        const [gx, gy] = this.#at(centre, a);
        parts.push(draw("circle", { cx: s.x(gx), cy: s.y(gy), r: s.k * radius, fill: colour, "fill-opacity": ghost ? 0 : 0.09, stroke: colour, "stroke-width": 1.4, "stroke-dasharray": ghost ? "4 4" : "none", class: "gear" }));
      }
      parts.push(draw("line", { x1: s.x(x1), y1: s.y(y1), x2: s.x(x2), y2: s.y(y2), stroke: colour, "stroke-width": ghost ? 1.5 : 7, "stroke-linecap": "round", "stroke-dasharray": ghost ? "5 4" : "none", "stroke-opacity": ghost ? 0.9 : 0.85, "data-link": ghost ? null : name }));
    });
  }

  #joint(parts, name, s) {
    const [x, y] = this.#at(name), px = s.x(x), py = s.y(y);
    if (!Number.isFinite(px)) return;
    if (this.analysis.fixed.includes(name)) {
      parts.push(draw("path", { d: `M${px} ${py}l-9 13h18z`, fill: "var(--line)", stroke: "var(--muted)" }));
    }
    parts.push(draw("circle", { cx: px, cy: py, r: 4, fill: "var(--panel)", stroke: "var(--ink)", "stroke-width": 1.6 }));
    if (name.length <= 2) parts.push(draw("text", { x: px + 7, y: py - 7 }, name));
  }

  #dragging() {
    let offset = null;
    const angleOf = (event) => {
      const box = this.svg.getBoundingClientRect(), s = this.#scale();
      const [x, y] = s.back(event.clientX - box.left, event.clientY - box.top), [cx, cy] = this.#at(this.analysis.bars[0][1]);
      return Math.atan2(y - cy, x - cx);
    };
    this.svg.addEventListener("pointerdown", (event) => {
      if (!this.analysis) return;
      this.svg.setPointerCapture(event.pointerId);
      offset = this.angle - angleOf(event);
    });
    this.svg.addEventListener("pointermove", (event) => { if (offset !== null) this.onTurn(offset + angleOf(event)); });
    for (const end of ["pointerup", "pointercancel"]) this.svg.addEventListener(end, () => { offset = null; });
  }
}

export function sample(values, angle) {
  const n = values.length, place = ((angle / (2 * Math.PI)) * n) % n, x = place < 0 ? place + n : place;
  const k = Math.floor(x) % n, share = x - Math.floor(x);
  return values[k] + share * (values[(k + 1) % n] - values[k]);
}

function within(degrees, begin, end) {
  const d = ((degrees % 360) + 360) % 360;
  return begin <= end ? d >= begin && d <= end : d >= begin || d <= end;
}
