// Goals, limits and ranges of the search, and the front of designs that it finds.

import { apart, byId, draw, make, numberIn, shown, ticks } from "./dom.js";

export class Search {
  constructor({ parameters, send, say }) {
    Object.assign(this, { parameters, send, say, numbers: [], goals: [], limits: [], ranges: new Map() });
    byId("add_goal").onclick = () => { this.goals.push({ number: this.numbers[0]?.name, sense: "min" }); this.#rows(); };
    byId("add_limit").onclick = () => { this.limits.push({ number: this.numbers[0]?.name, sense: ">=", value: 0 }); this.#rows(); };
    byId("start").onclick = () => this.start();
    byId("stop").onclick = () => send({ type: "stop" });
  }

  // A machine's numbers have come; its first goals are a long dwell and a small acceleration, at its stroke.
  show(analysis, design, task) {
    const names = analysis.numbers.map((n) => n.name).join();
    this.numbers = analysis.numbers;
    if (names === this.names && design.name === this.name && !task) return;
    this.names = names;
    this.name = design.name;
    const known = (entry) => this.numbers.some((n) => n.name === entry.number);
    this.goals = (task?.goals ?? []).filter(known);
    this.limits = (task?.limits ?? []).filter(known);
    if (task?.seed) byId("seed").value = task.seed;
    if (task?.free && Object.keys(task.free).length) {
      this.ranges = new Map(Object.entries(task.free));
      this.parameters.setFree(Object.keys(task.free));
    } else this.ranges.clear();
    if (!this.goals.length) {
      const dwell = this.numbers.find((n) => n.name.endsWith("dwell_rad")), fast = this.numbers.find((n) => n.name.endsWith("largest_acceleration_m_s2"));
      if (dwell) this.goals.push({ number: dwell.name, sense: "max" });
      if (fast) this.goals.push({ number: fast.name, sense: "min" });
      if (!this.goals.length && this.numbers.length) this.goals.push({ number: this.numbers[0].name, sense: "max" });
      const angle = this.numbers.find((n) => n.name === "smallest_transmission_angle_rad");
      if (angle) this.limits.push({ number: angle.name, sense: ">=", value: 50 });
      const stroke = this.numbers.find((n) => n.name.endsWith("stroke_m"));
      if (stroke) this.limits.push({ number: stroke.name, sense: ">=", value: +(0.999 * stroke.value).toPrecision(4) });
    }
    this.#rows();
    this.free();
    byId("front").replaceChildren();
  }

  #rows() {
    byId("goals").replaceChildren(...this.goals.map((goal, k) => make("div", { class: "row" },
      this.#select(goal, "sense", [["max", "as large"], ["min", "as small"]]), this.#number(goal), this.#remove(this.goals, k))));
    byId("limits").replaceChildren(...this.limits.map((limit, k) => {
      const unit = make("span", { class: "unit" }, this.#unit(limit.number));
      const value = make("input", { type: "number", step: "any", value: limit.value, "aria-label": "limit", onchange: () => { limit.value = numberIn(value); } });
      return make("div", { class: "row" }, this.#number(limit, () => { unit.textContent = this.#unit(limit.number); }),
        this.#select(limit, "sense", [[">=", "at least"], ["<=", "at most"]]), value, unit, this.#remove(this.limits, k));
    }));
  }

  #unit(number) {
    return this.numbers.find((n) => n.name === number)?.unit ?? "";
  }

  #number(entry, then = () => {}) {
    return this.#select(entry, "number", this.numbers.map((n) => [n.name, n.text]), then);
  }

  #select(entry, key, options, then = () => {}) {
    const select = make("select", { "aria-label": key, onchange: () => { entry[key] = select.value; then(); } },
      ...options.map(([value, text]) => make("option", { value, selected: value === entry[key] }, text)));
    return select;
  }

  #remove(list, k) {
    return make("button", { title: "Take away", "aria-label": "take away", onclick: () => { list.splice(k, 1); this.#rows(); } }, "×");
  }

  // Rows of ranges for what is ticked.
  free() {
    const rows = this.parameters.free.map((p) => {
      if (!this.ranges.has(p.name)) this.ranges.set(p.name, range(p));
      const ends = this.ranges.get(p.name);
      const field = (k) => {
        const input = make("input", { type: "number", step: "any", value: ends[k], "aria-label": `${p.text}, ${k ? "largest" : "smallest"}`, onchange: () => { ends[k] = numberIn(input); } });
        return input;
      };
      return make("div", { class: "row" }, make("span", { style: "min-width: 8rem" }, p.text), field(0), "to", field(1), make("span", { class: "unit" }, p.unit));
    });
    byId("ranges").replaceChildren(...rows);
  }

  get task() {
    const free = Object.fromEntries(this.parameters.free.map((p) => [p.name, this.ranges.get(p.name)]));
    return { free, goals: this.goals, limits: this.limits, seed: numberIn(byId("seed")) ?? 0 };
  }

  start() {
    this.#running(true);
    byId("share").value = 0;
    this.say("Searching ..");
    this.send({ type: "search", ...this.task, seconds: numberIn(byId("seconds")) ?? 60 });
  }

  #running(on) {
    byId("start").disabled = on;
    byId("stop").disabled = !on;
  }

  failed() {
    this.#running(false);
  }

  found(head) {
    this.#running(head.running);
    byId("share").value = head.running ? head.share : 1;
    const rate = `${shown(head.designs, 6)} designs looked at, ${shown(Math.round(head.per_second), 5)} a second`;
    const ended = head.running ? "" : `; done in ${shown(head.took, 3)} s${head.complete ? "" : ", before its last generation: given more time, the same seed finds more"}`;
    this.say(head.front.length ? `${rate}${ended}: ${head.front.length} of which none is better in all goals.` : `${rate}${ended}: none keeps the limits${head.running ? " yet" : ""}${head.failing ? `: ${head.failing}` : ""}.`);
    this.#front(head);
  }

  #front(head) {
    const svg = byId("front"), width = Math.max(280, svg.clientWidth), height = 320, two = this.goals.length > 1;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (!head.front.length) { svg.replaceChildren(); return; }
    const column = (k) => head.front.map((row) => row[k]);
    const xs = column(0), ys = two ? column(1) : xs.map((_, k) => k), parts = [];
    const across = axis(xs), up = axis(ys);
    const x = (v) => 58 + (width - 74) * across.at(v), y = (v) => height - 38 - (height - 54) * up.at(v);
    const acrossTexts = apart(across.marks), upTexts = apart(up.marks);
    for (const [k, v] of across.marks.entries()) parts.push(draw("line", { x1: x(v), x2: x(v), y1: 12, y2: height - 38, stroke: "var(--line)" }), draw("text", { x: x(v), y: height - 22, "text-anchor": "middle" }, acrossTexts[k]));
    if (two) for (const [k, v] of up.marks.entries()) parts.push(draw("line", { x1: 58, x2: width - 16, y1: y(v), y2: y(v), stroke: "var(--line)" }), draw("text", { x: 52, y: y(v) + 4, "text-anchor": "end" }, upTexts[k]));
    const words = (n) => `${n.text}${n.unit ? `, ${n.unit}` : ""}`;
    parts.push(draw("text", { x: width - 16, y: height - 6, "text-anchor": "end" }, words(head.numbers[0])));
    if (two) parts.push(draw("text", { x: 6, y: 10 }, words(head.numbers[1])));
    head.front.forEach((row, k) => {
      const says = head.numbers.map((n, i) => `${n.text} ${shown(row[i], 5)} ${n.unit}`).join(", ");
      const pick = () => {
        if (head.running) return;
        svg.querySelector(".chosen")?.classList.remove("chosen");
        dot.classList.add("chosen");
        this.send({ type: "pick", index: k });
      };
      const dot = draw("circle", { cx: x(row[0]), cy: y(two ? row[1] : k), r: 4, tabindex: head.running ? -1 : 0, role: "button", "aria-label": says, onclick: pick, onkeydown: (event) => { if (event.key === "Enter") pick(); } }, draw("title", {}, says));
      parts.push(dot);
    });
    svg.replaceChildren(...parts);
  }
}

// What is proposed: a fifth of the value either way, 20 degrees for angles.
function range(p) {
  const room = p.unit === "deg" ? 20 : 0.2 * Math.abs(p.value), rounded = (value) => +value.toPrecision(4);
  if (!room) return [rounded(p.low), rounded(p.high)];
  return [rounded(Math.max(p.low, p.value - room)), rounded(Math.min(p.high, p.value + room))];
}

// From values to places between 0 and 1, and round values for marks; by powers of ten where values span decades.
function axis(values) {
  const low = Math.min(...values), high = Math.max(...values);
  if (low > 0 && high > 30 * low) {
    const [a, b] = [Math.log10(low) - 0.05, Math.log10(high) + 0.05], marks = [];
    for (let k = Math.floor(a); k <= b; k++) for (const m of [1, 3]) if (Math.log10(m) + k >= a && Math.log10(m) + k <= b) marks.push(m * 10 ** k);
    return { at: (v) => (Math.log10(v) - a) / (b - a), marks };
  }
  const room = 0.06 * (high - low) || 0.05 * Math.abs(low) || 1, [a, b] = [low - room, high + room];
  return { at: (v) => (v - a) / (b - a), marks: ticks(a, b, 5) };
}
