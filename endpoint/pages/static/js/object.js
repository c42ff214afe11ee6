// An object's cloud and grasps. The table, the arrow keys and the drawing select each other.

import { cloudIn2D } from "./cloud2d.js";
import { cloudIn3D } from "./cloud3d.js";
import { element } from "./dom.js";
import { byHeight, fetchCloud, greyWhereUnseen } from "./ply.js";

const TURN = Math.PI / 12;
const root = document.querySelector("[data-cloud]");
const place = root.querySelector("[data-place]");
const note = root.querySelector("[data-note]");
const source = root.querySelector("[data-source]");
const paint = root.querySelector("[data-paint]");
const rows = [...document.querySelectorAll("[data-grasp]")];
const grasps = rows.map((row) => {
  const { lines, attempts, successes } = JSON.parse(row.dataset.grasp);
  return { lines, attempts, failed: attempts > successes, ...colourOf(successes, attempts) };
});
const state = new URLSearchParams(location.hash.slice(1));
let view = null;
let cloud = null;
let selected = -1;

/**
 * From orange for grasps that always failed to blue for those that always held; grey for untried ones.
 * The share counts that the table shows as "held n of m": its lower bound is small for a grasp that held
 * twice of two, and would draw it as a failure.
 */
function colourOf(successes, attempts) {
  const share = attempts ? successes / attempts : 0;
  const mixed = [196 - 160 * share, 98 + 22 * share, 16 + 190 * share].map(Math.round);
  return { colour: attempts ? `rgb(${mixed.join(",")})` : "rgb(128,128,128)", marked: "rgb(214,39,140)" };
}

function remember() {
  if (selected >= 0) state.set("grasp", String(selected + 1));
  else state.delete("grasp");
  const camera = view?.camera() ?? [];
  if (camera.length) state.set("camera", camera.join(","));
  history.replaceState(null, "", `#${state}`);
}

function select(index, focus = false) {
  if (!rows.length) return;
  selected = (index + rows.length) % rows.length;
  rows.forEach((row, number) => {
    row.setAttribute("aria-selected", String(number === selected));
    row.tabIndex = number === selected ? 0 : -1;
  });
  if (focus) rows[selected].focus({ preventScroll: true });
  rows[selected].scrollIntoView({ block: "nearest" });
  view?.showGrippers(grasps, selected);
  remember();
}

function onKey(event, focus) {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  const turn = { ArrowLeft: -TURN, ArrowRight: TURN }[event.key];
  if (step) select(selected + (selected < 0 && step < 0 ? 0 : step), focus);
  else if (turn && view) {
    view.turn(turn);
    remember();
  } else if (event.key === "Escape") {
    selected = -1;
    rows.forEach((row) => row.setAttribute("aria-selected", "false"));
    view?.showGrippers(grasps, -1);
    remember();
  } else return;
  event.preventDefault();
}

/** Fetch the chosen cloud and show it. */
async function show(keepCamera) {
  note.textContent = "fetching the cloud …";
  try {
    const iri = root.dataset.cloud;
    cloud = await fetchCloud(
      source.value === "surface"
        ? `/object/mesh.ply?${new URLSearchParams({ iri })}`
        : `/object/cloud.ply?${new URLSearchParams({ iri, view: source.value })}`,
    );
  } catch (error) {
    note.textContent = `No cloud: ${error.message}`;
    return;
  }
  const size = cloud.high.map((value, axis) => ((value - cloud.low[axis]) * 100).toFixed(1));
  // What one view shows of an object is another size than the object's, which the page states.
  const extents = "sized" in root.dataset ? "" : `, ${size.join(" × ")} cm`;
  const parts = cloud.faces.length
    ? `${(cloud.faces.length / 3).toLocaleString("en")} triangles; grey: filled in, nobody saw it`
    : `${cloud.count.toLocaleString("en")} points`;
  note.textContent = `${parts}${extents}. ${place.dataset.kind}`;
  colour();
  if (!keepCamera) view.lookAt(cloud, state.get("camera")?.split(",").map(Number), grasps);
  view.showGrippers(grasps, selected);
}

function colour() {
  if (cloud) view.showCloud(cloud, greyWhereUnseen(cloud, paint.value === "height" ? byHeight(cloud) : cloud.colours));
}

async function newView() {
  const picked = (index) => select(index);
  if (root.dataset.viewer) {
    try {
      const three = await import(root.dataset.viewer);
      place.dataset.kind = "Drag to turn, wheel to zoom; arrow keys select and turn.";
      return cloudIn3D(three, place, picked);
    } catch (error) {
      note.title = error.message; // no WebGL: the flat views do the work
    }
  }
  const why = root.dataset.viewer ? "this browser has no WebGL" : "make setup with npm installed adds 3D";
  place.dataset.kind = `Flat views: ${why}.`;
  return cloudIn2D(place, picked);
}

async function start() {
  for (const { name, cloud: value } of JSON.parse(root.dataset.clouds)) source.append(element("option", { value }, name));
  root.hidden = false;
  view = await newView();
  source.addEventListener("change", () => show(true));
  paint.addEventListener("change", colour);
  place.addEventListener("keydown", (event) => onKey(event, false));
  view.onTurned(remember);
  rows.forEach((row, index) => {
    row.addEventListener("click", (event) => !event.target.closest("a") && select(index));
    row.addEventListener("focus", () => selected !== index && select(index));
    row.addEventListener("keydown", (event) => onKey(event, true));
  });
  if (rows.length) rows[0].tabIndex = 0;
  await show(false);
  const wanted = Number(state.get("grasp"));
  if (wanted >= 1 && wanted <= rows.length) select(wanted - 1);
}

start();
