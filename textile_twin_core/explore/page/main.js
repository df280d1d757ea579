// The page: what comes from the server is shown, what the person does is sent.

import { Charts } from "./charts.js";
import { byId, make, numberIn, put, shown } from "./dom.js";
import { Forces } from "./forces.js";
import { Linkage } from "./linkage.js";
import { Parameters } from "./parameters.js";
import { Search } from "./search.js";
import * as tables from "./tables.js";
import { Talk } from "./talk.js";

let angle = 0, playing = false, design = null, compiling = null;

const linkage = new Linkage(byId("linkage"), (turned) => turnTo(turned));
const charts = new Charts(byId("charts"), (turned) => turnTo(turned));
const parameters = new Parameters(byId("parameters"), {
  onChange: (values, problem, gesture) => (values ? talk.sendNewest({ type: "change", values, gesture }) : banner(problem)),
  onFree: () => search.free(),
});
const forces = new Forces(byId("forces"), (name, ways, gesture) => talk.sendNewest({ type: "curve", name, ways, gesture }));
const search = new Search({ parameters, send: (message) => talk.send(message), say: (text) => { byId("search_says").textContent = text; } });
const talk = new Talk({
  onMessage: receive,
  onOpen: () => banner(""),
  onBroken: (times) => banner(times < 8 ? "The connection is lost; trying again .." : "textile-twin explore has ended. Start it again and open the address that it prints."),
});

function receive(head, floats) {
  switch (head.type) {
    case "state": return state(head, floats);
    case "front": return search.found(head);
    case "tolerances": banner(""); return tables.spread(head);
    case "sensitivities": banner(""); return tables.sensitivities(head);
    case "error":
      search.failed();
      return banner(head.text);
  }
}

function state(head, floats) {
  const begun = performance.now();
  const analysis = head.analysis && opened(head.analysis, floats), pinned = head.pinned && opened(head.pinned, floats);
  const recording = head.recording && { theta: floats(head.recording.theta), torque: floats(head.recording.torque) };
  design = head.design;
  banner(head.said, true);
  compiling = head.compiling_s === null ? null : performance.now() - 1000 * head.compiling_s;
  menu(head);
  parameters.show(design);
  byId("problem").hidden = !head.problem;
  byId("problem").textContent = head.problem;
  byId("linkage").classList.toggle("stale", !analysis);
  charts.stale(!analysis);
  if (analysis) {
    linkage.show(analysis, pinned);
    charts.show(analysis, pinned, recording);
    forces.show(head.curves.map((c) => ({ ...c, place: c.place && floats(c.place) })));
    tables.numbers(analysis, pinned);
    tables.notes(analysis);
    search.show(analysis, design, head.task);
    links(analysis);
  }
  document.body.dataset.drawn = (performance.now() - begun).toFixed(1);
  requestAnimationFrame(() => {
    document.body.dataset.took = head.took_ms.toFixed(1);
    document.body.dataset.states = +(document.body.dataset.states ?? 0) + 1;
  });
}

// The arrays of an analysis in their places.
function opened(analysis, floats) {
  const points = Object.fromEntries(Object.entries(analysis.points).map(([name, [x, y]]) => [name, [floats(x), floats(y)]]));
  const opened = analysis.charts.map((c) => ({ ...c, curves: Object.fromEntries(Object.entries(c.curves).map(([n, p]) => [n, floats(p)])) }));
  return { ...analysis, points, charts: opened };
}

function menu(head) {
  const select = byId("machine"), names = head.machines.includes(design.name) ? head.machines : [design.name, ...head.machines];
  if (select.dataset.names !== names.join()) select.replaceChildren(...names.map((name) => make("option", { value: name }, name.replaceAll("_", " "))));
  select.dataset.names = names.join();
  select.value = design.name;
  byId("rpm").disabled = design.rpm === null;
  if (document.activeElement !== byId("rpm")) byId("rpm").value = design.rpm === null ? "" : shown(design.rpm, 4);
  if (document.activeElement !== byId("dwell")) byId("dwell").value = design.dwell_mm ?? "";
  byId("undo").disabled = !head.can_undo;
  byId("redo").disabled = !head.can_redo;
  byId("pin").setAttribute("aria-pressed", String(Boolean(head.pinned)));
  byId("balance_says").textContent = head.said || "Each takes the design as it is now, which stays to compare with; undo takes it back.";
  document.title = `${design.name.replaceAll("_", " ")} – textile-twin`;
}

function links(analysis) {
  const select = byId("coupler_link"), names = analysis.bars.map((bar) => bar[0]);
  if (names.join() === select.dataset.names) return;
  select.dataset.names = names.join();
  select.replaceChildren(...names.map((name) => make("option", { value: name, selected: name === "l2" }, name)));
}

function banner(text, good = false) {
  const bar = byId("banner");
  bar.hidden = !text;
  bar.textContent = text ?? "";
  bar.classList.toggle("good", good);
}

function turnTo(turned) {
  angle = ((turned % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI);
  const degrees = (angle * 180) / Math.PI;
  linkage.turn(angle);
  charts.turn(angle);
  forces.turn(angle);
  byId("angle").value = degrees;
  byId("angle_shown").textContent = `${degrees.toFixed(1)} deg`;
  put(byId("linkage"), "aria-valuenow", degrees.toFixed(1));
}

function play(on) {
  playing = on;
  byId("play").setAttribute("aria-pressed", String(on));
  byId("play").textContent = on ? "Pause" : "Play";
  let before = performance.now();
  const step = (now) => {
    if (!playing) return;
    turnTo(angle + ((now - before) / 1000) * 2 * Math.PI * 0.25);
    before = now;
    requestAnimationFrame(step);
  };
  if (on) requestAnimationFrame(step);
}

function coupler() {
  linkage.coupler = { link: byId("coupler_link").value, along: numberIn(byId("coupler_along")) ?? 0, across: numberIn(byId("coupler_across")) ?? 0 };
  linkage.draw();
}

setInterval(() => {
  if (compiling) banner(`The loops of machines with impacts are being compiled, once on this computer: ${Math.round((performance.now() - compiling) / 1000)} s so far, a minute or two in all. It is shown when they are there; all else goes on.`, true);
  else if (talk.patience > 700) banner("Working ..", true);
}, 300);
turnTo(0);
byId("play").onclick = () => play(!playing);
byId("angle").oninput = (event) => turnTo((event.target.valueAsNumber * Math.PI) / 180);
for (const id of ["coupler_link", "coupler_along", "coupler_across"]) byId(id).oninput = coupler;
byId("machine").onchange = (event) => talk.send({ type: "machine", name: event.target.value });
byId("rpm").onchange = (event) => {
  const rpm = numberIn(event.target);
  if (rpm === null) banner("Speed: this is no number");
  else talk.sendNewest({ type: "speed", rpm });
};
byId("dwell").onchange = (event) => {
  const mm = numberIn(event.target, { empty: true });
  if (event.target.getAttribute("aria-invalid") === "true") banner("Dwell within: this is no number");
  else talk.sendNewest({ type: "dwell", mm });
};
for (const type of ["undo", "redo", "reset"]) byId(type).onclick = () => talk.send({ type });
byId("pin").onclick = () => talk.send({ type: "pin", on: byId("pin").getAttribute("aria-pressed") !== "true" });
byId("load").onclick = () => byId("loaded").click();
byId("loaded").onchange = async (event) => {
  const file = event.target.files[0];
  if (file) talk.send({ type: "load", name: file.name, text: await file.text() });
  event.target.value = "";
  byId("load").closest("details").open = false;
};
document.querySelector(".menu").addEventListener("toggle", (event) => {
  const list = event.target.querySelector("div");
  list.style.left = "0";
  const box = list.getBoundingClientRect(), edge = document.documentElement.clientWidth - 8;
  list.style.left = `${Math.max(8 - box.left, Math.min(0, edge - box.right))}px`; // all of it stays on the screen
});
for (const link of document.querySelectorAll("[data-file]")) {
  link.href = "#";
  link.onclick = (event) => {
    event.preventDefault();
    link.closest("details").open = false;
    download(link.dataset.file);
  };
}
for (const button of document.querySelectorAll("[data-balance]")) {
  button.onclick = () => talk.send({ type: "balance", way: button.dataset.balance, ripple: (numberIn(byId("ripple")) ?? 2) / 100 });
}
byId("tolerate").onclick = () => talk.send({ type: "tolerance", ...search.task, width: numberIn(byId("width")) });
byId("sense").onclick = () => talk.send({ type: "sensitivity", ...search.task });
byId("theme").onclick = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
for (const tab of document.querySelectorAll("[role=tab]")) {
  tab.onclick = () => {
    for (const other of document.querySelectorAll("[role=tab]")) {
      other.setAttribute("aria-selected", String(other === tab));
      byId(other.getAttribute("aria-controls")).hidden = other !== tab;
    }
  };
}
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input[type=number], select");
  if ((event.ctrlKey || event.metaKey) && !typing && ["z", "y"].includes(event.key.toLowerCase())) {
    event.preventDefault();
    talk.send({ type: event.key.toLowerCase() === "y" || event.shiftKey ? "redo" : "undo" });
  }
  if (event.target.id !== "linkage") return;
  const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };
  if (event.key in steps) turnTo(angle + (steps[event.key] * (event.shiftKey ? 10 : 1) * Math.PI) / 180);
  else if (event.key === " ") play(!playing);
  else return;
  event.preventDefault();
});

async function download(kind) {
  const answer = await fetch(`/file/${kind}?tab=${talk.tab}&angle=${angle}`);
  if (!answer.ok) { banner(await answer.text()); return; }
  const name = /filename="(.*)"/.exec(answer.headers.get("Content-Disposition"))[1];
  const link = make("a", { href: URL.createObjectURL(await answer.blob()), download: name });
  link.click();
  URL.revokeObjectURL(link.href);
}

function theme(chosen) {
  document.documentElement.dataset.theme = chosen;
  localStorage.setItem("theme", chosen);
}
theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
