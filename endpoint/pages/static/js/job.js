// Follows a job until it ends, and then shows its page again, with the answer.

import { element } from "./dom.js";
import { followJob } from "./job_stream.js";

const root = document.querySelector("[data-job]");
const log = document.querySelector("[data-log]");
const find = (name) => root.querySelector(`[data-${name}]`);

log.replaceChildren(); // it is read again from the first report
await followJob(
  root.dataset.job,
  (job) => {
    find("state").textContent = job.state.replace("_", " ");
    find("progress").value = job.progress;
    find("said").textContent = job.message;
    for (const { progress, message } of job.events) {
      if (message) log.append(element("li", {}, `${(100 * progress).toFixed(0)} %: ${message}`));
    }
    log.nextElementSibling.hidden = log.children.length > 0;
  },
  (said) => (find("said").textContent = said),
);
location.reload();
