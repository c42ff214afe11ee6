// Outcomes, one card at a time, judged by keys, buttons or swipes. Without this file every card is
// on the page with a form of its own.

import { element, explain } from "./dom.js";
import { bindSwitch } from "./keys.js";

const TAKE_BACK_MS = 10_000;
const SWIPE_PX = 80;
const FEEDBACK = "https://w3id.org/rtask-kg/ns#HumanFeedback";
const deck = document.querySelector("[data-deck]");
const cards = deck ? [...deck.querySelectorAll("[data-attempt]")] : [];
const waiting = []; // verdicts that can still be taken back, the oldest first
let current = 0;
let askingWhy = false;

function button(words, key, act, look = "") {
  const made = element("button", { type: "button", class: look }, words, " ", element("kbd", {}, key));
  made.addEventListener("click", act);
  return made;
}

const status = element("p", { class: "status quiet", role: "status" });
const keysOn = element("input", { type: "checkbox", id: "keys-on" });
const why = element("div", { class: "why", role: "group", "aria-label": "Why it did not hold", hidden: "" });
const tools = element("div", { class: "tools judging", role: "group", "aria-label": "Judge this attempt" });
const list = element("ol", { class: "attempt-list", "aria-label": "Attempts" });
const entries = cards.map((card, index) => {
  const state = element("span", { class: lookOf(card) }, stateOf(card));
  const open = element("button", { type: "button" }, card.dataset.title, " ",
    element("small", {}, `${card.dataset.robot}, ${card.dataset.time}`), state);
  open.addEventListener("click", () => show(index));
  list.append(element("li", {}, open));
  return { open, state };
});

/** What counts of a card now, as the server drew it. */
function stateOf(card) {
  return card.querySelector("[data-said] .mark")?.textContent.trim() ?? "";
}

/** The classes of what counts of a card, so that its entry has the same colour. */
function lookOf(card) {
  return card.querySelector("[data-said] .mark")?.className ?? "mark";
}

/** Draw in the list what counts of a card, or what was just said of it. */
function mark(index, words = stateOf(cards[index]), look = lookOf(cards[index])) {
  entries[index].state.textContent = words;
  entries[index].state.className = look;
}

function say(words) {
  status.textContent = words;
}

function show(index, focus = true) {
  closeWhy();
  current = Math.max(0, Math.min(cards.length - 1, index));
  cards.forEach((card, number) => card.classList.toggle("off", number !== current));
  entries.forEach(({ open }, number) => open.toggleAttribute("aria-current", number === current));
  const card = cards[current];
  card.querySelector(".shots").after(tools, why, status);
  tools.hidden = !card.querySelector("form");
  // The pictures of the next card are fetched ahead.
  for (const image of cards[current + 1]?.querySelectorAll("img") ?? []) image.loading = "eager";
  if (focus) {
    card.focus({ preventScroll: true });
    card.scrollIntoView({ block: "nearest" });
  }
}

/** The name of who judges, where no token says it; asked for on the card. */
function nameIsMissing(card) {
  const field = card.querySelector("[name=operator]");
  if (!field || field.value.trim()) return false;
  field.focus();
  say("Enter your name first.");
  return true;
}

function judge(held, reason = "") {
  const card = cards[current];
  if (!card.querySelector("form") || nameIsMissing(card)) return;
  closeWhy();
  const body = new URLSearchParams(new FormData(card.querySelector("form")));
  for (const name of ["held", "reason", "verdict"]) body.delete(name);
  body.set("verdict", "correct");
  body.set("held", String(held));
  if (reason) body.set("reason", reason);
  const earlier = waiting.findIndex((one) => one.card === card);
  if (earlier >= 0) clearTimeout(waiting.splice(earlier, 1)[0].timer);
  const verdict = { card, body, index: current };
  verdict.timer = setTimeout(() => send(verdict), TAKE_BACK_MS);
  waiting.push(verdict);
  mark(current, held ? "you: held" : "you: did not hold", `mark ${held ? "good" : "bad"}`);
  say(`${card.dataset.title}: ${held ? "held" : "did not hold"}. Sent in 10 s; U takes it back.`);
  if (current < cards.length - 1) show(current + 1);
}

function takeBack() {
  const verdict = waiting.pop();
  if (!verdict) return say("Nothing is left to take back.");
  clearTimeout(verdict.timer);
  mark(verdict.index);
  show(verdict.index);
  say("Taken back; nothing was sent.");
}

async function send(verdict, leaving = false) {
  clearTimeout(verdict.timer); // of a page that is left, which may come back
  waiting.splice(waiting.indexOf(verdict), 1);
  const { card, body, index } = verdict;
  try {
    const answer = await fetch("/feedback", {
      method: "POST", body, redirect: "manual", keepalive: leaving,
      headers: { Accept: "application/json" },
    });
    if (answer.type === "opaqueredirect" || answer.ok) return entries[index].open.classList.add("sent");
    const problem = await answer.json().catch(() => ({ detail: answer.statusText }));
    fail(card, index, problem);
  } catch (error) {
    fail(card, index, { detail: `no answer: ${error.message}` });
  }
}

/** A verdict that was not stored is said where it was given. */
function fail(card, index, problem) {
  const note = element("p", { class: "problem", role: "alert" });
  explain(note, { ...problem, detail: `Not stored: ${problem.detail}` });
  card.querySelector("[data-said]").append(note);
  mark(index, "not stored", "mark bad");
}

function askWhy() {
  if (!cards[current].querySelector("form")) return;
  const options = [...cards[current].querySelectorAll("[name=reason] option")].slice(1, 10);
  const cannotTell = button("I cannot tell", "Enter", () => judge(false));
  why.replaceChildren(
    element("p", {}, "Why?"),
    ...options.map((option, at) => button(option.textContent, String(at + 1), () => judge(false, option.value))),
    cannotTell,
    button("Cancel", "Esc", closeWhy),
  );
  why.hidden = false;
  askingWhy = true;
  cannotTell.focus(); // so that Enter gives no reason
}

function closeWhy() {
  why.hidden = true;
  askingWhy = false;
}

const KEYS = {
  y: () => judge(true),
  n: askWhy,
  s: () => show(current + 1),
  u: takeBack,
  arrowright: () => show(current + 1),
  arrowdown: () => show(current + 1),
  arrowleft: () => show(current - 1),
  arrowup: () => show(current - 1),
};

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input:not([type=checkbox]), select, textarea")) return;
  const key = event.key.toLowerCase();
  if (askingWhy) {
    const chosen = /^[1-9]$/.test(key) ? why.querySelectorAll("button")[Number(key) - 1] : null;
    if (key === "escape") closeWhy();
    else if (key === "enter" && !event.target.matches(".why button")) judge(false);
    else if (chosen && keysOn.checked) chosen.click();
    else return;
  } else if (KEYS[key] && (key.length > 1 || keysOn.checked)) KEYS[key]();
  else return;
  event.preventDefault();
}

/** Right: held; left: did not hold; up: skip. Only on the pictures, so that the page still scrolls. */
function swipes(card) {
  const shots = card.querySelector(".shots");
  let start = null;
  shots.addEventListener("pointerdown", (event) => {
    start = event.pointerType === "touch" ? [event.clientX, event.clientY] : null;
  });
  shots.addEventListener("pointerup", (event) => {
    if (!start) return;
    const [dx, dy] = [event.clientX - start[0], event.clientY - start[1]];
    start = null;
    if (Math.abs(dx) > SWIPE_PX && Math.abs(dx) > 2 * Math.abs(dy)) dx > 0 ? judge(true) : askWhy();
    else if (dy < -SWIPE_PX && Math.abs(dy) > 2 * Math.abs(dx)) show(current + 1);
  });
}

let asked = 0;
let drawn = 0;

/** Others judge too: draw again what is said, and say so on the card that is open. */
async function refresh() {
  const mine = ++asked;
  const answer = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
  if (!answer?.ok) return;
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  if (mine < drawn) return; // a reply that comes late shows what is no longer so
  drawn = mine;
  cards.forEach((card, index) => {
    const said = fresh.getElementById(card.id)?.querySelector("[data-said]");
    const old = card.querySelector("[data-said]");
    if (!said || said.textContent.trim() === old.textContent.trim()) return;
    old.replaceWith(document.adoptNode(said));
    const mine = waiting.some((one) => one.card === card);
    if (!mine) mark(index);
    if (index === current) say("Somebody has just judged this attempt.");
  });
}

function follow() {
  const changes = new EventSource(`/changes?class=${encodeURIComponent(FEEDBACK)}`);
  let timer = 0;
  changes.addEventListener("change", () => {
    clearTimeout(timer);
    timer = setTimeout(refresh, 200);
  });
}

function start() {
  tools.append(
    button("Held", "Y", () => judge(true), "yes"),
    button("Did not hold", "N", askWhy, "no"),
    button("Skip", "S", () => show(current + 1)),
    button("Take back", "U", takeBack),
  );
  bindSwitch(keysOn);
  const side = element("div", { class: "side-list" },
    element("label", {}, keysOn, " Letter keys"), list);
  deck.classList.add("deck");
  deck.append(side);
  for (const card of cards) {
    swipes(card);
    const name = card.querySelector("[name=operator]");
    name?.addEventListener("input", () => {
      for (const other of deck.querySelectorAll("[name=operator]")) other.value = name.value;
    });
  }
  const wanted = cards.findIndex((card) => `#${card.id}` === location.hash);
  show(wanted < 0 ? 0 : wanted, wanted >= 0);
  document.addEventListener("keydown", onKey);
  addEventListener("pagehide", () => [...waiting].forEach((one) => send(one, true)));
  follow();
}

if (cards.length) start();
