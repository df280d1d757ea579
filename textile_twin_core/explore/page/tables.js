// Tables: the numbers of a design, their spread, and what a small error does.

import { byId, make, put, shown } from "./dom.js";

// Rows stay as long as the numbers are the same ones; a slider changes their values alone.
export function numbers(analysis, pinned) {
  const printed = analysis.numbers.some((n) => n.printed), table = byId("numbers");
  const key = [Boolean(pinned), printed, ...analysis.numbers.map((n) => n.name)].join();
  if (key !== table.dataset.key) {
    const head = make("tr", {}, make("th", {}, ""), make("th", {}, "this"), ...(pinned ? [make("th", {}, "compared")] : []), make("th", {}, ""), ...(printed ? [make("th", {}, "printed")] : []));
    const rows = analysis.numbers.map((n) => make("tr", { "data-number": n.name }, make("td", {}, n.text), make("td", { class: "value" }), ...(pinned ? [make("td", { class: "other" })] : []), make("td", { class: "unit" }, n.unit), ...(printed ? [make("td", { class: "printed" }, n.printed)] : [])));
    table.tBodies[0]?.remove();
    table.append(make("tbody", {}, head, ...rows));
    table.dataset.key = key;
  }
  analysis.numbers.forEach((n, k) => {
    const row = table.tBodies[0].rows[k + 1];
    put(row.cells[1], "", shown(n.value));
    if (pinned) put(row.cells[2], "", shown(pinned.numbers.find((p) => p.name === n.name)?.value));
  });
}

export function notes(analysis) {
  const crossed = analysis.clashes.map(([a, b, from, to]) => `${a} and ${b} cross from ${shown(from, 4)} to ${shown(to, 4)} deg: they need planes of their own.`);
  const box = byId("notes"), key = JSON.stringify([analysis.notes, crossed]);
  if (key === box.dataset.key) return;
  box.dataset.key = key;
  box.replaceChildren(...analysis.notes.map((note) => make("p", {}, note)), ...crossed.map((text) => make("p", { class: "clash" }, text)));
}

export function spread(head) {
  const row = (cells, tag = "td") => make("tr", {}, ...cells.map((cell) => make(tag, {}, cell)));
  const limits = head.limits.map((k) => `${k.text}: ${shown(100 * k.scrap, 3)} %`).join(", ");
  const says = head.limits.length ? `Scrap rate ${shown(100 * head.scrap, 3)} % of ${head.samples} (${limits}).` : `Without limits nothing is scrap but what cannot close: ${shown(100 * head.scrap, 3)} % of ${head.samples}.`;
  byId("spread").replaceChildren(make("p", { id: "scrap" }, says), make("table", {},
    make("thead", {}, row(["", "nominal", "mean", "sigma", "0.5 %", "99.5 %", "worst from", "worst to", ""], "th")),
    make("tbody", {}, ...head.rows.map((r) => row([r.text, ...["nominal", "mean", "sigma", "low", "high", "worst_low", "worst_high"].map((k) => shown(r[k])), r.unit])))));
}

export function sensitivities(head) {
  const row = (cells, tag = "td") => make("tr", {}, ...cells.map((cell) => make(tag, {}, cell)));
  byId("spread").replaceChildren(make("p", {}, "What a small error of one parameter changes:"), make("table", {},
    make("thead", {}, row(["", "by", ...head.numbers.map((n) => `${n.text}${n.unit ? `, ${n.unit.replaceAll(" ", "\u00a0")}` : ""}`)], "th")),
    make("tbody", {}, ...head.rows.map((r) => row([r.text, r.step, ...r.changes.map((v) => shown(v, 3))])))));
}
