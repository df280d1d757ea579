// Tables: the numbers of a design, their spread, and what a small error does.

import { byId, make, shown } from "./dom.js";

export function numbers(analysis, pinned) {
  const printed = analysis.numbers.some((n) => n.printed);
  const head = make("tr", {}, make("th", {}, ""), make("th", {}, "this"), ...(pinned ? [make("th", {}, "compared")] : []), make("th", {}, ""), ...(printed ? [make("th", {}, "printed")] : []));
  const rows = analysis.numbers.map((n) => {
    const other = pinned?.numbers.find((p) => p.name === n.name);
    return make("tr", { "data-number": n.name }, make("td", {}, n.text), make("td", { class: "value" }, shown(n.value)), ...(pinned ? [make("td", {}, shown(other?.value))] : []), make("td", { class: "unit" }, n.unit), ...(printed ? [make("td", { class: "printed" }, n.printed)] : []));
  });
  byId("numbers").tBodies[0]?.remove();
  byId("numbers").append(make("tbody", {}, head, ...rows));
}

export function notes(analysis) {
  const crossed = analysis.clashes.map(([a, b, from, to]) => make("p", { class: "clash" }, `${a} and ${b} cross from ${shown(from, 4)} to ${shown(to, 4)} deg: they need planes of their own.`));
  byId("notes").replaceChildren(...analysis.notes.map((note) => make("p", {}, note)), ...crossed);
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
