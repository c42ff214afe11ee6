// Calls of services: refusals as errors, and the newest of many questions.

const RETRY_MS = 2000;
const MIN_GAP_MS = 50; // twenty calls a second at most

/** What a service refuses; `problem` holds its details. */
export class Refused extends Error {
  constructor(problem) {
    super(problem.detail);
    this.problem = problem;
  }
}

/** Return the details of a refusal; a proxy in between may send none. */
export function problemOf(response, body) {
  try {
    return JSON.parse(body);
  } catch {
    return { detail: `The server answered ${response.status} ${response.statusText}.` };
  }
}

/**
 * Call a method and return its answer.
 * @throws {Refused} the service's words
 * @throws {TypeError} nobody answers
 */
export async function call(address, request, signal = null) {
  const response = await fetch(address, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(request),
    signal,
  });
  const body = await response.text();
  if (!response.ok) throw new Refused(problemOf(response, body));
  return JSON.parse(body);
}

/** Asks one question at a time; of those that come meanwhile, the newest waits. */
export class Newest {
  #busy = false;
  #waiting = null;
  #lostSince = null;

  /**
   * @param {(question: any) => Promise<void>} work
   * @param {{problem: (problem: object | null) => void, link: (lostSince: Date | null) => void,
   *   busy: (is: boolean) => void}} told
   */
  constructor(work, told) {
    this.work = work;
    this.told = told;
  }

  ask(question) {
    this.#waiting = { question };
    if (!this.#busy) this.#run();
  }

  async #run() {
    this.#busy = true;
    this.told.busy(true);
    while (this.#waiting) {
      const { question } = this.#waiting;
      this.#waiting = null;
      let pause = MIN_GAP_MS;
      try {
        await this.work(question);
        this.#found(null);
        this.told.problem(null);
      } catch (error) {
        if (error instanceof Refused) {
          this.#found(null);
          this.told.problem(error.problem);
        } else if (error instanceof TypeError) {
          this.#found(new Date());
          this.#waiting ??= { question };
          pause = RETRY_MS;
        } else throw error;
      }
      await new Promise((later) => setTimeout(later, pause));
    }
    this.#busy = false;
    this.told.busy(false);
  }

  #found(lost) {
    if (Boolean(lost) === Boolean(this.#lostSince)) return;
    this.#lostSince = lost;
    this.told.link(lost);
  }
}
