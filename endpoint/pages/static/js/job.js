// Follows a job until it ends, and then shows its page again, with the answer.

import { element } from "./dom.js";

const WAIT_S = 1;
const RETRY_MS = 2000;
const ENDED = ["succeeded", "failed", "cancelled", "timed_out"];
const root = document.querySelector("[data-job]");
const log = document.querySelector("[data-log]");
const find = (name) => root.querySelector(`[data-${name}]`);
let after = 0;

log.replaceChildren(); // it is read again from the first report
for (;;) {
  const response = await fetch(`${root.dataset.job}?wait=${WAIT_S}&after=${after}`, { headers: { Accept: "application/json" } }).catch(() => null);
  if (!response?.ok) {
    find("said").textContent = response ? `The server answered ${response.status}.` : "The server does not answer, trying again.";
    await new Promise((later) => setTimeout(later, RETRY_MS));
    continue;
  }
  const job = await response.json();
  find("state").textContent = job.state.replace("_", " ");
  find("progress").value = job.progress;
  find("said").textContent = job.message;
  for (const { number, progress, message } of job.events) {
    after = Math.max(after, number);
    if (message) log.append(element("li", {}, `${(100 * progress).toFixed(0)} %: ${message}`));
  }
  log.nextElementSibling.hidden = log.children.length > 0;
  if (ENDED.includes(job.state)) break;
}
location.reload();
