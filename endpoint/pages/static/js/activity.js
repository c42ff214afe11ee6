// Live activity: draws what the server tells at once, but at most four times a second.

import { element } from "./dom.js";
import { followActivity } from "./stream.js";

const REDRAWS_A_SECOND = 4;
const GATHER_MS = 60; // events of one burst are drawn together, all but the first
const SPEAK_MS = 10_000;
const MAX_ROWS = 200;
const SILENT = ["frame", "answered"]; // seen on the robot's card only
const BOOKKEEPING = "wrote"; // shown when asked for
const root = document.querySelector("[data-activity]");
const rows = root.querySelector("[data-events]");
const lanes = root.querySelector("[data-lanes]");
const tools = document.querySelector("[data-tools]");
const link = tools.querySelector("[data-link]");
const pause = tools.querySelector("[data-pause]");
const who = tools.querySelector("[data-who]");
const kind = tools.querySelector("[data-kind]");
const spoken = document.querySelector("[data-spoken]");
const changed = new Map(); // robot -> its state
let waiting = []; // events that are not drawn yet, the oldest first
let drawn = new Array(REDRAWS_A_SECOND).fill(-1000); // times of the last redraws, ms
let timer = 0;
let unspoken = [];

const objectUrl = (iri) => `/object?iri=${encodeURIComponent(iri)}`;
const DAY = { day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit" };

/** Return the time of day, UTC; before today with its day, as the server writes it. */
function clock(seconds) {
  const at = new Date(seconds * 1000);
  const text = at.toISOString();
  if (text.slice(0, 10) === new Date().toISOString().slice(0, 10)) return text.slice(11, 19);
  return at.toLocaleString("en-GB", { ...DAY, timeZone: "UTC" }).replace(",", "");
}

const mark = (held) => element("span", { class: `mark ${held ? "good" : "bad"}` }, held ? "✓" : "✗");

function linked(words, iri) {
  return iri ? element("a", { href: objectUrl(iri) }, words) : words;
}

/** Return what an event says in words, and what the robot measured, which is folded away. */
function split(event) {
  const detail = event.detail ?? "";
  if (event.kind !== "outcome") return [detail, ""];
  if (!/^(attempt|choice|expected) /.test(detail)) return ["", detail];
  const end = detail.indexOf("; ");
  return end < 0 ? [detail, ""] : [detail.slice(0, end), detail.slice(end + 2)];
}

/** Return words with what was expected as a link to the outcomes that it rested on. */
function explained(said, event) {
  const at = event.kind === "outcome" && event.object ? said.indexOf("expected ") : -1;
  if (at < 0) return [said];
  const href = `/feedback?${new URLSearchParams({ object: event.object })}`;
  return [said.slice(0, at), element("a", { class: "figure", "data-figure": "", href, title: "Why? What this rests on" }, said.slice(at))];
}

function row(event) {
  const words = element("span", {}, element("b", {}, event.who), " ", linked(event.words, event.object));
  const [said, measured] = split(event);
  if (said) words.append(" ", element("small", {}, ...explained(said, event)));
  if (measured) words.append(element("details", {}, element("summary", {}, "what it measured"), element("small", {}, measured)));
  const made = element("li", { "data-kind": event.kind, "data-who": event.who },
    element("time", {}, clock(event.time_s)), words);
  if ("held" in event) made.append(mark(event.held));
  return made;
}

function shown(item) {
  const isOfKind = { "": item.dataset.kind !== BOOKKEEPING, all: true }[kind.value] ?? item.dataset.kind === kind.value;
  return (!who.value || item.dataset.who === who.value) && isOfKind;
}

function picture(figure, source, alternative, caption) {
  const image = figure.querySelector("img");
  if (!source || image?.getAttribute("src") === source) return;
  const fresh = element("img", { src: source, alt: alternative });
  const swap = () => figure.replaceChildren(fresh, element("figcaption", {}, caption));
  // The old picture stays until the new one is there: no flicker.
  if (image) fresh.decode().then(swap, swap);
  else swap();
}

function newCard(robot) {
  const names = ["Now", "Met", "Grasp", "Outcome"];
  const figure = () => element("figure", {}, element("span", { class: "quiet" }, "no picture"));
  const facts = names.flatMap((name) => [element("dt", {}, name), element("dd", {}, "–")]);
  return element("li", { class: "card lane", "data-lane": robot },
    element("div", { class: "shots live" }, figure(), figure()),
    element("div", { class: "body" },
      element("h2", {}, `${robot} `, element("span", { class: "mark" })),
      element("dl", { class: "now" }, ...facts)));
}

function drawLane(lane) {
  let card = lanes.querySelector(`[data-lane="${CSS.escape(lane.robot)}"]`);
  if (!card) lanes.append((card = newCard(lane.robot)));
  card.toggleAttribute("data-gone", !lane.connections);
  const state = card.querySelector("h2 .mark");
  state.textContent = lane.connections ? "connected" : "left";
  state.classList.toggle("good", lane.connections > 0);
  const [now, met, grasp, outcome] = card.querySelectorAll("dd");
  now.textContent = lane.doing || (lane.met || lane.outcome ? "–" : "has not reported anything yet");
  met.replaceChildren(linked(lane.met || "–", lane.object));
  grasp.textContent = lane.chosen || "–";
  outcome.replaceChildren(...(lane.held === null ? [] : [mark(lane.held), " "]), lane.outcome || "–");
  const [camera, attempt] = card.querySelectorAll("figure");
  const frame = lane.frame && `/activity/frame?robot=${encodeURIComponent(lane.robot)}&n=${lane.frame}`;
  picture(camera, frame, `What the camera of ${lane.robot} sees`, "camera");
  const shot = lane.after || lane.before;
  picture(attempt, shot && `/api/blobs/${shot}`, `The last attempt of ${lane.robot}`, "last attempt");
}

function draw() {
  timer = 0;
  drawn = [...drawn.slice(1), performance.now()];
  if (pause.getAttribute("aria-pressed") === "true") return;
  for (const lane of changed.values()) drawLane(lane);
  changed.clear();
  const fresh = waiting.slice(-MAX_ROWS).map(row);
  for (const item of fresh) item.hidden = !shown(item);
  rows.querySelector("[data-none]")?.remove();
  rows.prepend(...fresh.reverse());
  while (rows.children.length > MAX_ROWS) rows.lastElementChild.remove();
  waiting = [];
  root.querySelector("[data-empty]").hidden = lanes.children.length > 0;
  offerNames();
}

function offerNames() {
  const known = new Set([...who.options].map((option) => option.value));
  for (const name of new Set([...rows.children].map((item) => item.dataset.who))) {
    if (name && !known.has(name)) who.append(element("option", { value: name }, name));
  }
}

function take(event) {
  if (event.lane) changed.set(event.lane.robot, event.lane);
  if (!SILENT.includes(event.kind)) waiting.push(event);
  if (waiting.length > MAX_ROWS) waiting.shift();
  if (event.kind === "outcome") unspoken.push(`${event.who} ${event.words}`);
  pause.textContent = pause.getAttribute("aria-pressed") === "true" ? `Resume (${waiting.length} waiting)` : "Pause";
  const wait = Math.max(drawn.at(-1) + GATHER_MS, drawn[0] + 1000) - performance.now();
  if (timer) return;
  if (wait <= 0) draw(); // in this task: a timer would let a frame pass first
  else timer = setTimeout(draw, wait);
}

function onState(state, detail) {
  root.classList.toggle("stale", state === "lost");
  link.classList.toggle("bad", state !== "live");
  link.classList.toggle("good", state === "live");
  if (state === "live") link.textContent = "live";
  else if (state === "gap") link.textContent = detail ?? "some events are missing";
  else if (!link.textContent.startsWith("not live")) link.textContent = `not live since ${clock(Date.now() / 1000)}, trying again`;
}

function onFilter() {
  const arguments_ = new URLSearchParams(location.hash.slice(1));
  for (const [name, field] of [["who", who], ["what", kind]]) {
    if (field.value) arguments_.set(name, field.value);
    else arguments_.delete(name);
  }
  history.replaceState(null, "", `#${arguments_}`);
  for (const item of rows.children) item.hidden = !shown(item);
}

pause.addEventListener("click", () => {
  const stopped = pause.getAttribute("aria-pressed") !== "true";
  pause.setAttribute("aria-pressed", String(stopped));
  pause.textContent = stopped ? "Resume" : "Pause";
  if (!stopped) draw();
});
for (const field of [who, kind]) field.addEventListener("change", onFilter);
setInterval(() => {
  if (unspoken.length) spoken.textContent = unspoken.slice(-3).join("; ");
  unspoken = [];
}, SPEAK_MS);

tools.hidden = false;
offerNames();
const given = new URLSearchParams(location.hash.slice(1));
if (given.get("who") && !shownName(given.get("who"))) who.append(element("option", { value: given.get("who") }, given.get("who")));
who.value = given.get("who") ?? "";
kind.value = given.get("what") ?? "";
onFilter();
followActivity(root.dataset.activity, take, onState);

function shownName(name) {
  return [...who.options].some((option) => option.value === name);
}
