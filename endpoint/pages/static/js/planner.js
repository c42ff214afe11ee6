// Asks a service for a plan: one question at a time, the newest wins, and again while nobody answers.

import { problemOf } from "./calls.js";

const SETTLE_MS = 150;
const RETRY_MS = 2000;

export class Planner {
  #timer = 0;
  #asked = null;
  #lostSince = null;

  /**
   * @param {string} address of the method
   * @param {{answer: (answer: object, request: object) => void, problem: (problem: object) => void,
   *   link: (lostSince: Date | null) => void}} told
   */
  constructor(address, told) {
    this.address = address;
    this.told = told;
  }

  /** Ask once the request has not changed for a moment; an earlier question is dropped. */
  ask(request) {
    this.cancel();
    this.#timer = setTimeout(() => this.#send(request), SETTLE_MS);
  }

  cancel() {
    clearTimeout(this.#timer);
    this.#asked?.abort();
  }

  async #send(request) {
    const asked = new AbortController();
    this.#asked = asked;
    let answer;
    let body;
    try {
      answer = await fetch(this.address, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(request),
        signal: asked.signal,
      });
      body = await answer.text();
    } catch {
      if (asked.signal.aborted) return;
      this.#lostSince ??= new Date();
      this.told.link(this.#lostSince);
      this.#timer = setTimeout(() => this.#send(request), RETRY_MS);
      return;
    }
    if (asked.signal.aborted) return;
    this.#lostSince = null;
    this.told.link(null);
    if (answer.ok) this.told.answer(JSON.parse(body), request);
    else this.told.problem(problemOf(answer, body));
  }
}
