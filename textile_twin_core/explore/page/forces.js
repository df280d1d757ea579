// Force curves over the measure on which they act. Their knots are dragged up and down, or moved by the arrow keys.

import { apart, draw, put, shown, ticks } from "./dom.js";
import { sample } from "./linkage.js";

const WIDTH = 480, LEFT = 52, RIGHT = 16, TOP = 38, PLOT = 150, BOTTOM = TOP + PLOT, HEIGHT = BOTTOM + 20;
const COLOURS = { in: "var(--c0)", out: "var(--c1)" }, STEP = 0.01;

export class Forces {
  constructor(box, onChange) {
    Object.assign(this, { box, onChange, curves: [], angle: 0 });
  }

  show(heads) {
    const key = JSON.stringify(heads.map((h) => [h.name, h.knots.length, Object.keys(h.ways)]));
    if (key !== this.key) {
      this.key = key;
      this.curves = heads.map((head) => new Force(head, this.onChange));
      this.box.replaceChildren(...this.curves.map((curve) => curve.svg));
    }
    heads.forEach((head, k) => this.curves[k].show(head));
    this.turn(this.angle);
  }

  turn(angle) {
    this.angle = angle;
    for (const curve of this.curves) curve.turn(angle);
  }
}

class Force {
  constructor(head, onChange) {
    Object.assign(this, { head, onChange, gesture: 0, dragged: false });
    this.frame = draw("g");
    this.here = draw("path", { stroke: "var(--ink)", "stroke-width": 1 });
    this.lines = {};
    this.knots = {};
    for (const way of Object.keys(head.ways)) {
      this.lines[way] = draw("path", { stroke: COLOURS[way], "stroke-width": 1.8, fill: "none", "data-force": `${head.name}/${way}` });
      this.knots[way] = head.ways[way].map((_, k) => this.#knot(way, k));
    }
    this.svg = draw("svg", { class: "chart force", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, style: `aspect-ratio: ${WIDTH} / ${HEIGHT}`, role: "group", "aria-label": `Force of ${head.name} over ${head.measure}` },
      this.frame, this.here, ...Object.values(this.lines), ...Object.values(this.knots).flat());
  }

  show(head) {
    this.head = head;
    const [first, last] = [head.knots[0], head.knots.at(-1)];
    this.x = (place) => LEFT + ((WIDTH - LEFT - RIGHT) * (place - first)) / (last - first);
    if (!this.dragged) this.axis = axisOf(Object.values(head.ways).flat());
    this.y = (force) => BOTTOM - (PLOT * (force - this.axis.low)) / (this.axis.high - this.axis.low);
    this.#frame();
    for (const [way, values] of Object.entries(head.ways)) {
      const points = head.lines[way].map(([place, force]) => `${this.x(place).toFixed(1)} ${this.y(force).toFixed(1)}`);
      put(this.lines[way], "d", `M${points.join("L")}`);
      this.knots[way].forEach((knot, k) => {
        put(knot, "cx", this.x(head.knots[k]).toFixed(1));
        put(knot, "cy", this.y(values[k]).toFixed(1));
        put(knot, "aria-valuenow", values[k]);
        put(knot, "aria-label", `${head.name}, way ${way}, at ${shown(head.knots[k], 5)} ${head.knots_unit}: ${shown(values[k], 4)} ${head.unit}`);
      });
    }
  }

  // Where the measure is at the shown angle.
  turn(angle) {
    const { head } = this, place = head.place ? sample(head.place, angle) : NaN;
    const inside = place >= head.knots[0] && place <= head.knots.at(-1);
    put(this.here, "d", inside ? `M${this.x(place).toFixed(1)} ${TOP}V${BOTTOM}` : "");
  }

  #frame() {
    const { head, axis } = this, parts = [], values = ticks(axis.low, axis.high, 5), texts = apart(values);
    values.forEach((value, k) => {
      parts.push(draw("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: this.y(value), y2: this.y(value), stroke: "var(--line)" }));
      parts.push(draw("text", { x: LEFT - 5, y: this.y(value) + 4, "text-anchor": "end" }, texts[k]));
    });
    for (const place of ticks(head.knots[0], head.knots.at(-1), 5)) {
      parts.push(draw("text", { x: this.x(place), y: HEIGHT - 5, "text-anchor": "middle" }, `${shown(place)} ${head.knots_unit}`));
    }
    parts.push(draw("text", { x: 2, y: 13, class: "title" }, `Force of ${head.name} over ${head.measure}, ${head.unit}`));
    const ways = Object.keys(head.ways), works = head.work_J;
    ways.forEach((way, k) => {
      const named = ways.length > 1 ? `way ${way}` : "both ways", work = works ? `, work ${shown(ways.length > 1 ? works[way === "in" ? 0 : 1] : works[0] + works[1], 4)} J a turn` : "";
      parts.push(draw("text", { x: LEFT + k * 0.5 * (WIDTH - LEFT - RIGHT), y: 29, style: `fill: ${COLOURS[way]}` }, named + work));
    });
    this.frame.replaceChildren(...parts);
  }

  #knot(way, k) {
    const knot = draw("circle", { r: 5, fill: COLOURS[way], tabindex: 0, role: "slider", "data-knot": `${this.head.name}/${way}/${k}` });
    const set = (force) => {
      const values = [...this.head.ways[way]];
      values[k] = force;
      this.head.ways = { ...this.head.ways, [way]: values };
      this.onChange(this.head.name, this.head.ways, `${this.head.name} ${this.gesture}`);
    };
    const step = () => STEP * (this.axis.high - this.axis.low);
    knot.addEventListener("pointerdown", (event) => {
      knot.setPointerCapture(event.pointerId);
      this.gesture += 1;
      this.dragged = true;
    });
    knot.addEventListener("pointermove", (event) => {
      if (!this.dragged || !event.buttons) return;
      const box = this.svg.getBoundingClientRect(), py = ((event.clientY - box.top) / box.height) * HEIGHT;
      const share = Math.min(1, Math.max(0, (BOTTOM - py) / PLOT)), { low, high } = this.axis;
      set(+(low + share * (high - low)).toPrecision(4));
    });
    for (const end of ["pointerup", "pointercancel"]) {
      knot.addEventListener(end, () => {
        this.dragged = false;
        this.show(this.head);
      });
    }
    knot.addEventListener("keydown", (event) => {
      const up = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (!up) return;
      event.preventDefault();
      this.gesture += 1;
      set(+(this.head.ways[way][k] + up * (event.shiftKey ? 10 : 1) * step()).toPrecision(4));
    });
    knot.addEventListener("dblclick", () => {
      this.gesture += 1;
      set((this.head.base[way] ?? this.head.base.in)[k]);
    });
    return knot;
  }
}

// An axis from zero around the forces, with room to drag beyond them.
function axisOf(forces) {
  const low = Math.min(0, ...forces), high = Math.max(0, ...forces), room = 0.15 * (high - low) || 1;
  return { low: low < 0 ? low - room : 0, high: high + room };
}
