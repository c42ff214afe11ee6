// Making elements, for all pages.

/** Make an element; children that are strings become text, never markup. */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Say what a server refused, with a way to sign in where it wants to know who asks. */
export function explain(place, problem) {
  place.replaceChildren(problem?.detail ?? "");
  if (problem?.status !== 401) return;
  const here = location.pathname + location.search + location.hash;
  place.append(" ", element("a", { href: `/login?${new URLSearchParams({ next: here })}` }, "Sign in"));
}
