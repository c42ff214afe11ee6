// The outline that is edited: its vertices in m, the chosen one, and the states that undo restores.

const MAX_UNDO = 100;
const LEAST_M2 = 1e-12; // below what vertices to a micrometre can span
const round = (value) => Number(value.toFixed(6)); // to a micrometre

export class Outline {
  #past = [];
  vertices = [];
  chosen = -1;

  /** Whether all vertices lie on one line, as while a third one is placed: there is no part yet. */
  get isFlat() {
    const [first, ...others] = this.vertices;
    const sides = others.map(([x, y]) => [x - first[0], y - first[1]]);
    return sides.every(([x, y]) => sides.every(([u, v]) => Math.abs(x * v - y * u) < LEAST_M2));
  }

  /** Remember the present state for undo. */
  mark() {
    this.#past.push({ vertices: this.vertices.map((vertex) => [...vertex]), chosen: this.chosen });
    if (this.#past.length > MAX_UNDO) this.#past.shift();
  }

  /** Forget the state remembered last if nothing was moved since. */
  unmarkIfSame() {
    if (JSON.stringify(this.#past.at(-1)?.vertices) === JSON.stringify(this.vertices)) this.#past.pop();
  }

  undo() {
    Object.assign(this, this.#past.pop() ?? {});
  }

  replace(vertices) {
    if (this.vertices.length || this.#past.length) this.mark(); // the first outline cannot be undone
    this.vertices = vertices.map((vertex) => vertex.map(round));
    this.chosen = -1;
  }

  /** Insert a vertex after another one, and choose it. */
  insert(after, point) {
    this.mark();
    this.vertices.splice(after + 1, 0, point.map(round));
    this.chosen = after + 1;
  }

  /** Insert a vertex in the middle of the edge that starts at the chosen one. */
  split() {
    const at = this.chosen < 0 ? this.vertices.length - 1 : this.chosen;
    const [a, b] = [this.vertices[at], this.vertices[(at + 1) % this.vertices.length]];
    this.insert(at, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
  }

  move(index, point) {
    this.vertices[index] = point.map(round);
  }

  remove() {
    if (this.chosen < 0) return;
    this.mark();
    this.vertices.splice(this.chosen, 1);
    this.chosen = Math.min(this.chosen, this.vertices.length - 1);
  }

  /** Choose the vertex a number of places further on, round the outline. */
  step(places) {
    const count = this.vertices.length;
    if (!count) return;
    if (this.chosen < 0) this.chosen = places > 0 ? 0 : count - 1;
    else this.chosen = (this.chosen + places + count) % count;
  }
}

/**
 * Return the points of a text: JSON, or pairs of numbers separated by lines or semicolons.
 * @throws {Error} with words for the person who typed it
 */
export function readPoints(text) {
  const trimmed = text.trim();
  let points;
  try {
    points = trimmed.startsWith("[") ? JSON.parse(trimmed)
      : trimmed.split(/[\n;]+/).filter((line) => line.trim()).map((line) => line.trim().split(/[\s,]+/).map(Number));
  } catch (error) {
    throw new Error(`The outline is not JSON that can be read: ${error.message}`);
  }
  const wrong = Array.isArray(points) ? points.findIndex((one) => !isPoint(one)) : 0;
  if (wrong >= 0) throw new Error(`Point ${wrong + 1} of the outline is not a pair of numbers [x, y].`);
  return points;
}

function isPoint(one) {
  return Array.isArray(one) && one.length === 2 && one.every(Number.isFinite);
}
