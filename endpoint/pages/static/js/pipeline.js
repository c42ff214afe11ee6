// Follows each change of a pipeline at once, without leaving the place on the page.

import { explain } from "./dom.js";
import { problemOf } from "./calls.js";
import { followJob } from "./job_stream.js";
import { showResults } from "./results.js";

const root = () => document.querySelector("[data-pipeline]");

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

async function send(form, button) {
  const said = form.querySelector("[data-said]");
  const running = button?.value === "run";
  if (said) said.textContent = running ? "Running …" : "";
  root().setAttribute("aria-busy", "true");
  const steps = form.querySelectorAll(".step").length;
  const response = await fetch(form.action, { method: "POST", body: new FormData(form, button), headers: { Accept: "text/html" } }).catch(() => null);
  root().removeAttribute("aria-busy");
  if (response?.redirected && !new URL(response.url).pathname.startsWith("/tools/pipeline")) return location.assign(response.url);
  const text = await response?.text() ?? "";
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
document.addEventListener("change", ({ target }) => {
  if (target.matches("[data-follow]")) send(target.form, target.form.querySelector("[value=change]"));
});
addEventListener("popstate", () => location.reload());
followRun();
