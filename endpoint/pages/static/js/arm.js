// Arm and planning: two postures, obstacles, the path between them. All kinematics is the server's.

import { addressOf, readAddress, round } from "./arm_address.js";
import { ballRow, jointRow, pathRow } from "./arm_lists.js";
import { call, Newest, Refused } from "./calls.js";
import { element, explain } from "./dom.js";
import { chart } from "./chart.js";
import { numbersOf, pointOf, poseOf, spun, turned } from "./poses.js";
import { SpaceView } from "./space.js";

const KINEMATICS = "/services/example/Kinematics";
const PLANNING = "/services/example/Trajopt";
const SETTLE_MS = 150;
const FRAME_MS = 50;
const ARROW = 0.14; // length of a pose's arrow as a share of the arm
const root = document.querySelector("[data-arm-page]");
const find = (name) => root.querySelector(`[data-${name}]`);
const [svg, sliders, balls, problem, lost, said, results, paths, clearance, player] = [
  "drawing", "joints", "balls", "problem", "lost", "said", "results", "paths", "clearance", "player",
].map(find);
const [robotField, armField, settings, poseForm] = ["robot", "arm", "settings", "pose"].map(find);
const scenes = JSON.parse(root.dataset.scenes);
const view = new SpaceView(svg, remember);
const state = { robot: "", arm: "", start: [], goal: [], balls: [] };
let arms = {};
let shown = { start: null, goal: null }; // postures as the server traced them
let missed = null; // a pose that cannot be reached, and how far the arm came
let found = []; // paths: {name, path, length, postures}
let chosen = 0; // of the paths
let frame = 0;
let playing = 0;
let dragging = null;
let remembering = 0;
let asking = 0;

const told = {
  busy(is) {
    asking += is ? 1 : -1;
    svg.setAttribute("aria-busy", String(asking > 0));
  },
  problem(refused) {
    problem.hidden = !refused;
    explain(problem, refused);
  },
  link(since) {
    lost.hidden = !since;
    root.classList.toggle("stale", Boolean(since));
    lost.textContent = since ? `No answer from the server since ${since.toTimeString().slice(0, 5)}, trying again.` : "";
  },
};
const edited = () => root.querySelector("[name=edited]:checked").value;
const numbers = () => Object.fromEntries([...settings.elements].filter((one) => one.name && one.value !== "").map((one) => [one.name, Number(one.value)]));
const asked = (request) => ({ manipulator: state.arm, ...request, $data: { robot: state.robot } });
const scene = (request) => asked({ ...request, obstacles: state.balls, link_radius: numbers().link_radius ?? 0.02 });

// What is drawn

const tracing = new Newest(async () => {
  const path = [state.start, state.goal];
  const [start, goal] = await Promise.all(path.map((one) => call(`${PLANNING}/trace`, scene({ path: [one] }))));
  shown = { start: start.postures[0], goal: goal.postures[0] };
  draw();
  showPose();
}, told);

function reach() {
  const points = ["start", "goal"].flatMap((name) => shown[name]?.links.flatMap((link) => [link.slice(0, 3), link.slice(3)]) ?? []);
  return [...points, ...(found[chosen]?.postures.map((one) => pointOf(one.pose)) ?? [])];
}

function extent() {
  const around = state.balls.flatMap(([x, y, z, r]) => [[x - r, y - r, z - r], [x + r, y + r, z + r]]);
  return [[0, 0, 0], ...reach(), ...around];
}

function draw() {
  const radius = numbers().link_radius ?? 0.02;
  const robot = (posture, look) => posture?.links.map((link) => ({ kind: "link", from: link.slice(0, 3), to: link.slice(3), radius, look })) ?? [];
  const things = state.balls.map(([x, y, z, r], index) => ({ kind: "ball", at: [x, y, z], radius: r, look: "obstacle", data: { dragBall: index } }));
  for (const name of ["start", "goal"]) {
    const posture = shown[name];
    if (!posture) continue;
    const hit = posture.clearance !== null && posture.clearance < 0 ? "hit" : "";
    things.push(...robot(posture, `${name} ${hit} ${name === edited() && !found.length ? "" : "faint"}`));
    const at = pointOf(posture.pose);
    things.push({ kind: "label", at, text: name, look: name });
    if (name === edited()) things.push(...arrow(posture.pose));
  }
  found.forEach(({ postures }, index) => things.push({ kind: "line", points: postures.map((one) => pointOf(one.pose)), look: index === chosen ? "path" : "path other" }));
  things.push(...robot(found[chosen]?.postures[frame], "moving"));
  if (missed) things.push(...arrow(missed.wanted, "wanted"), { kind: "line", points: [missed.at, pointOf(missed.wanted)], look: "residual" });
  view.show(things);
}

function arrow(pose, look = "") {
  const from = pointOf(pose);
  const ahead = turned(pose, [1, 0, 0]).map((value) => value * ARROW * Math.max(size(), 0.2));
  const to = from.map((value, axis) => value + ahead[axis]);
  const arrows = [{ kind: "arrow", from, to, look }];
  if (look) return arrows;
  const grip = 9 / view.scale;
  return [...arrows, { kind: "ball", at: from, radius: grip, look: "grip", data: { dragPose: "move" } },
    { kind: "ball", at: to, radius: grip, look: "grip", data: { dragPose: "turn" } }];
}

const size = () => Math.max(...reach().map((point) => Math.hypot(...point)), 0);

// Postures

function listJoints() {
  const { joints, lower, upper } = arms[state.arm];
  sliders.replaceChildren(...joints.map((name, index) => jointRow(name, index, lower[index], upper[index])));
  fillJoints();
}

function fillJoints() {
  const joints = state[edited()];
  for (const field of sliders.querySelectorAll("[data-joint]")) {
    if (document.activeElement !== field || field.type === "range") field.value = String(round(joints[field.dataset.joint]));
  }
}

function showPose() {
  const posture = shown[edited()];
  const typing = document.activeElement.type === "number" && poseForm.contains(document.activeElement);
  if (!posture || typing) return;
  numbersOf(posture.pose).forEach((value, index) => (poseForm.elements[index].value = String(round(value))));
  if (!missed) said.textContent = posture.clearance === null ? "" : `clearance ${(100 * posture.clearance).toFixed(1)} cm`;
}

/** Take joint values within the limits for the posture that is edited. */
function setJoints(joints) {
  const { lower, upper } = arms[state.arm];
  state[edited()] = joints.map((value, index) => Math.min(Math.max(value, lower[index]), upper[index]));
  changed();
}

const solving = new Newest(async (pose) => {
  const answer = await call(`${KINEMATICS}/inverseKinematics`, asked({ pose, position_tolerance: 1e-3, rotation_tolerance: 1e-2 }));
  const now = state[edited()];
  const far = (q) => Math.max(...q.map((value, index) => Math.abs(value - now[index])));
  const reached = answer.solutions.length > 0;
  const best = reached ? answer.solutions.reduce((a, b) => (far(b) < far(a) ? b : a)) : answer.nearest;
  missed = null;
  if (!reached) {
    const { postures: [nearest] } = await call(`${PLANNING}/trace`, scene({ path: [best] }));
    missed = { wanted: pose, at: pointOf(nearest.pose) };
    said.textContent = `Out of reach: the hand stops ${(100 * answer.position_error).toFixed(1)} cm and ${(answer.rotation_error * 180 / Math.PI).toFixed(0)}° away.`;
  } else said.textContent = "reached";
  const kept = missed;
  setJoints(best);
  missed = kept;
}, told);

// The scene

function listBalls() {
  balls.replaceChildren(...state.balls.map(ballRow));
}

function addBall(at) {
  state.balls.push([...at.map(round), round(Math.max(size(), 0.2) / 10)]);
  listBalls();
  changed();
}

/** Show what was changed; a path that was planned before it is no longer shown. */
function changed() {
  if (found.length) forget();
  missed = null;
  fillJoints();
  tracing.ask(null);
  remember();
}

// Paths

function forget() {
  stop();
  [found, chosen, frame] = [[], 0, 0];
  results.hidden = true;
  draw();
}

async function attempt(name, method, request) {
  results.setAttribute("aria-busy", "true");
  said.textContent = `${name} …`;
  const began = performance.now();
  try {
    const { path, length } = await call(`${PLANNING}/${method}`, scene(request));
    const took = performance.now() - began;
    const { postures } = await call(`${PLANNING}/trace`, scene({ path }));
    told.problem(null);
    return { name, path, length, postures, took };
  } catch (error) {
    told.problem(error instanceof Refused ? error.problem : { detail: "The server does not answer. Try again." });
    said.textContent = "";
    return null;
  } finally {
    results.removeAttribute("aria-busy");
  }
}

async function plan() {
  forget();
  const { link_radius: _, ...rest } = numbers();
  const planned = await attempt("planned", "plan", { start: state.start, goal: state.goal, ...rest });
  if (!planned) return;
  found = [planned];
  showPaths(0);
  play();
}

async function smooth() {
  const before = found.at(-1);
  const smoothed = before && await attempt("smoothed", "smooth", { path: before.path });
  if (!smoothed) return;
  found = [found[0], smoothed];
  showPaths(1);
}

function showPaths(index) {
  [chosen, frame] = [index, 0];
  results.hidden = false;
  paths.replaceChildren(...found.map((one, number) => pathRow(one, number, number === chosen)));
  player.elements.at.max = String(found[chosen].postures.length - 1);
  clearance.replaceChildren(...chart(found.map(({ name, postures }) => ({ name, values: postures.map((one) => one.clearance) })).filter((line) => line.values[0] !== null), { unit: "m", label: "Clearance along the path", from: 0 }));
  said.textContent = `${found[chosen].name}: ${found[chosen].path.length} corners`;
  show(0);
}

function show(number) {
  frame = number;
  player.elements.at.value = String(number);
  draw();
}

function play() {
  stop();
  if (frame >= found[chosen].postures.length - 1) frame = 0;
  find("play").textContent = "Pause";
  playing = setInterval(() => {
    if (frame >= found[chosen].postures.length - 1) return stop();
    show(frame + 1);
  }, FRAME_MS);
}

function stop() {
  clearInterval(playing);
  playing = 0;
  find("play").textContent = "Play";
}

// Address

function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(() => {
    history.replaceState(null, "", `#${addressOf(state, view.camera)}`);
  }, SETTLE_MS);
}

/** Show a robot; what the address or the example does not say is chosen within the limits. */
async function useRobot(given) {
  forget();
  let described;
  try {
    described = await call(`${KINEMATICS}/describe`, { $data: { robot: given.robot } });
  } catch (error) {
    told.problem(error instanceof Refused ? error.problem : { detail: "The server does not answer. Reload the page." });
    return;
  }
  told.problem(null);
  arms = Object.fromEntries(described.manipulators.map((one) => [one.name, one]));
  state.robot = robotField.value = given.robot;
  armField.replaceChildren(...Object.keys(arms).map((name) => element("option", {}, name)));
  useArm(given);
}

function useArm(given) {
  state.arm = given.arm in arms ? given.arm : Object.keys(arms)[0];
  if (!state.arm) return told.problem({ detail: `${state.robot} has no moving joints.` });
  armField.value = state.arm;
  const { lower, upper } = arms[state.arm];
  const between = (share) => lower.map((low, index) => low + share * (upper[index] - low));
  const fits = (joints) => joints?.length === lower.length && joints.every(Number.isFinite);
  state.start = fits(given.start) ? given.start : between(0.35);
  state.goal = fits(given.goal) ? given.goal : between(0.65);
  state.balls = given.balls ?? [];
  shown = { start: null, goal: null };
  listJoints();
  listBalls();
  changed();
  const ready = new MutationObserver(() => {
    if (!shown.start) return;
    ready.disconnect();
    view.fit(extent());
    draw();
  });
  ready.observe(svg, { attributes: true, attributeFilter: ["data-drawn"] });
}

function restore() {
  const kept = readAddress(location.hash);
  const robot = kept.robot || robotField.value;
  view.look(kept.camera ?? scenes[robot]?.look ?? "free");
  return useRobot(kept.robot ? kept : { robot, ...structuredClone(scenes[robot]) });
}

// Events

robotField.addEventListener("change", () => {
  view.look(scenes[robotField.value]?.look ?? "free");
  useRobot({ robot: robotField.value, ...structuredClone(scenes[robotField.value]) });
});
armField.addEventListener("change", () => useArm({ arm: armField.value, balls: state.balls }));
sliders.addEventListener("input", (event) => {
  const value = event.target.valueAsNumber;
  if (!Number.isFinite(value)) return;
  setJoints(state[edited()].map((old, index) => (index === Number(event.target.dataset.joint) ? value : old)));
});
root.querySelectorAll("[name=edited]").forEach((one) => one.addEventListener("change", () => {
  missed = null;
  fillJoints();
  showPose();
  draw();
}));
poseForm.addEventListener("submit", (event) => {
  event.preventDefault();
  solving.ask(poseOf([0, 1, 2, 3, 4, 5].map((index) => Number(poseForm.elements[index].value))));
});
settings.addEventListener("input", changed);
settings.addEventListener("submit", (event) => event.preventDefault());
balls.addEventListener("change", (event) => {
  const { ball, axis } = event.target.dataset;
  if (ball === undefined || !Number.isFinite(event.target.valueAsNumber)) return;
  state.balls[ball][axis] = event.target.valueAsNumber;
  changed();
});
balls.addEventListener("click", (event) => {
  if (event.target.dataset.remove === undefined) return;
  state.balls.splice(Number(event.target.dataset.remove), 1);
  listBalls();
  changed();
});
const actions = {
  add: () => addBall(view.place({ clientX: svg.getBoundingClientRect().x + svg.clientWidth / 2, clientY: svg.getBoundingClientRect().y + svg.clientHeight / 2 })),
  fit: () => {
    view.fit(extent());
    draw();
  },
  plan, smooth,
  play: () => (playing ? stop() : play()),
};
root.querySelectorAll("[data-do]").forEach((button) => button.addEventListener("click", () => actions[button.dataset.do]()));
root.querySelectorAll("[data-look]").forEach((button) => button.addEventListener("click", () => {
  view.look(button.dataset.look);
  remember();
}));
paths.addEventListener("change", (event) => showPaths(Number(event.target.value)));
player.elements.at.addEventListener("input", () => {
  stop();
  show(Number(player.elements.at.value));
});
player.addEventListener("submit", (event) => event.preventDefault());
svg.addEventListener("dblclick", (event) => {
  if (event.target.dataset.dragBall === undefined) addBall(view.place(event));
});
svg.addEventListener("pointerdown", (event) => {
  const { dragBall, dragPose } = event.target.dataset;
  if (event.button || (dragBall ?? dragPose) === undefined) return;
  const pose = dragPose && shown[edited()].pose;
  dragging = { ball: dragBall, pose, turn: dragPose === "turn", x: event.clientX, y: event.clientY, from: dragBall && [...state.balls[dragBall]] };
  svg.setPointerCapture(event.pointerId);
});
svg.addEventListener("pointermove", (event) => {
  if (!dragging) return;
  const [dx, dy] = [event.clientX - dragging.x, event.clientY - dragging.y];
  if (dragging.ball !== undefined) {
    state.balls[dragging.ball] = [...view.moved(dragging.from.slice(0, 3), dx, dy).map(round), dragging.from[3]];
    listBalls();
    changed();
  } else if (dragging.turn) {
    const [x, y] = view.project(pointOf(dragging.pose));
    const box = svg.getBoundingClientRect();
    const angle = (px, py) => Math.atan2(-(py - box.y - y), px - box.x - x);
    solving.ask(spun(dragging.pose, view.axes[2], angle(event.clientX, event.clientY) - angle(dragging.x, dragging.y)));
  } else {
    const [x, y, z] = view.moved(pointOf(dragging.pose), dx, dy);
    solving.ask({ ...dragging.pose, position: { x, y, z } });
  }
});
svg.addEventListener("lostpointercapture", () => (dragging = null));
addEventListener("hashchange", restore);

root.hidden = false;
restore();
