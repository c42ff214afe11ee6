// A robot and its surroundings in 3D as SVG: seen from far away, so that a ball is a circle and a
// thick link is a line with round ends. It can be turned, and needs no library and no WebGL.

const SVG = "http://www.w3.org/2000/svg";
const VIEWS = { top: [-Math.PI / 2, Math.PI / 2], side: [-Math.PI / 2, 0], front: [0, 0], free: [-1.1, 0.5] };
const TURN_PER_PX = 0.01;
const KEY_TURN = Math.PI / 24;
const FILLS = 0.8; // share of the window that things take up
const MIN_SIZE_M = 0.2;
const ON_TOP_M = 1e6;
const EDGE_PX = 4;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const made = (name, attributes) => {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  return one;
};

export class SpaceView {
  #things = [];
  #centre = [0, 0, 0];
  #size = 1;
  #zoom = 1;

  /** @param {SVGSVGElement} svg @param {() => void} onTurned */
  constructor(svg, onTurned = () => {}) {
    this.svg = svg;
    this.onTurned = onTurned;
    this.look("free");
    this.#listen();
    new ResizeObserver(() => this.draw()).observe(svg);
  }

  /** Look from one of the named sides, or at [yaw, pitch] in rad. */
  look(from) {
    [this.yaw, this.pitch] = typeof from === "string" ? VIEWS[from] : from;
    this.draw();
  }

  get camera() {
    return [this.yaw, this.pitch].map((angle) => Number(angle.toFixed(3)));
  }

  /** Direction on the screen to the right, upwards, and towards the viewer. */
  get axes() {
    const [sy, cy, sp, cp] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [cp * cy, cp * sy, sp]];
  }

  get scale() {
    return (this.#zoom * FILLS * Math.min(this.svg.clientWidth || 1, this.svg.clientHeight || 1)) / this.#size;
  }

  /** Return where a point (m) is on the screen (px), and how near to the viewer (m). */
  project(point) {
    const [right, up, near] = this.axes;
    const from = point.map((value, axis) => value - this.#centre[axis]);
    return [
      this.svg.clientWidth / 2 + this.scale * dot(from, right),
      this.svg.clientHeight / 2 - this.scale * dot(from, up),
      dot(from, near),
    ];
  }

  /** Return a point (m) moved on the screen by some px. */
  moved(point, dx, dy) {
    const [right, up] = this.axes;
    return point.map((value, axis) => value + (right[axis] * dx - up[axis] * dy) / this.scale);
  }

  /** Return the point (m) at a place of the window, in the plane through the middle of what is shown. */
  place(event) {
    const box = this.svg.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
    return this.moved(this.#centre, x, y);
  }

  /** Make some points (m) fill the window. */
  fit(points) {
    if (!points.length) return;
    const ends = [0, 1, 2].map((axis) => {
      const values = points.map((point) => point[axis]);
      return [Math.min(...values), Math.max(...values)];
    });
    this.#centre = ends.map(([low, high]) => (low + high) / 2);
    this.#size = Math.max(Math.hypot(...ends.map(([low, high]) => high - low)), MIN_SIZE_M);
    this.#zoom = 1;
  }

  /**
   * Show things: {kind: "link", from, to, radius}, {kind: "ball", at, radius}, {kind: "line", points},
   * {kind: "arrow", from, to} or {kind: "label", at, text}; each with `look`, its class, and `data`.
   */
  show(things) {
    this.#things = things;
    this.draw();
  }

  draw() {
    if (!this.svg.clientWidth) return;
    this.svg.setAttribute("viewBox", `0 0 ${this.svg.clientWidth} ${this.svg.clientHeight}`);
    const drawn = this.#things.flatMap((thing) => this.#drawn(thing)).sort((a, b) => a[0] - b[0]);
    this.svg.replaceChildren(...this.#floor(), ...drawn.map(([, shape]) => shape));
    for (const label of this.svg.querySelectorAll("text.label")) this.#keepInside(label);
    this.svg.dataset.drawn = String(Number(this.svg.dataset.drawn ?? 0) + 1);
  }

  /** Shift a name that would be cut off at the edge of the window, if its place is inside. */
  #keepInside(label) {
    const [x, box, window] = [Number(label.getAttribute("x")), label.getBoundingClientRect(), this.svg.getBoundingClientRect()];
    if (x < 0 || x > this.svg.clientWidth) return;
    const shift = Math.max(Math.min(0, window.right - EDGE_PX - box.right), window.left + EDGE_PX - box.left);
    if (shift < 0) label.setAttribute("x", x + shift);
  }

  /** Return pairs of nearness and shape. */
  #drawn({ kind, look = "", data = {}, ...thing }) {
    const finish = (name, attributes) => {
      const shape = made(name, { class: `${kind} ${look}`, ...attributes });
      Object.assign(shape.dataset, data);
      return shape;
    };
    if (kind === "ball") {
      const [cx, cy, near] = this.project(thing.at);
      return [[look === "grip" ? ON_TOP_M : near, finish("circle", { cx, cy, r: Math.max(this.scale * thing.radius, 2) })]];
    }
    if (kind === "label") {
      const [x, y] = this.project(thing.at);
      const text = finish("text", { x, y });
      text.textContent = thing.text;
      return [[ON_TOP_M, text]];
    }
    if (kind === "line") {
      const places = thing.points.map((point) => this.project(point));
      const points = places.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
      return [[Math.min(...places.map((place) => place[2])), finish("polyline", { points })]];
    }
    const [[x1, y1, a], [x2, y2, b]] = [this.project(thing.from), this.project(thing.to)];
    if (kind === "arrow") {
      const head = Math.atan2(y2 - y1, x2 - x1);
      const barbs = [-2.6, 2.6].map((turn) => [x2 + 12 * Math.cos(head + turn), y2 + 12 * Math.sin(head + turn)]);
      const points = [[x1, y1], [x2, y2], barbs[0], [x2, y2], barbs[1]].map((p) => p.join(",")).join(" ");
      return [[ON_TOP_M, finish("polyline", { points })]];
    }
    const width = Math.max(2 * this.scale * thing.radius, 3);
    const near = (a + b) / 2;
    const edge = finish("line", { x1, y1, x2, y2, "stroke-width": width });
    const inside = finish("line", { x1, y1, x2, y2, "stroke-width": Math.max(width - 3, 1) });
    inside.classList.add("inside");
    return [[near, edge], [near, inside]];
  }

  /** Return the grid at z = 0 round the middle, and the axes of the base. */
  #floor() {
    const step = 10 ** Math.floor(Math.log10(this.#size)) / 2;
    const [cx, cy] = this.#centre.map((value) => Math.round(value / step) * step);
    const far = Math.ceil(this.#size / step / 1.4) * step;
    let d = "";
    for (let offset = -far; offset <= far + 1e-9; offset += step) {
      for (const [from, to] of [[[cx - far, cy + offset, 0], [cx + far, cy + offset, 0]], [[cx + offset, cy - far, 0], [cx + offset, cy + far, 0]]]) {
        const [[x1, y1], [x2, y2]] = [this.project(from), this.project(to)];
        d += `M${x1.toFixed(1)} ${y1.toFixed(1)}L${x2.toFixed(1)} ${y2.toFixed(1)}`;
      }
    }
    const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis, number) => {
      const [[x1, y1], [x2, y2]] = [this.project([0, 0, 0]), this.project(axis.map((value) => value * 0.1 * this.#size))];
      return made("line", { x1, y1, x2, y2, class: `axis ${"xyz"[number]}` });
    });
    return [made("path", { d, class: "floor" }), ...axes];
  }

  #listen() {
    let last = null;
    this.svg.addEventListener("pointerdown", (event) => {
      if (event.button || Object.keys(event.target.dataset).some((key) => key.startsWith("drag"))) return;
      last = [event.clientX, event.clientY];
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.turn(-(event.clientX - last[0]) * TURN_PER_PX, (event.clientY - last[1]) * TURN_PER_PX);
      last = [event.clientX, event.clientY];
    });
    this.svg.addEventListener("lostpointercapture", () => {
      if (last) this.onTurned();
      last = null;
    });
    this.svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== this.svg) return; // the page scrolls
      event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1.1 : 1 / 1.1);
    }, { passive: false });
    this.svg.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      const zoom = { "+": 1.2, "-": 1 / 1.2 }[event.key];
      if (turn) this.turn(turn[0] * KEY_TURN, turn[1] * KEY_TURN);
      else if (zoom) this.zoom(zoom);
      else return;
      event.preventDefault();
      this.onTurned();
    });
  }

  /** Turn the camera about the vertical and upwards, rad. */
  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -Math.PI / 2), Math.PI / 2);
    this.draw();
  }

  zoom(factor) {
    this.#zoom *= factor;
    this.draw();
  }
}
