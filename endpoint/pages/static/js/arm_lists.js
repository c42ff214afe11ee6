// Rows of the page of arms: a slider for each joint, the balls, the paths that were planned.

import { element } from "./dom.js";

const BALL = ["x", "y", "z", "radius"];

/** Return the slider and the field of a joint. */
export function jointRow(name, index, lower, upper) {
  const limits = { min: lower, max: upper, step: "any", "data-joint": index };
  return element("label", {}, element("span", {}, name), element("input", { type: "range", ...limits }),
    element("input", { type: "number", ...limits, "aria-label": `${name}, rad or m` }));
}

/** Return the row of a ball: where it is, and its radius. */
export function ballRow(ball, index) {
  const cells = ball.map((value, axis) => element("td", { "data-label": `${BALL[axis]} (m)` },
    element("input", { type: "number", step: "any", value: String(value), "data-ball": index, "data-axis": axis,
      "aria-label": `ball ${index + 1}, ${BALL[axis]} in m`, ...(axis === 3 ? { min: 0 } : {}) })));
  return element("tr", {}, element("th", { scope: "row" }, String(index + 1)), ...cells,
    element("td", {}, element("button", { type: "button", "data-remove": index, "aria-label": `Remove ball ${index + 1}` }, "Remove")));
}

/** Return the row of a path, with the radio button that chooses it. */
export function pathRow(path, index, isChosen) {
  const pick = element("input", { type: "radio", name: "path", value: index });
  pick.checked = isChosen;
  const near = nearestOf(path);
  const cells = {
    corners: path.path.length, length: path.length.toFixed(2),
    nearest: near === null ? "–" : `${(100 * near).toFixed(1)} cm`, took: `${path.took.toFixed(0)} ms`,
  };
  return element("tr", {}, element("th", { scope: "row" }, element("label", {}, pick, ` ${path.name}`)),
    ...Object.entries(cells).map(([label, cell]) => element("td", { "data-label": label }, String(cell))));
}

function nearestOf({ postures }) {
  const values = postures.map((one) => one.clearance).filter((value) => value !== null);
  return values.length ? Math.min(...values) : null;
}
