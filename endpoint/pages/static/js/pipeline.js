// Follows each change of a pipeline at once, without leaving the place on the page.

import { explain } from "./dom.js";
import { problemOf } from "./calls.js";
import { followJob } from "./job_stream.js";
import { showResults } from "./results.js";

const root = () => document.querySelector("[data-pipeline]");

/** How long a list may still change under somebody's keys before the page follows it, in ms. */
const PAUSE = 400;
let underWay = null; // what ends the request whose reply is still to come
let pause = 0;

/** Put the page that the server drew in the place of this one; chosen files stay chosen. */
function replace(text) {
  const next = new DOMParser().parseFromString(text, "text/html").querySelector("[data-pipeline]");
  if (!next) return false;
  const { id } = document.activeElement;
  const files = new Map([...root().querySelectorAll("[type=file]")].map((one) => [one.name, one.files]));
  const open = new Set([...root().querySelectorAll("section[id] > details[open]")].map((one) => one.parentElement.id));
  root().replaceWith(next);
  for (const one of next.querySelectorAll("[type=file]")) if (files.get(one.name)?.length) one.files = files.get(one.name);
  for (const one of next.querySelectorAll("section[id] > details")) one.open ||= open.has(one.parentElement.id);
  showResults(next);
  if (id) document.getElementById(id)?.focus({ preventScroll: true });
  followRun();
  return true;
}

/** Show how far a run is, and at its end the page with its answers. */
async function followRun() {
  const run = root().querySelector("[data-run]");
  if (!run) return;
  const said = run.querySelector("[data-said-of-run]");
  const report = ({ progress, message, state }) => {
    run.querySelector("progress").value = progress;
    said.textContent = message || state;
  };
  const ended = await followJob(run.dataset.run, report, (words) => (said.textContent = words), () => run.isConnected);
  if (!ended || !run.isConnected) return;
  const page = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
  if (page && replace(await page.text())) root().querySelector("[role=alert], [data-answers]")?.scrollIntoView({ block: "center" });
}

/** End what is under way: its reply would put an older pipeline in the place of a newer one. */
function supersede() {
  clearTimeout(pause);
  pause = 0;
  underWay?.abort();
}

async function send(form, button) {
  supersede();
  const mine = underWay = new AbortController();
  const said = form.querySelector("[data-said]");
  const running = button?.value === "run";
  if (said) said.textContent = running ? "Running …" : "";
  root().setAttribute("aria-busy", "true");
  root().inert = running; // what is changed meanwhile would be lost with the reply
  const steps = form.querySelectorAll(".step").length;
  const request = { method: "POST", body: new FormData(form, button), headers: { Accept: "text/html" }, signal: mine.signal };
  const response = await fetch(form.action, request).catch(() => null);
  const text = await response?.text().catch(() => null) ?? "";
  if (mine.signal.aborted) return;
  underWay = null;
  root().removeAttribute("aria-busy");
  root().inert = false;
  if (response?.redirected && !new URL(response.url).pathname.startsWith("/tools/pipeline")) return location.assign(response.url);
  if (!replace(text)) {
    if (said) explain(said, response ? problemOf(response, text) : { detail: "No answer from the server; nothing was changed." });
    return;
  }
  // A run that goes on has an address of its own.
  const address = response.redirected ? response.url.replace(location.origin, "") : root().dataset.address;
  if (address !== location.pathname + location.search) history.pushState(null, "", address);
  const wrong = root().querySelector("[role=alert]");
  const added = [...root().querySelectorAll(".step")];
  if (wrong) wrong.scrollIntoView({ block: "center" });
  else if (added.length > steps) added.at(-1).scrollIntoView();
  else if (running) root().querySelector("[data-answers]")?.scrollIntoView();
}

document.addEventListener("submit", (event) => {
  if (!event.target.closest("[data-pipeline]")) return;
  event.preventDefault();
  send(event.target, event.submitter);
});
/** Send what was chosen; a list that is being typed into changes with every key, so it waits for the last. */
function follow(field, wait) {
  supersede();
  pause = setTimeout(() => {
    pause = 0;
    if (field.isConnected) send(field.form, field.form.querySelector("[value=change]"));
  }, wait);
}

let typed = -PAUSE; // when a key was last pressed in a list
document.addEventListener("change", ({ target }) => {
  if (target.matches("[data-follow]")) follow(target, performance.now() - typed < PAUSE ? PAUSE : 0);
});
document.addEventListener("keydown", ({ target }) => {
  if (!target.matches("select[data-follow]")) return;
  typed = performance.now();
  if (pause) follow(target, PAUSE);
});
addEventListener("popstate", () => location.reload());
followRun();
