// Keys of every page: / searches, ? lists the keys. Single keys can be switched off (WCAG 2.1.4).

const STORED = "rtask.single-keys";
const panel = document.querySelector("#key-list");
const switches = new Set();

/** Whether keys without Ctrl or Alt do anything. */
export const singleKeysWork = () => localStorage.getItem(STORED) !== "off";

/** Let a checkbox switch single keys on all pages. */
export function bindSwitch(box) {
  switches.add(box);
  box.checked = singleKeysWork();
  box.addEventListener("change", () => {
    localStorage.setItem(STORED, box.checked ? "on" : "off");
    for (const other of switches) other.checked = box.checked;
  });
}

function onKey(event) {
  const typing = event.target.closest?.("input:not([type=checkbox]), textarea, select, [contenteditable], sparql-editor");
  if (event.ctrlKey || event.metaKey || event.altKey || typing || !singleKeysWork()) return;
  if (event.key === "/") document.querySelector(".find input").focus();
  else if (event.key === "?") panel.togglePopover();
  else return;
  event.preventDefault();
}

bindSwitch(panel.querySelector("input"));
panel.querySelector("label").hidden = false;
document.addEventListener("keydown", onKey);
