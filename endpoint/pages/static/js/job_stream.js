// Reads the reports of a job until it ends.

const WAIT_S = 1;
const RETRY_MS = 2000;
const ENDED = ["succeeded", "failed", "cancelled", "timed_out"];

/**
 * Follow a job.
 * @param {string} address of the job
 * @param {(job: object) => void} onReport called with each state of it, and the events since the last
 * @param {(said: string) => void} onTrouble called while there is no answer
 * @param {() => boolean} goesOn whether anybody still wants to know
 * @returns {Promise<boolean>} whether it ended, and not the interest in it
 */
export async function followJob(address, onReport, onTrouble, goesOn = () => true) {
  let after = 0;
  while (goesOn()) {
    const response = await fetch(`${address}?wait=${WAIT_S}&after=${after}`, { headers: { Accept: "application/json" } }).catch(() => null);
    if (!response?.ok) {
      onTrouble(response ? `The server answered ${response.status}.` : "The server does not answer, trying again.");
      await new Promise((later) => setTimeout(later, RETRY_MS));
      continue;
    }
    const job = await response.json();
    for (const { number } of job.events) after = Math.max(after, number);
    if (goesOn()) onReport(job);
    if (ENDED.includes(job.state)) return true;
  }
  return false;
}
