// The review: the list, the chosen finding, and the keys. Texts of the run only ever become
// text of elements (textContent); nothing of them is read as HTML.

import { MapView } from "./map.js";
import { decide, evidenceOf, historyOf, mapLines, newState } from "./server.js";

const POLL_MS = 2000;
const at = (id) => document.getElementById(id);
const findings = JSON.parse(at("findings").textContent);
const byId = new Map(findings.map((finding, index) => [finding.id, index]));
const rows = [...(at("rows")?.children ?? [])];
const undone = []; // states before the decisions of this tab, the last one at the end
let order = findings.map((_, index) => index); // what the filter shows
let chosen = -1;
let seen = Number(document.querySelector("main").dataset.revision);
let map = null;

// The token stands in a cookie now: it need not be in the address, its history, or on a screen.
history.replaceState(null, "", location.pathname + location.hash);

/* ---- comments that are not saved yet outlive a reload and a lost server */

const draftOf = (id) => sessionStorage.getItem(`draft ${id}`);
const keepDraft = (id, text) => sessionStorage.setItem(`draft ${id}`, text);
const dropDraft = (id) => sessionStorage.removeItem(`draft ${id}`);

/* ---- what is shown */

function say(text, mood = "") {
  at("saved").textContent = text;
  at("saved").className = `saved ${mood}`;
}

function complain(text) {
  at("trouble").textContent = text;
  at("trouble").hidden = !text;
}

function showProgress() {
  const decided = findings.filter((finding) => finding.status !== "open").length;
  at("progress").value = decided;
  document.querySelector(".progress").setAttribute("aria-valuenow", decided);
  const shown = order.length === findings.length ? "" : ` · ${order.length} shown`;
  at("count").textContent = findings.length ? `${decided} of ${findings.length} decided${shown}` : "no findings";
}

function showRow(index) {
  rows[index].dataset.status = findings[index].status;
  rows[index].querySelector(".state").textContent = findings[index].status;
}

function element(tag, text, attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  Object.assign(made, attributes);
  return made;
}

function showFacts(finding) {
  const signed = (value, digits = 2) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
  const counted = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
  const facts = [
    ["kind", finding.name],
    ["element", finding.element === "0" ? "not in the map" : `way ${finding.element}`],
    ["along", finding.element === "0" ? null : `${finding.along.toFixed(1)} m` + (finding.length ? `, for ${finding.length.toFixed(1)} m` : "")],
    ["offset", finding.offset === null ? null : `${signed(finding.offset)} m` + (finding.sd === null ? "" : ` ± ${finding.sd.toFixed(2)}`)],
    ["seen", `${counted(finding.observations, "look")} in ${counted(finding.visits, "visit")}`],
    ["confidence", `${(100 * finding.confidence).toFixed(0)} %`],
    ["map x, y", finding.x === null ? null : `${finding.x.toFixed(2)}, ${finding.y.toFixed(2)}`],
    ["lat, lon", finding.latitude === null ? null : `${finding.latitude.toFixed(7)}, ${finding.longitude.toFixed(7)}`],
    ["best look", finding.drive < 0 ? null : `drive ${finding.drive}, ${finding.sensor}`],
    ["log time", finding.time || null],
    ["id", finding.id],
  ];
  const parts = facts.filter(([, value]) => value !== null).flatMap(([name, value]) => [element("dt", name), element("dd", value)]);
  at("facts").replaceChildren(...parts);
}

function showState(finding) {
  at("badge").textContent = finding.status;
  at("badge").dataset.status = finding.status;
  for (const button of document.querySelectorAll("[data-decide]")) {
    button.classList.toggle("on", button.dataset.decide === finding.status);
  }
  const draft = draftOf(finding.id);
  if (at("comment").value !== (draft ?? finding.comment)) at("comment").value = draft ?? finding.comment;
  at("draft").hidden = draft === null;
}

async function showHistory(finding) {
  const answer = await historyOf(finding.id);
  if (findings[chosen] !== finding || !answer.entries) return;
  const items = answer.entries.reverse().map((entry) => {
    const item = document.createElement("li");
    item.dataset.status = entry.status;
    const when = element("time", ` ${new Date(entry.decided_at).toLocaleString()} `, { dateTime: entry.decided_at });
    item.append(element("b", entry.status), when, element("span", entry.comment));
    return item;
  });
  at("history").replaceChildren(...items);
  at("history-head").hidden = !items.length;
}

function showEvidence(finding) {
  at("evidence").hidden = !finding.evidence;
  at("no-evidence").hidden = finding.evidence;
  at("evidence").alt = finding.evidence ? `Camera and road from above: ${finding.claim}` : "";
  if (finding.evidence) at("evidence").src = evidenceOf(finding.id);
  else at("evidence").removeAttribute("src");
}

function choose(index) {
  if (index === undefined || index < 0) return;
  if (chosen >= 0) rows[chosen].setAttribute("aria-selected", "false");
  chosen = index;
  const finding = findings[index];
  rows[index].setAttribute("aria-selected", "true");
  rows[index].scrollIntoView({ block: "nearest" });
  at("rows").setAttribute("aria-activedescendant", rows[index].id);
  history.replaceState(null, "", `#${encodeURIComponent(finding.id)}`);
  at("name").textContent = finding.name;
  at("claim").textContent = finding.claim;
  showState(finding);
  showFacts(finding);
  showEvidence(finding);
  at("history").replaceChildren();
  at("history-head").hidden = true;
  showHistory(finding);
  map.choose(finding);
  const next = findings[order[order.indexOf(index) + 1]];
  if (next?.evidence) new Image().src = evidenceOf(next.id); // so that it is there at once
}

function filter() {
  const [words, kind, status] = ["text", "kind", "status"].map((id) => at(id).value);
  const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
  order = [];
  findings.forEach((finding, index) => {
    const text = `${finding.claim} ${finding.name} ${finding.comment} ${finding.id}`.toLowerCase();
    const fits = (!kind || finding.kind === kind) && (!status || finding.status === status) && wanted.every((word) => text.includes(word));
    rows[index].hidden = finding.hidden = !fits;
    if (fits) order.push(index);
  });
  at("none").hidden = order.length > 0;
  showProgress();
  map.redraw();
}

/* ---- decisions, one after another, each shown as saved when the server has it on its disk */

let queue = Promise.resolve();
let round = 0; // a decision that fails takes with it the keys that were pressed after it

function enqueue(action) {
  const mine = round;
  queue = queue.then(() => (mine === round ? action() : undefined));
  return queue;
}

function take(entry) {
  const index = byId.get(entry.id);
  if (index === undefined || entry.revision <= findings[index].revision) return false;
  Object.assign(findings[index], { status: entry.status, comment: entry.comment, revision: entry.revision });
  showRow(index);
  if (index === chosen) {
    showState(findings[index]);
    showHistory(findings[index]);
  }
  return true;
}

async function save(finding, status, comment) {
  say("saving …");
  const answer = await decide(finding.id, status, comment, finding.revision);
  if (answer.status === 200) {
    complain("");
    if (draftOf(finding.id) === comment) dropDraft(finding.id);
    take(answer.entry);
    say(`saved: ${status}`, "good");
    return true;
  }
  round += 1;
  say("not saved", "bad");
  if (answer.lost) complain("No connection: this was not saved. Is `percept map review` still running? Comments are kept on this page.");
  else if (answer.status === 409) {
    if (answer.entry) take(answer.entry);
    complain("Not saved: this finding was decided in another tab meanwhile. What counts is shown now; decide again to change it.");
  } else complain(`Not saved: ${answer.error}`);
  return false;
}

function nextOpen(from) {
  const start = order.indexOf(from);
  const turned = [...order.slice(start + 1), ...order.slice(0, start + 1)];
  return turned.find((index) => findings[index].status === "open");
}

const settle = (status) =>
  enqueue(async () => {
    const finding = findings[chosen];
    if (!finding) return;
    const index = chosen;
    const before = { id: finding.id, status: finding.status, comment: finding.comment };
    if (!(await save(finding, status, draftOf(finding.id) ?? finding.comment))) return;
    undone.push(before);
    const next = status === "open" ? index : nextOpen(index);
    filter();
    if (chosen === index) choose(next ?? index);
    if (next === undefined) say("saved: all that is shown is decided", "good");
  });

const saveComment = () =>
  enqueue(async () => {
    const finding = findings[chosen];
    const comment = draftOf(finding.id);
    if (comment === null) return at("comment").blur();
    const before = { id: finding.id, status: finding.status, comment: finding.comment };
    if (!(await save(finding, finding.status, comment))) return undefined;
    undone.push(before);
    say("saved: comment", "good");
    return at("comment").blur();
  });

const undo = () =>
  enqueue(async () => {
    const before = undone.at(-1);
    if (!before) return say("nothing to undo in this tab");
    const index = byId.get(before.id);
    if (!(await save(findings[index], before.status, before.comment))) return undefined;
    undone.pop();
    filter();
    choose(index);
    return say(`saved: undone, ${before.status}`, "good");
  });

async function poll() {
  const answer = await newState(seen);
  if (answer.lost || !answer.entries) {
    return complain(answer.lost ? "No connection to `percept map review`. What was saved is safe; start it again to go on." : answer.error);
  }
  if (at("trouble").textContent.startsWith("No connection to")) complain("");
  let changed = false;
  for (const entry of answer.entries) {
    seen = Math.max(seen, entry.revision);
    changed = take(entry) || changed;
  }
  if (!changed) return undefined;
  say("changed in another tab");
  return filter();
}

/* ---- keys and buttons */

function step(by) {
  const place = order.indexOf(chosen);
  if (order.length) choose(order[Math.min(Math.max(place + by, 0), order.length - 1)]);
}

function toggleLayer(number) {
  document.querySelectorAll("[data-layer]")[number - 1].click();
}

const enlarge = () => findings[chosen].evidence && document.querySelector(".evidence").classList.toggle("large");

const KEYS = {
  j: () => step(1), k: () => step(-1),
  c: () => settle("confirmed"), r: () => settle("rejected"), u: () => settle("unsure"), o: () => settle("open"),
  z: undo, m: () => at("comment").focus(), Enter: () => at("comment").focus(), "/": () => at("text").focus(), e: enlarge,
  "+": () => map.zoom(1.4), "=": () => map.zoom(1.4), "-": () => map.zoom(1 / 1.4),
  ArrowLeft: () => map.pan(-1, 0), ArrowRight: () => map.pan(1, 0), ArrowUp: () => map.pan(0, 1), ArrowDown: () => map.pan(0, -1),
  f: () => map.showFinding(), 0: () => map.showAll(),
  Escape: () => document.querySelector(".evidence").classList.remove("large"),
  ...Object.fromEntries([1, 2, 3, 4, 5].map((number) => [number, () => toggleLayer(number)])),
};

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || at("help").open) return;
  const { target } = event;
  if (target.matches("textarea, select, input:not([type=checkbox])")) {
    if (event.key === "Escape") target.blur();
    return;
  }
  if (event.key === "Enter" && target.matches("button, input")) return;
  if (event.repeat && "cruoz".includes(event.key)) return; // a held key decides once
  const inList = { ArrowUp: () => step(-1), ArrowDown: () => step(1) };
  const action = event.key === "?" ? () => at("help").showModal() : (target === at("rows") && inList[event.key]) || (findings.length && KEYS[event.key]);
  if (!action) return;
  event.preventDefault();
  action();
}

function onComment(event) {
  if (event.key !== "Enter" || event.shiftKey || event.isComposing) return;
  event.preventDefault();
  saveComment();
}

function listen() {
  document.addEventListener("keydown", onKey);
  at("help-button").addEventListener("click", () => at("help").showModal());
  at("help-close").addEventListener("click", () => at("help").close());
  if (!findings.length) return;
  at("rows").addEventListener("click", (event) => choose(rows.indexOf(event.target.closest("li"))));
  for (const id of ["text", "kind", "status"]) {
    at(id).addEventListener("input", () => {
      filter();
      if (!order.includes(chosen)) choose(order[0]);
    });
  }
  for (const id of ["kind", "status"]) at(id).addEventListener("change", () => at(id).blur());
  at("text").addEventListener("keydown", (event) => event.key === "Enter" && at("text").blur());
  at("comment").addEventListener("keydown", onComment);
  at("comment").addEventListener("input", () => {
    const finding = findings[chosen];
    if (at("comment").value === finding.comment) dropDraft(finding.id);
    else keepDraft(finding.id, at("comment").value);
    at("draft").hidden = draftOf(finding.id) === null;
  });
  at("evidence").addEventListener("click", enlarge);
  at("evidence").addEventListener("error", () => {
    at("evidence").hidden = true;
    at("no-evidence").hidden = false;
  });
  for (const button of document.querySelectorAll("[data-decide]")) button.addEventListener("click", () => settle(button.dataset.decide));
  for (const box of document.querySelectorAll("[data-layer]")) box.addEventListener("change", () => map.toggle(box.dataset.layer, box.checked));
  const zooms = { in: () => map.zoom(1.4), out: () => map.zoom(1 / 1.4), finding: () => map.showFinding(), all: () => map.showAll() };
  for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => zooms[button.dataset.zoom]());
  window.addEventListener("focus", poll);
  setInterval(() => document.visibilityState === "visible" && poll(), POLL_MS);
}

/* ---- the map's surroundings */

function showScale(scale) {
  const power = 10 ** Math.floor(Math.log10(130 / scale));
  const length = [5, 2, 1].map((factor) => factor * power).find((metres) => metres * scale <= 130) ?? power;
  at("scale-bar").style.width = `${length * scale}px`;
  at("scale-text").textContent = length >= 1000 ? `${length / 1000} km` : `${length} m`;
}

function hover(px, py) {
  const finding = px === null ? null : map.nearest(px, py);
  const line = px === null || finding ? null : map.lineAt(px, py);
  const text = finding?.claim ?? (line && `${line.name} · ${line.kind.replaceAll("_", " ")} · ${line.painted ? `${line.type} ${line.colour}` : "not painted"}`);
  at("tip").hidden = !text;
  map.canvas.style.cursor = finding ? "pointer" : "";
  if (!text) return;
  at("tip").textContent = text;
  at("tip").style.left = `${Math.min(px + 14, map.size[0] - 200)}px`;
  at("tip").style.top = `${Math.min(py + 12, map.size[1] - 40)}px`;
}

async function loadMap() {
  const answer = await mapLines();
  if (!answer.lines) return complain("The map could not be loaded; load the page again.");
  map.load(answer.lines, answer.paths);
  return chosen >= 0 && map.showFinding();
}

listen();
showProgress();
if (findings.length) {
  map = new MapView(at("map"), { onPick: (finding) => choose(byId.get(finding.id)), onScale: showScale, onHover: hover });
  map.findings = findings;
  filter();
  const linked = byId.get(decodeURIComponent(location.hash.slice(1)));
  choose(linked ?? nextOpen(-1) ?? 0);
  loadMap();
}
