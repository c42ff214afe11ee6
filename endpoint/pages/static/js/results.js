// Draws what an answer holds: poses as arrows, clouds, curves.

import { chart } from "./chart.js";
import { cloudIn2D } from "./cloud2d.js";
import { cloudIn3D } from "./cloud3d.js";
import { element } from "./dom.js";
import { parsePly } from "./ply.js";
import { pointOf, turned } from "./poses.js";
import { SpaceView } from "./space.js";

const ARROW = 0.15; // as a share of what is shown
const MIN_ARROW_M = 0.02;

function showPoses(figure) {
  const poses = JSON.parse(figure.dataset.poses);
  const points = poses.map(({ pose }) => pointOf(pose));
  figure.hidden = false;
  const view = new SpaceView(figure.querySelector("svg"));
  view.fit([[0, 0, 0], ...points]);
  const size = Math.max(MIN_ARROW_M, ARROW * Math.max(...points.map((point) => Math.hypot(...point))));
  view.show(poses.flatMap(({ name, pose }) => {
    const from = pointOf(pose);
    const to = turned(pose, [size, 0, 0]).map((value, axis) => value + from[axis]);
    return [{ kind: "arrow", from, to }, { kind: "label", at: from, text: name }];
  }));
}

async function showClouds(figure) {
  const clouds = JSON.parse(figure.dataset.clouds);
  const [source, place, note] = ["source", "place", "note"].map((name) => figure.querySelector(`[data-${name}]`));
  figure.hidden = false;
  source.append(...clouds.map(({ name }, index) => element("option", { value: index }, name)));
  let view = null;
  if (figure.dataset.viewer) {
    try {
      view = cloudIn3D(await import(figure.dataset.viewer), place, () => {});
    } catch (error) {
      note.title = error.message; // no WebGL: the flat views do the work
    }
  }
  view ??= cloudIn2D(place, () => {});
  const show = () => {
    const { buffer } = Uint8Array.from(atob(clouds[Number(source.value)].ply), (character) => character.charCodeAt(0));
    const cloud = parsePly(buffer);
    view.showCloud(cloud, cloud.colours);
    view.lookAt(cloud);
    note.textContent = `${cloud.count.toLocaleString("en")} points shown`;
  };
  source.addEventListener("change", show);
  show();
}

/** Draw what the answers in an element hold. */
export function showResults(root) {
  for (const figure of root.querySelectorAll("[data-poses]")) showPoses(figure);
  for (const figure of root.querySelectorAll("[data-clouds]")) showClouds(figure);
  for (const figure of root.querySelectorAll("[data-curves]")) {
    const { name, lines } = JSON.parse(figure.dataset.curves);
    figure.replaceChildren(...chart(lines, { label: name }));
    figure.hidden = false;
  }
}

showResults(document);
