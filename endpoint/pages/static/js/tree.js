// A tree for the keyboard (WAI-ARIA Authoring Practices, tree view). Without this file every name is
// a link, and the server opens the tree at the chosen class.

const page = document.querySelector(".tree-page");

const items = () => [...page.querySelectorAll("[role=treeitem]")].filter((item) => item.offsetParent);
const linkOf = (item) => item.querySelector(":scope > a");

/** Fetch the part of the tree below a class, once. */
async function load(item) {
  if (item.querySelector(":scope > ul") || item.dataset.loading) return;
  item.dataset.loading = "1";
  const answer = await fetch(linkOf(item).href, { headers: { Accept: "text/html" } }).catch(() => null);
  delete item.dataset.loading;
  if (!answer?.ok) return;
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  const same = fresh.querySelector(`[role=treeitem][data-iri="${CSS.escape(item.dataset.iri)}"] > ul`);
  if (same && !item.querySelector(":scope > ul")) item.append(document.adoptNode(same));
}

async function expand(item, open) {
  if (!item.hasAttribute("aria-expanded")) return;
  if (open) await load(item);
  item.setAttribute("aria-expanded", String(open));
}

function focus(item) {
  if (!item) return;
  for (const one of page.querySelectorAll("[role=treeitem] > a")) one.tabIndex = -1;
  linkOf(item).tabIndex = 0;
  linkOf(item).focus();
}

async function onKey(event) {
  const item = event.target.closest("[role=treeitem]");
  if (!item || event.ctrlKey || event.metaKey || event.altKey) return;
  const shown = items();
  const at = shown.indexOf(item);
  const isOpen = item.getAttribute("aria-expanded") === "true";
  const moves = {
    ArrowDown: () => focus(shown[at + 1]),
    ArrowUp: () => focus(shown[at - 1]),
    Home: () => focus(shown[0]),
    End: () => focus(shown.at(-1)),
    ArrowRight: () => (isOpen ? focus(item.querySelector("[role=treeitem]")) : expand(item, true)),
    ArrowLeft: () => (isOpen ? expand(item, false) : focus(item.parentElement.closest("[role=treeitem]"))),
  };
  if (!moves[event.key]) return;
  event.preventDefault();
  await moves[event.key]();
}

function prepare() {
  const links = [...page.querySelectorAll("[role=treeitem] > a")];
  for (const link of links) link.tabIndex = -1;
  const current = page.querySelector("[role=treeitem] > a[aria-current]") ?? links[0];
  if (current) current.tabIndex = 0;
}

page.addEventListener("keydown", onKey);
page.addEventListener("click", (event) => {
  if (!event.target.matches(".twig")) return;
  const item = event.target.closest("[role=treeitem]");
  expand(item, item.getAttribute("aria-expanded") !== "true");
});
page.addEventListener("redrawn", prepare);
page.classList.add("scripted");
prepare();
