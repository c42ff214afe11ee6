// The grasp editor: an outline, the settings, and the grasps that the service plans for them.

import { element, explain } from "./dom.js";
import { GraspDrawing } from "./grasp_drawing.js";
import { saveAs, tableOf } from "./grasp_files.js";
import { Outline, readPoints } from "./outline.js";
import { Planner } from "./planner.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const FIRST_PART = "A";
const SETTLE_MS = 150;
const root = document.querySelector("[data-editor]");
const find = (name) => root.querySelector(`[data-${name}]`);
const [svg, list, said, problem, lost] = ["drawing", "grasps", "said", "problem", "lost"].map(find);
const [picker, settings, text] = ["part", "settings", "text"].map(find);
const axes = [...root.querySelectorAll("[data-axis]")];
const parts = Object.assign({}, ...Object.values(JSON.parse(root.dataset.parts)));
const initial = Object.fromEntries(new FormData(settings));
const outline = new Outline();
const drawing = new GraspDrawing(svg);
let answer = null;
let asked = null; // the request that `answer` is for
let selected = -1;
let dragged = -1;
let wasDragged = false;
let remembering = 0;

const PLANNING = ", planning …";
const planner = new Planner(root.dataset.editor, {
  answer(planned, request) {
    [answer, asked, selected] = [planned, request, -1];
    said.textContent = said.textContent.replace(PLANNING, `: ${planned.grasps.length} grasps`);
    showProblem(null);
    listGrasps();
    draw();
  },
  problem(refused) {
    noGrasps();
    said.textContent = said.textContent.replace(PLANNING, "");
    showProblem(refused);
  },
  link(since) {
    lost.hidden = !since;
    root.classList.toggle("stale", Boolean(since));
    if (since && !lost.textContent) lost.textContent = `No answer from the server since ${since.toTimeString().slice(0, 5)}, trying again. Grasps may be those of an earlier outline.`;
    if (!since) lost.textContent = "";
  },
});

const draw = () => drawing.draw(outline, answer, selected);

function noGrasps() {
  [answer, asked, selected] = [null, null, -1];
  list.replaceChildren();
  draw();
}

function showProblem(refused) {
  problem.hidden = !refused;
  explain(problem, refused);
  for (const field of settings.elements) {
    if (refused?.field === field.name) field.setAttribute("aria-invalid", "true");
    else field.removeAttribute("aria-invalid");
  }
}

/** Return the settings that are filled in, as the service takes them. */
function filledIn() {
  const given = [...settings.elements].filter((field) => field.name && field.value !== "");
  return Object.fromEntries(given.map((field) => [field.name, field.type === "number" ? Number(field.value) : field.value]));
}

/** Show the outline and plan its grasps. */
function changed() {
  const count = outline.vertices.length;
  said.textContent = outline.chosen < 0 ? `${count} vertices`
    : `vertex ${outline.chosen + 1} of ${count}: x ${outline.vertices[outline.chosen][0]} m, y ${outline.vertices[outline.chosen][1]} m`;
  axes.forEach((field, axis) => {
    field.disabled = outline.chosen < 0;
    if (document.activeElement !== field) field.value = outline.vertices[outline.chosen]?.[axis] ?? "";
  });
  if (document.activeElement !== text.elements.points) text.elements.points.value = JSON.stringify(outline.vertices);
  if (picker.value && JSON.stringify(parts[picker.value]) !== JSON.stringify(outline.vertices)) picker.value = "";
  draw();
  const request = { polygon: outline.vertices.map((vertex) => [...vertex]), ...filledIn() };
  if (dragged >= 0 && request.method === "simulation") return planner.cancel(); // it takes long: asked when the vertex is let go
  remember();
  if (count >= 3 && !outline.isFlat) {
    said.textContent += PLANNING;
    return planner.ask(request);
  }
  planner.cancel();
  noGrasps();
  showProblem(null);
  said.textContent += count >= 3 ? "; they lie on one line" : count ? "; an outline needs three" : ": click into the drawing, press Enter in it, or choose an example";
}

/** Keep the state in the address, once it has settled: browsers limit how often it may change. */
function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(writeAddress, SETTLE_MS);
}

function writeAddress() {
  const differing = Object.entries(Object.fromEntries(new FormData(settings))).filter(([name, value]) => value !== initial[name]);
  const points = outline.vertices.map((vertex) => vertex.join(",")).join(";");
  const more = new URLSearchParams(differing).toString();
  history.replaceState(null, "", `#polygon=${points}${more && `&${more}`}`);
}

/** Take outline and settings from the address. */
function restore() {
  const state = new URLSearchParams(location.hash.slice(1));
  for (const field of settings.elements) if (field.name) field.value = state.get(field.name) ?? initial[field.name];
  if (state.has("polygon")) use(state.get("polygon"));
  else {
    picker.value = FIRST_PART;
    show(parts[FIRST_PART]);
  }
}

function show(vertices) {
  outline.replace(vertices);
  drawing.fit(vertices);
  changed();
}

function use(points) {
  try {
    show(readPoints(points));
  } catch (error) {
    showProblem({ detail: error.message });
  }
}

function listGrasps() {
  list.replaceChildren(...answer.grasps.map((grasp, index) => {
    const cells = [grasp.probability.toFixed(2), grasp.lower_95.toFixed(2), grasp.opening.toFixed(4)];
    return element("tr", { "data-row": index, "aria-selected": "false", tabindex: index ? "-1" : "0" },
      element("th", { scope: "row" }, String(index + 1)), ...cells.map((cell) => element("td", {}, cell)));
  }));
}

function select(index) {
  selected = index;
  [...list.children].forEach((row, number) => {
    row.setAttribute("aria-selected", String(number === index));
    row.tabIndex = number === Math.max(index, 0) ? 0 : -1;
  });
  const box = list.closest(".scroll");
  const row = list.children[index];
  if (row) box.scrollTop = Math.max(0, row.offsetTop - box.clientHeight / 2);
  draw();
}

const actions = {
  undo: () => outline.undo(),
  clear: () => outline.replace([]),
  fit: () => drawing.fit(outline.vertices),
  previous: () => outline.step(-1),
  next: () => outline.step(1),
  insert() {
    if (outline.vertices.length >= 2) return outline.split();
    const [x, y] = outline.vertices[0] ?? drawing.centre;
    outline.insert(outline.vertices.length - 1, [x + outline.vertices.length * drawing.grid, y]);
  },
  remove: () => outline.remove(),
};
const keys = { PageUp: "previous", PageDown: "next", Enter: "insert", Insert: "insert", Delete: "remove", Backspace: "remove" };

function onKey(event) {
  const arrow = ARROWS[event.key];
  if (event.key === "Escape") {
    outline.chosen = -1;
    select(-1);
  } else if (arrow && outline.vertices.length) {
    if (outline.chosen < 0) outline.step(1);
    outline.mark();
    const far = drawing.step * (event.shiftKey ? 10 : 1);
    const from = outline.vertices[outline.chosen];
    outline.move(outline.chosen, from.map((value, axis) => value + arrow[axis] * far));
  } else if (keys[event.key]) actions[keys[event.key]]();
  else return;
  event.preventDefault();
  changed();
}

svg.addEventListener("keydown", onKey);
root.addEventListener("keydown", (event) => {
  if (event.key !== "z" || !(event.ctrlKey || event.metaKey) || event.target.closest("input, textarea")) return;
  event.preventDefault();
  outline.undo();
  changed();
});

svg.addEventListener("pointerdown", (event) => {
  wasDragged = false;
  const vertex = event.target.dataset.vertex;
  if (vertex === undefined || event.button) return;
  wasDragged = true; // the click that follows adds nothing
  dragged = outline.chosen = Number(vertex);
  outline.mark();
  svg.setPointerCapture(event.pointerId);
  changed();
});
svg.addEventListener("pointermove", (event) => {
  if (dragged < 0) return;
  outline.move(dragged, drawing.place(event));
  changed();
});
svg.addEventListener("lostpointercapture", () => {
  dragged = -1;
  outline.unmarkIfSame();
  changed();
});
svg.addEventListener("click", (event) => {
  const { grasp, whisker, edge } = event.target.dataset;
  if (grasp ?? whisker) return select(Number(grasp ?? whisker));
  if (wasDragged || edge !== undefined || event.detail > 1) return;
  outline.insert(outline.chosen < 0 ? outline.vertices.length - 1 : outline.chosen, drawing.place(event));
  changed();
});
svg.addEventListener("dblclick", (event) => {
  if (event.target.dataset.edge === undefined) return;
  outline.insert(Number(event.target.dataset.edge), drawing.place(event));
  changed();
});

list.addEventListener("click", (event) => {
  const row = event.target.closest("[data-row]");
  if (row) select(Number(row.dataset.row));
});
list.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1, Enter: 0 }[event.key];
  if (step === undefined) return;
  event.preventDefault();
  const next = Math.min(Math.max(Number(event.target.dataset.row) + step, 0), list.children.length - 1);
  list.children[next].focus({ preventScroll: true });
  select(next);
});

for (const button of root.querySelectorAll("[data-do]")) {
  button.addEventListener("click", () => {
    actions[button.dataset.do]();
    changed();
  });
}
axes.forEach((field, axis) => field.addEventListener("change", () => {
  const value = field.valueAsNumber;
  if (outline.chosen < 0 || !Number.isFinite(value)) return;
  outline.mark();
  outline.move(outline.chosen, outline.vertices[outline.chosen].map((old, one) => (one === axis ? value : old)));
  changed();
}));
picker.addEventListener("change", () => parts[picker.value] && show(parts[picker.value]));
settings.addEventListener("input", changed);
settings.addEventListener("submit", (event) => event.preventDefault());
text.addEventListener("submit", (event) => {
  event.preventDefault();
  use(text.elements.points.value);
});
document.addEventListener("paste", (event) => {
  if (event.target.closest?.("input, textarea")) return;
  use(event.clipboardData.getData("text"));
});
root.querySelectorAll("[data-save]").forEach((button) => button.addEventListener("click", () => {
  const kind = button.dataset.save;
  if (kind === "svg") saveAs("grasps.svg", "image/svg+xml", drawing.toText());
  if (kind === "csv") saveAs("grasps.csv", "text/csv", tableOf(answer?.grasps ?? []));
  if (kind === "json") saveAs("grasps.json", "application/json", JSON.stringify({ request: asked, answer }, null, 2));
}));
addEventListener("hashchange", restore);

root.hidden = false;
restore();
new ResizeObserver(() => {
  drawing.fit(outline.vertices);
  draw();
}).observe(svg);
