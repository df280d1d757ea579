// Curves over the shaft angle, with marks, a cursor at the angle shown, a second design dashed, and a recording.

import { Chart, labels } from "./chart.js";

export class Charts {
  constructor(box, onTurn) {
    Object.assign(this, { box, onTurn, angle: 0, charts: [], width: 0 });
    new ResizeObserver(([entry]) => {
      const width = Math.max(240, Math.floor(entry.contentRect.width));
      if (width === this.width) return;
      this.width = width;
      if (this.analysis) this.show(this.analysis, this.pinned, this.recording);
    }).observe(box);
  }

  show(analysis, pinned, recording) {
    Object.assign(this, { analysis, pinned, recording });
    this.width ||= Math.max(240, this.box.clientWidth - 20);
    const key = JSON.stringify(analysis.charts.map((c) => [c.title, c.unit, Object.keys(c.curves)]));
    if (key !== this.key) {
      this.key = key;
      this.charts = analysis.charts.map((c) => new Chart(c.title, Object.keys(c.curves), this.onTurn));
      this.box.replaceChildren(...this.charts.map((chart) => chart.svg));
    }
    analysis.charts.forEach((chart, k) => {
      const other = pinned?.charts.find((c) => c.title === chart.title), measured = chart.title.startsWith("Torque") ? recording : null;
      const named = k === 0 ? labels(analysis, this.width) : []; // the first chart names the marks of all
      this.charts[k].show(chart, other, measured, analysis, this.width, named);
      this.charts[k].turn(this.angle);
    });
  }

  stale(on) {
    for (const { svg } of this.charts) svg.classList.toggle("stale", on);
  }

  turn(angle) {
    this.angle = angle;
    for (const chart of this.charts) chart.turn(angle);
  }
}
