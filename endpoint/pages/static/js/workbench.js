// The SPARQL workbench. Without this file the form still works: the server draws the table.

import { element, explain } from "./dom.js";
import "./editor.js";

const ROWS_JSON = "application/sparql-results+json";
const form = document.querySelector("[data-workbench]");
const query = form.elements.query;
const answer = document.getElementById("answer");
const samples = form.querySelector("[data-samples]");
const downloads = form.querySelector(".downloads");
const editor = form.querySelector("sparql-editor");
const stop = form.querySelector("[data-stop]");
const { inferred, seconds, rows: limit } = form.elements;
let running = null;

function ask(text, accept, signal) {
  const options = new URLSearchParams();
  if (!inferred.checked) options.set("inferred", "0");
  if (seconds.value) options.set("timeout", seconds.value);
  return fetch(`/sparql?${options}`, {
    method: "POST",
    headers: { "Content-Type": "application/sparql-query", Accept: accept },
    body: text,
    signal,
  });
}

/** Prefixes that the query itself declares, and the base below which instances are named. */
function prefixesOf(text) {
  const declared = text.matchAll(/\bPREFIX\s+([\w.-]*:)\s*<([^>]*)>/gi);
  return [...[...declared].map(([, name, iri]) => ({ name, iri })), { name: "", iri: form.dataset.base }];
}

function shorten(iri, prefixes) {
  const found = prefixes.find((p) => iri.startsWith(p.iri) && iri.length > p.iri.length);
  return found ? found.name + iri.slice(found.iri.length) : iri;
}

function cell(term, prefixes) {
  if (!term) return element("td");
  if (term.type === "uri") {
    const href = "/resource?iri=" + encodeURIComponent(term.value);
    return element("td", { title: term.value }, element("a", { href }, shorten(term.value, prefixes)));
  }
  const text = typeof term.value === "string" ? term.value : JSON.stringify(term.value);
  return element("td", term["xml:lang"] ? { lang: term["xml:lang"] } : {}, text);
}

function table(result, text) {
  const names = result.head.vars;
  const prefixes = prefixesOf(text);
  const rows = result.results.bindings.slice(0, Number(limit.value)).map((row) =>
    element("tr", {}, ...names.map((name) => cell(row[name], prefixes))),
  );
  const head = element("tr", {}, ...names.map((name) => element("th", {}, name)));
  return element(
    "div",
    { class: "scroll" },
    element("table", {}, element("thead", {}, head), element("tbody", {}, ...rows)),
  );
}

function caption(count, milliseconds) {
  const shown = count > Number(limit.value) ? `, the first ${limit.value} shown` : "";
  const rows = `${count} row${count === 1 ? "" : "s"}`;
  return element("p", { class: "quiet" }, `${rows} in ${Math.round(milliseconds)} ms${shown}`);
}

async function render(response, text, started) {
  const type = (response.headers.get("Content-Type") || "").split(";")[0];
  if (!response.ok) {
    const details = await response.json().catch(() => ({ detail: response.statusText }));
    if (editor.shadowRoot) editor.mark(details.line ? details : null);
    else selectLine(details.line);
    const said = element("p", { class: "problem", role: "alert" });
    explain(said, details);
    return [said];
  }
  if (type !== ROWS_JSON) return [element("pre", {}, (await response.text()) || "no triples")];
  const result = await response.json();
  if ("boolean" in result) return [element("p", { class: "verdict" }, result.boolean ? "yes" : "no")];
  return [caption(result.results.bindings.length, performance.now() - started), table(result, text)];
}

/** Show where a syntax error is. */
function selectLine(line) {
  if (!line) return;
  const lines = query.value.split("\n");
  const start = lines.slice(0, line - 1).reduce((sum, l) => sum + l.length + 1, 0);
  query.focus();
  query.setSelectionRange(start, start + (lines[line - 1] || "").length);
}

async function run() {
  running?.abort();
  const mine = (running = new AbortController());
  const text = query.value;
  answer.setAttribute("aria-busy", "true");
  stop.hidden = false;
  try {
    const started = performance.now();
    const response = await ask(text, `${ROWS_JSON}, text/turtle`, mine.signal);
    answer.replaceChildren(...(await render(response, text, started)));
    downloads.hidden = !response.ok;
  } catch (error) {
    if (error.name === "AbortError") {
      if (running === mine) answer.replaceChildren(element("p", { class: "empty", role: "status" }, "Stopped."));
      return;
    }
    answer.replaceChildren(element("p", { class: "problem", role: "alert" }, `no answer: ${error.message}`));
  } finally {
    if (running === mine) {
      answer.removeAttribute("aria-busy");
      stop.hidden = true;
    }
  }
}

async function download(type) {
  const response = await ask(query.value, type);
  if (!response.ok) return answer.replaceChildren(...(await render(response, query.value, 0)));
  const url = URL.createObjectURL(await response.blob());
  const ending = { "text/csv": "csv", "text/turtle": "ttl" }[type] ?? "json";
  element("a", { href: url, download: `result.${ending}` }).click();
  URL.revokeObjectURL(url);
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  if (location.pathname.startsWith("/sparql")) {
    history.replaceState(null, "", "/sparql?query=" + encodeURIComponent(query.value));
  }
  run();
});
query.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) form.requestSubmit();
});
for (const part of form.querySelectorAll(".scripted-only")) part.hidden = false;
samples.closest("label").hidden = false;
stop.addEventListener("click", () => running?.abort());
samples.addEventListener("change", () => {
  if (!samples.value) return;
  editor.show(samples.value);
  form.requestSubmit();
});
for (const button of form.querySelectorAll("[data-download]")) {
  button.addEventListener("click", () => download(button.dataset.download));
}
