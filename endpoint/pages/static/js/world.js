// Draws the world at a time, and at any other time that one slides to.

import { Newest, problemOf, Refused } from "./calls.js";
import { element, explain } from "./dom.js";
import { SpaceView } from "./space.js";

const AXIS_M = 0.12;
const DOT_M = 0.03; // of a thing whose size nobody knows
const ROBOT_M = 0.08;
const REACH_M = 0.4; // of a robot, to either side: so much round it is shown
const RIM_M = 0.05;
const ABOVE_M = 0.08; // of the names of what lies in a place, above that of the place
const MAX_NAMES = 3; // of what is somewhere in one place
const PROBABLE = 0.5;
const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
const RELATIONS = { on: "on", in: "in", held_by: "held by", at: "" };

const root = document.querySelector("[data-world]");
if (root) start();

function start() {
  const find = (name) => document.querySelector(`[data-${name}]`);
  root.hidden = false;
  const view = new SpaceView(find("drawing"));
  const slider = find("slider");
  let scene = JSON.parse(root.dataset.scene);
  draw(true);

  function draw(isNew) {
    const shapes = shapesOf(scene);
    if (isNew) view.fit(shapes.points);
    view.show(shapes.things);
  }

  for (const button of root.querySelectorAll("[data-look]")) button.addEventListener("click", () => view.look(button.dataset.look));
  root.querySelector("[data-do=fit]").addEventListener("click", () => draw(true));
  if (!slider) return;
  slider.closest("[data-slide]").hidden = false;
  const newest = new Newest(async (at) => {
    const asked = new URLSearchParams({ at: new Date(at * 1000).toISOString() });
    if (scene.root) asked.set("frame", root.dataset.frame || scene.root);
    const response = await fetch(`/world.json?${asked}`);
    const body = await response.text();
    if (!response.ok) throw new Refused(problemOf(response, body));
    const answer = JSON.parse(body);
    if (answer.problem) throw new Refused({ detail: answer.problem });
    scene = answer.scene;
    draw(false);
    list(scene, find);
    follow(answer, asked);
  }, {
    busy: (is) => root.setAttribute("aria-busy", String(is)),
    problem: (refused) => {
      find("problem").hidden = !refused;
      if (refused) explain(find("problem"), refused);
    },
    link: (since) => {
      find("problem").hidden = !since;
      if (since) find("problem").textContent = "No answer from the server, trying again.";
    },
  });
  slider.addEventListener("input", () => newest.ask(slider.valueAsNumber));
}

/** Let the links, the field and the address follow the time that is shown. */
function follow(answer, asked) {
  document.querySelector("form[aria-label='A time'] [name=at]").value = answer.at;
  history.replaceState(null, "", `/world?${asked}`);
  for (const link of document.querySelectorAll("[data-export]")) link.href = answer.exports[link.dataset.export];
  for (const name of ["before", "after"]) {
    const link = document.querySelector(`[data-${name}]`);
    const at = answer.span?.[name];
    if (!link) continue;
    link.hidden = !at;
    if (at) link.href = `/world?${new URLSearchParams({ ...Object.fromEntries(asked), at })}`;
  }
}

function list(scene, find) {
  const things = scene.nodes.filter((node) => node.kind === "thing");
  const robots = scene.nodes.filter((node) => node.kind === "robot");
  const many = (count, name) => `${count} ${name}${count === 1 ? "" : "s"}`;
  find("said").textContent = `${when(scene.time)} UTC: ${many(things.length, "thing")}, ${many(robots.length, "robot")}${scene.root ? ` in the frame ${scene.root_name}` : ""}.`;
  const cell = (label, ...children) => element("td", { "data-label": label }, ...children);
  find("things").replaceChildren(...things.map((node) => element("tr", {},
    cell("Thing", about(node)),
    cell("In frame", node.above),
    cell("x, y, z (m)", node.somewhere ? "not known" : [0, 1, 2].map((axis) => node.pose[axis][3].toFixed(3)).join(", ")),
    cell("Place", `${RELATIONS[node.relation]} ${node.placeLabel ?? ""}`),
    cell("Still there", about(node, `${Math.round(100 * node.stillThere)} %`, { class: "figure", "data-figure": "", title: "Why? What this rests on" })),
    cell("Last seen", when(node.seen)))));
  if (!things.length) find("things").append(element("tr", {}, element("td", { colspan: "6" }, "Nothing was known to be here at that time.")));
  find("unplaced-section").hidden = !scene.unplaced.length;
  find("unplaced").replaceChildren(...scene.unplaced.map((one) => element("li", {}, about(one), `: ${one.reason}`)));
  if (scene.more_unplaced) find("unplaced").append(element("li", {}, `${scene.more_unplaced} more`));
}

/** A thing as a link to all that is stated about it. */
function about({ iri, label }, text = label, attributes = {}) {
  return element("a", { href: `/resource?${new URLSearchParams({ iri })}`, ...attributes }, text);
}

function when(time) {
  return time.slice(0, 19).replace("T", " ");
}

/** Return a point of a node in the root of the scene. */
function at(pose, point) {
  return [0, 1, 2].map((axis) => pose[axis][0] * point[0] + pose[axis][1] * point[1] + pose[axis][2] * point[2] + pose[axis][3]);
}

/** Return what the drawing shows, and the points that it must fit in. */
function shapesOf(scene) {
  const things = [];
  const points = [];
  const within = new Map(); // what lies in or on one place, by its pose
  for (const [number, node] of scene.nodes.entries()) {
    const origin = at(node.pose, [0, 0, 0]);
    points.push(origin);
    if (node.kind === "frame") {
      for (const [axis, look] of [[[AXIS_M, 0, 0], "x"], [[0, AXIS_M, 0], "y"], [[0, 0, AXIS_M], "z"]]) things.push({ kind: "line", points: [origin, at(node.pose, axis)], look: `axis ${look}` });
      const body = scene.nodes.find((one) => (one.kind === "robot" || one.kind === "place") && one.parent === number);
      if (!body) things.push({ kind: "label", at: origin, text: node.label, look: "frame" });
      const outline = body?.kind === "place" && body.size ? null : seenOn(scene, number);
      if (outline) things.push({ kind: "line", points: outline, look: "other" });
    } else if (node.kind === "robot") {
      things.push({ kind: "ball", at: at(node.pose, [0, 0, ROBOT_M]), radius: ROBOT_M, look: "robot" });
      things.push({ kind: "label", at: at(node.pose, [0, 0, -ROBOT_M]), text: node.label });
      for (const side of [-REACH_M, REACH_M]) points.push(at(node.pose, [side, side, 0]));
    } else if (node.kind === "place") {
      if (node.size) {
        const corners = boxOf(node);
        points.push(...corners);
        // A table is a plate; a box has walls as high as its rim.
        for (const [a, b] of EDGES) if (node.size[2] || (a % 2 === 0 && b % 2 === 0)) things.push({ kind: "line", points: [corners[a], corners[b]], look: "place" });
      }
      const where = JSON.stringify(node.pose); // where its name is in that of what lies there
      if (!scene.nodes.some((one) => one.somewhere && JSON.stringify(one.pose) === where)) things.push({ kind: "label", at: at(node.pose, [node.size ? node.size[0] / 2 : 0, 0, 0]), text: node.label, look: "place" });
    } else if (node.kind === "thing" && node.poseOf === "place") {
      const where = JSON.stringify(node.pose);
      if (!within.has(where)) within.set(where, { node, names: [] });
      within.get(where).names.push(node.label);
    } else if (node.kind === "thing") {
      const look = node.stillThere >= PROBABLE ? "thing" : "thing faint";
      const top = node.size ? [0, 0, node.size[2]] : [0, 0, DOT_M];
      if (node.size) {
        const corners = boxOf(node);
        points.push(...corners);
        for (const [a, b] of EDGES) things.push({ kind: "line", points: [corners[a], corners[b]], look });
      } else things.push({ kind: "ball", at: at(node.pose, [0, 0, DOT_M / 2]), radius: DOT_M / 2, look });
      things.push({ kind: "label", at: at(node.pose, top), text: node.label, look });
    }
  }
  for (const { node, names } of within.values()) {
    if (node.region) {
      const corners = boxOf({ pose: node.pose, size: node.region });
      points.push(...corners);
      things.push({ kind: "line", points: [0, 2, 6, 4, 0].map((corner) => corners[corner + 1]), look: "other" });
    }
    const shown = names.length > MAX_NAMES ? [...names.slice(0, MAX_NAMES), `${names.length - MAX_NAMES} more`] : names;
    things.push({ kind: "label", at: at(node.pose, [0, 0, ABOVE_M]), text: `${node.somewhere}: ${shown.join(", ")}`, look: "thing" });
  }
  return { things, points };
}

/** The corners of a thing's box; its origin is the middle of its footprint. */
function boxOf({ pose, size: [x, y, z] }) {
  const corners = [];
  for (const a of [-0.5, 0.5]) for (const b of [-0.5, 0.5]) for (const c of [0, 1]) corners.push(at(pose, [a * x, b * y, c * z]));
  return corners;
}

/** The outline of what was seen directly on a frame, in its plane; null if there are fewer than two. */
function seenOn(scene, number) {
  const { pose } = scene.nodes[number];
  const on = scene.nodes.filter((node) => node.kind === "thing" && node.parent === number && node.poseOf !== "place");
  if (on.length < 2) return null;
  const local = on.map((node) => {
    const apart = [0, 1, 2].map((axis) => node.pose[axis][3] - pose[axis][3]);
    return [0, 1].map((axis) => [0, 1, 2].reduce((sum, row) => sum + pose[row][axis] * apart[row], 0));
  });
  const [low, high] = [Math.min, Math.max].map((most, side) => [0, 1].map((axis) => most(...local.map((place) => place[axis])) + (side ? RIM_M : -RIM_M)));
  return [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]], [low[0], low[1]]].map(([x, y]) => at(pose, [x, y, 0]));
}
