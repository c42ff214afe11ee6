// Draws a robot, its gripper and its sensor while they are described.

import { explain } from "./dom.js";
import { call, Newest } from "./calls.js";
import { SpaceView } from "./space.js";

const MIN_JAW_M = 0.01;
const DEFAULT_RANGE_M = [0.3, 3];
const form = document.querySelector("[data-setup]");
const views = Object.fromEntries([...form.querySelectorAll("[data-view]")].map((figure) => {
  figure.hidden = false;
  return [figure.dataset.view, { view: new SpaceView(figure.querySelector("svg")), said: figure.querySelector("[data-said]") }];
}));
const { stored, urdf } = form.elements;

/** Return a number that is filled in, by its name; else the alternative. */
function number(name, otherwise) {
  const value = form.elements[name]?.valueAsNumber;
  return Number.isFinite(value) ? value : otherwise;
}

function show({ view }, things, points) {
  view.fit(points);
  view.show(things);
}

function showRobot({ manipulators }) {
  const lines = manipulators.flatMap((arm) => arm.links);
  const points = lines.flatMap((line) => [line.slice(0, 3), line.slice(3)]);
  show(views.robot, lines.map((line) => ({ kind: "link", from: line.slice(0, 3), to: line.slice(3), radius: 0.015, look: "moving" })), [[0, 0, 0], ...points]);
  const arms = manipulators.map(({ name, joints }) => `${name}: ${joints.length} joints`);
  views.robot.said.textContent = arms.length ? arms.join("; ") : "No joint of it moves.";
}

const reading = new Newest(async ({ method, request }) => showRobot(await call(`${form.dataset.setup}/${method}`, request)), {
  busy: (is) => form.setAttribute("aria-busy", String(is)),
  problem: (refused) => refused && explain(views.robot.said, refused),
  link: (since) => since && (views.robot.said.textContent = "No answer from the server, trying again."),
});

async function readFile() {
  const bytes = new Uint8Array(await urdf.files[0].arrayBuffer());
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  reading.ask({ method: "read", request: { urdf: btoa(text) } });
}

function drawRobot() {
  if (urdf.files.length) readFile();
  else if (stored.value) reading.ask({ method: "describe", request: { $data: { robot: stored.value } } });
}

/** Jaws that close along x, a palm behind them; the pose of a grasp is between the tips. */
function drawGripper() {
  const name = (field) => `end_effectors.0.${field}`;
  const [most, least] = [number(name("max_opening"), 0.08), number(name("min_opening"), 0)];
  const [length, width] = [number(name("finger_length"), 0.05), Math.max(number(name("jaw_width"), 0.0124), MIN_JAW_M)];
  const radius = width / 2;
  const jaws = (opening, look) => [-1, 1].map((side) => ({ kind: "link", from: [side * (opening / 2 + radius), 0, length], to: [side * (opening / 2 + radius), 0, 0], radius, look }));
  const half = most / 2 + radius;
  show(views.gripper, [...jaws(least, "faint"), ...jaws(most, "moving"), { kind: "link", from: [-half, 0, length], to: [half, 0, length], radius, look: "start" },
    { kind: "label", at: [0, 0, 0], text: `${(1000 * most).toFixed(0)} mm` }], [[-half, 0, 0], [half, 0, length]]);
}

/** The pyramid that a pinhole camera sees, between its nearest and its farthest depth. */
function drawSensor() {
  const name = (field) => `cameras.0.${field}`;
  const [width, height] = [number(name("width"), 640), number(name("height"), 480)];
  const [fx, fy] = [number(name("fx"), width), number(name("fy"), number(name("fx"), width))];
  const [cx, cy] = [number(name("cx"), width / 2), number(name("cy"), height / 2)];
  const [near, far] = [number(name("min_range"), DEFAULT_RANGE_M[0]), number(name("max_range"), DEFAULT_RANGE_M[1])];
  // x right and y down in the image; drawn with the optical axis along x, z up.
  const corner = (depth) => ([u, v]) => [depth, -((u - cx) / fx) * depth, -((v - cy) / fy) * depth];
  const corners = [[0, 0], [width, 0], [width, height], [0, height]];
  const frames = [near, far].map((depth) => corners.map(corner(depth)));
  const rays = frames[1].map((end) => ({ kind: "line", points: [[0, 0, 0], end], look: "other" }));
  const [a, b] = [[width, fx], [height, fy]].map(([size, focal]) => (2 * Math.atan(size / 2 / focal) * 180) / Math.PI);
  show(views.sensor, [...rays, ...frames.map((points) => ({ kind: "line", points: [...points, points[0]] }))], [[0, 0, 0], ...frames[1]]);
  views.sensor.said.textContent = `Sees ${a.toFixed(0)}° by ${b.toFixed(0)}°, from ${near} to ${far} m.`;
}

stored.addEventListener("change", drawRobot);
urdf.addEventListener("change", drawRobot);
form.addEventListener("input", () => {
  drawGripper();
  drawSensor();
});
drawRobot();
drawGripper();
drawSensor();
