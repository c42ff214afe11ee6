// Lines over a count as SVG, with their values as a table for those who do not see them.

import { element } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT, LEFT, BOTTOM, TOP] = [360, 140, 44, 18, 16];

function shape(name, attributes, text = "") {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  one.textContent = text;
  return one;
}

/**
 * Return the elements of a chart.
 * @param {{name: string, values: number[]}[]} lines
 * @param {{label: string, unit?: string, from?: number}} options `from` is always on the axis
 */
export function chart(lines, { label, unit = "", from = 0 }) {
  if (!lines.length) return [];
  const values = lines.flatMap((line) => line.values);
  const [low, high] = [Math.min(from, ...values), Math.max(from, ...values)];
  const y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low || 1));
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label, class: "chart" });
  for (const value of new Set([low, from, high])) {
    svg.append(shape("line", { x1: LEFT, x2: WIDTH, y1: y(value), y2: y(value), class: "rule" }));
    svg.append(shape("text", { x: LEFT - 4, y: y(value) + 4, "text-anchor": "end" }, value.toPrecision(2)));
  }
  lines.forEach(({ values: line }, number) => {
    const x = (index) => LEFT + ((WIDTH - LEFT) * index) / Math.max(line.length - 1, 1);
    svg.append(shape("polyline", { points: line.map((value, index) => `${x(index).toFixed(1)},${y(value).toFixed(1)}`).join(" "), class: `curve c${number}` }));
  });
  const legend = lines.map(({ name }, number) => element("span", { class: `key c${number}` }, name));
  const table = element("table", {}, ...lines.map(({ name, values: line }) => element("tr", {}, element("th", { scope: "row" }, name), ...line.map((value) => element("td", {}, value.toPrecision(3))))));
  return [element("p", { class: "quiet" }, `${label}${unit && ` (${unit})`} `, ...legend), svg,
    element("details", {}, element("summary", {}, "as numbers"), element("div", { class: "scroll" }, table))];
}
