// Drawing of an outline with its whiskers (Kehoe 2014, Fig. 3.9). Coordinates are m, y upwards.

const NS = "http://www.w3.org/2000/svg";
const MARGIN_PX = 30;
const JAW_PX = 14; // as in the style sheet
const VERTEX_PX = matchMedia("(pointer: coarse)").matches ? 11 : 6;
const SAVED = ["fill", "fill-opacity", "stroke", "stroke-opacity", "stroke-width", "stroke-dasharray", "font-size", "font-family"];

function shape(name, attributes, words = "") {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = words;
  return made;
}

/** Return 1, 2 or 5 times a power of ten, at most `about`. */
function roundLength(about) {
  const ten = 10 ** Math.floor(Math.log10(about));
  return [5, 2, 1].map((factor) => factor * ten).find((length) => length <= about * (1 + 1e-9));
}

export class GraspDrawing {
  #view = { x: 0.05, y: 0.03, width: 0.2 }; // centre and width of what is seen, m

  constructor(svg) {
    this.svg = svg;
  }

  get #size() {
    return [Math.max(1, this.svg.clientWidth), Math.max(1, this.svg.clientHeight)];
  }

  get #scale() {
    return this.#size[0] / this.#view.width;
  }

  /** Distance by which an arrow key moves a vertex: a tenth of the grid. */
  get step() {
    return this.grid / 10;
  }

  get grid() {
    return roundLength(this.#view.width / 8);
  }

  get centre() {
    return [this.#view.x, this.#view.y];
  }

  /** Show the whole outline, with room for whiskers. */
  fit(vertices) {
    if (vertices.length < 2) return;
    const [low, high] = [0, 1].map((axis) => vertices.map((vertex) => vertex[axis]))
      .reduce(([l, h], values) => [[...l, Math.min(...values)], [...h, Math.max(...values)]], [[], []]);
    const [width, height] = this.#size;
    const spans = [high[0] - low[0], high[1] - low[1]];
    const reach = 0.7 * Math.max(...spans, 1e-6);
    const inner = [width - 2 * MARGIN_PX, height - 2 * MARGIN_PX].map((px) => Math.max(px, 1));
    const metresPerPx = Math.max((spans[0] + reach) / inner[0], (spans[1] + reach) / inner[1]);
    this.#view = { x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2, width: metresPerPx * width };
  }

  /** Return the place in the plane that an event of the pointer means. */
  place(event) {
    const box = this.svg.getBoundingClientRect();
    const [width, height] = this.#size;
    return [
      this.#view.x + (event.clientX - box.left - width / 2) / this.#scale,
      this.#view.y - (event.clientY - box.top - height / 2) / this.#scale,
    ];
  }

  #px([x, y]) {
    const [width, height] = this.#size;
    return [width / 2 + (x - this.#view.x) * this.#scale, height / 2 - (y - this.#view.y) * this.#scale];
  }

  #line(from, to, attributes) {
    const [[x1, y1], [x2, y2]] = [this.#px(from), this.#px(to)];
    return shape("line", { x1, y1, x2, y2, ...attributes });
  }

  #dot(at, r, attributes) {
    const [cx, cy] = this.#px(at);
    return shape("circle", { cx, cy, r, ...attributes });
  }

  /**
   * @param {{vertices: number[][], chosen: number}} outline
   * @param {object | null} answer of the service, for this outline or the one before
   * @param {number} selected grasp, or -1
   */
  draw(outline, answer, selected) {
    const [width, height] = this.#size;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const { vertices } = outline;
    const ring = vertices.map((vertex) => this.#px(vertex).join(",")).join(" ");
    this.svg.replaceChildren(
      ...this.#gridLines(width, height),
      shape("polygon", { points: ring, class: "part" }),
      ...vertices.map((vertex, index) => this.#line(vertex, vertices[(index + 1) % vertices.length],
        { class: "hit edge", "data-edge": index })),
      ...(answer ? this.#tolerances(vertices, answer.vertex_std) : []),
      ...(answer ? this.#grasps(answer, selected) : []),
      ...vertices.map((vertex, index) => this.#dot(vertex, VERTEX_PX,
        { class: index === outline.chosen ? "vertex chosen" : "vertex", "data-vertex": index })),
    );
  }

  #gridLines(width, height) {
    const { grid } = this;
    const px = grid * this.#scale;
    const [left, top] = this.#px([0, 0]).map((value) => ((value % px) + px) % px);
    let path = "";
    for (let x = left; x < width; x += px) path += `M${x} 0V${height}`;
    for (let y = top; y < height; y += px) path += `M0 ${y}H${width}`;
    const words = `grid: ${Number((grid * 1000).toPrecision(3))} mm`;
    return [shape("path", { d: path, class: "grid" }), shape("text", { x: 8, y: height - 8, class: "words" }, words)];
  }

  #tolerances(vertices, std) {
    return vertices.map((vertex) => this.#dot(vertex, 2 * std * this.#scale, { class: "tolerance" }));
  }

  #grasps(answer, selected) {
    const drawn = answer.grasps.flatMap((grasp, index) => {
      const state = index === selected ? " selected" : index === 0 ? " best" : "";
      if (grasp.probability <= 0) return [this.#dot(grasp.contact, 3.5, { class: `failed${state}`, "data-grasp": index })];
      return [
        this.#line(grasp.contact, grasp.whisker_end, { class: "hit", "data-grasp": index }),
        this.#line(grasp.contact, grasp.whisker_end, { class: `whisker${state}`, "data-whisker": index }),
      ];
    });
    const [best] = answer.grasps;
    if (best?.probability > 0) {
      const [x, y] = this.#px(best.whisker_end.map((end, axis) => end + 0.12 * (end - best.contact[axis])));
      drawn.push(shape("text", { x, y: y + 4, class: "words label" }, best.probability.toFixed(2)));
    }
    if (selected >= 0) drawn.push(...this.#jaws(answer.grasps[selected], answer.jaw_width));
    return drawn;
  }

  /** The pushing jaw at the contact, the other one at the opening that the part needs, and the beam between. */
  #jaws({ contact, approach, opening }, width) {
    const across = [-approach[1] * width / 2, approach[0] * width / 2];
    const out = JAW_PX / 2 / this.#scale; // the inner side of a jaw is where it touches
    const at = (distance) => contact.map((value, axis) => value + distance * approach[axis]);
    const jaws = [-out, opening + out].map(at).map((middle) =>
      this.#line(middle.map((v, axis) => v - across[axis]), middle.map((v, axis) => v + across[axis]), { class: "jaw" }));
    return [this.#line(at(-out), at(opening + out), { class: "beam" }), ...jaws];
  }

  /** Return the drawing as a document of its own, with the colours that it has now. */
  toText() {
    const copy = this.svg.cloneNode(true);
    const shapes = [...copy.children];
    [...this.svg.children].forEach((original, index) => {
      if (original.classList.contains("hit")) return shapes[index].remove();
      const style = getComputedStyle(original);
      for (const name of SAVED) shapes[index].setAttribute(name, style.getPropertyValue(name));
      shapes[index].removeAttribute("class");
    });
    for (const name of ["class", "tabindex", "role", "aria-label", "aria-describedby", "data-drawing"]) copy.removeAttribute(name);
    const [width, height] = this.#size;
    copy.setAttribute("width", width);
    copy.setAttribute("height", height);
    const ground = getComputedStyle(this.svg).backgroundColor;
    copy.prepend(shape("rect", { width, height, fill: ground }));
    return new XMLSerializer().serializeToString(copy);
  }
}
