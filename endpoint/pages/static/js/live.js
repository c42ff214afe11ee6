// Draws a part of the page again when the graph changes: an element with `data-follow`, the address
// of a stream of changes. Parts marked `data-keep` are replaced only if they differ.

import { element } from "./dom.js";

const SETTLE_MS = 250;
const WITHOUT_TRACE = ["frame"]; // pictures come many times a second

const REACHED = "a[href], button, input, select, textarea, summary";

function follow(part) {
  let source = null;
  let timer = 0;
  let asked = 0;
  let drawn = 0;
  const lost = element("p", { class: "problem", role: "status", hidden: "" });
  part.before(lost);

  /** Say that what is shown may be old, and since when. */
  function tellLost(is) {
    if (is && lost.hidden) lost.textContent = `Not live since ${new Date().toTimeString().slice(0, 5)}, trying again.`;
    lost.hidden = !is;
    part.classList.toggle("stale", is);
  }

  async function redraw() {
    timer = 0;
    const mine = ++asked;
    const answer = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
    if (!answer?.ok) return;
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelector("[data-follow]");
    if (!fresh || mine < drawn) return; // a reply that comes late shows what is no longer so
    drawn = mine;
    [...part.children].forEach((old, index) => {
      const now = fresh.children[index];
      if (!now || now.textContent === old.textContent) return;
      const reached = [...old.querySelectorAll(REACHED)].indexOf(document.activeElement);
      old.replaceWith(document.adoptNode(now));
      if (reached >= 0) now.querySelectorAll(REACHED)[reached]?.focus({ preventScroll: true });
    });
    part.dispatchEvent(new Event("redrawn"));
  }

  function listen() {
    source = new EventSource(part.dataset.follow);
    const soon = () => {
      timer ||= setTimeout(redraw, SETTLE_MS);
    };
    source.addEventListener("hello", () => {
      if (!lost.hidden) soon(); // not all that happened meanwhile is told again
      tellLost(false);
    });
    source.addEventListener("change", soon);
    source.addEventListener("activity", ({ data }) => WITHOUT_TRACE.includes(JSON.parse(data).kind) || soon());
    source.onerror = () => tellLost(true);
  }

  // A hidden tab holds no connection; it catches up when it is looked at.
  document.addEventListener("visibilitychange", () => {
    source?.close();
    if (document.hidden) return;
    listen();
    redraw();
  });
  listen();
}

for (const part of document.querySelectorAll("[data-follow]")) follow(part);
