// Search as one types: what fits is listed below the field, by groups; arrows choose, Enter opens.

import { element } from "./dom.js";

const SETTLE_MS = 120;
const form = document.querySelector(".find");
const field = form.elements.q;
const list = element("ul", { id: "suggested", class: "suggested", role: "listbox", "aria-label": "Suggestions" });
let timer = 0;
let asked = null;
let chosen = -1;

const options = () => [...list.querySelectorAll("[role=option]")];

function close() {
  clearTimeout(timer);
  asked?.abort();
  list.hidden = true;
  chosen = -1;
  field.setAttribute("aria-expanded", "false");
  field.removeAttribute("aria-activedescendant");
}

function choose(index) {
  const all = options();
  if (!all.length) return;
  chosen = (index + all.length) % all.length;
  all.forEach((option, number) => option.setAttribute("aria-selected", String(number === chosen)));
  field.setAttribute("aria-activedescendant", all[chosen].id);
  all[chosen].scrollIntoView({ block: "nearest" });
}

function show(groups) {
  let count = 0;
  list.replaceChildren(...groups.map(({ name, found }) => element("li", { role: "group", "aria-label": name }, element("p", { class: "quiet" }, name),
    ...found.map(({ title, detail, address }) => element("a", { role: "option", id: `suggested-${count++}`, href: address, tabindex: "-1", "aria-selected": "false" }, title, element("small", {}, ` ${detail}`))))));
  chosen = -1;
  field.removeAttribute("aria-activedescendant");
  list.hidden = count === 0;
  field.setAttribute("aria-expanded", String(count > 0));
}

async function ask() {
  asked?.abort();
  asked = new AbortController();
  const answer = await fetch(`/search.json?${new URLSearchParams({ q: field.value })}`, { signal: asked.signal }).catch(() => null);
  if (!answer?.ok || !answer.url.includes("/search.json")) return; // Enter does the work
  const { groups, query } = await answer.json();
  if (query === field.value.trim() && document.activeElement === field) show(groups);
}

for (const [name, value] of Object.entries({ role: "combobox", autocomplete: "off", "aria-expanded": "false", "aria-controls": "suggested", "aria-autocomplete": "list" })) field.setAttribute(name, value);
list.hidden = true;
form.append(list);
field.addEventListener("input", () => {
  clearTimeout(timer);
  if (!field.value.trim()) return close();
  timer = setTimeout(ask, SETTLE_MS);
});
field.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (event.key === "Escape" && !list.hidden) close();
  else if (step && !list.hidden) choose(chosen < 0 && step < 0 ? -1 : chosen + step);
  else if (event.key === "Enter" && chosen >= 0) location.assign(options()[chosen].href);
  else return;
  event.preventDefault();
});
list.addEventListener("mousedown", (event) => event.preventDefault()); // the field keeps the focus
field.addEventListener("blur", close);
