// A gripper as a solid, shaded body: two fingers, a palm and a wrist.

const STRIPE_M = 0.008; // of a grasp that failed
const LIGHT = unit([0.35, -0.5, 0.8]);
// Thickness along the closing direction and width across it, m; of the palm, along the approach.
const FINGER_M = [0.008, 0.014];
const PALM_M = [0.014, 0.024];
const WRIST_M = 0.022; // diameter
const SIDES = 16; // of the wrist
const STEP_M = 0.002;

/**
 * Return the triangles of a hand: places, m, of their corners and colours, 0..1, three numbers each.
 *
 * @param {{lines: number[][], colour: string, marked: string, failed: boolean}} grasp with the lines of
 *   two fingers, the palm and the wrist
 * @param {boolean} isChosen
 */
export function solidHand(grasp, isChosen) {
  const [first, second, palm, wrist] = grasp.lines;
  const closing = unit(minus(palm.slice(0, 3), palm.slice(3)));
  const approach = unit(minus(first.slice(3), first.slice(0, 3)));
  const across = cross(approach, closing);
  const look = { tint: parts(isChosen ? grasp.marked : grasp.colour), failed: grasp.failed, places: [], colours: [] };
  const [thickness, width] = FINGER_M;
  const out = thickness / 2; // the inner side of a finger is where it touches
  addPrism(look, moved(first, closing, out), bar(closing, thickness, across, width));
  addPrism(look, moved(second, closing, -out), bar(closing, thickness, across, width));
  addPrism(look, longer(palm, closing, 1.5 * thickness), bar(approach, PALM_M[0], across, PALM_M[1]));
  addPrism(look, wrist, round(closing, across, WRIST_M / 2));
  return { places: look.places, colours: look.colours };
}

/** Return points, with their colours, so near to each other on the triangles of a hand that they close. */
export function splatsOf({ places, colours }) {
  const splats = { places: [], colours: [], size: 1.2 * STEP_M };
  for (let first = 0; first < places.length; first += 9) {
    const [a, b, c] = [0, 3, 6].map((corner) => places.slice(first + corner, first + corner + 3));
    const [u, v] = [minus(b, a), minus(c, a)];
    const count = Math.ceil(Math.max(Math.hypot(...u), Math.hypot(...v), Math.hypot(...minus(u, v))) / STEP_M);
    for (let i = 0; i <= count; i += 1) {
      for (let j = 0; i + j <= count; j += 1) {
        splats.places.push(...a.map((value, axis) => value + (u[axis] * i + v[axis] * j) / count));
        splats.colours.push(...colours.slice(first, first + 3));
      }
    }
  }
  return splats;
}

/** Return the corners of a rectangle about the origin, in order. */
function bar(u, thickness, v, width) {
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => u.map((value, k) => (a * value * thickness + b * v[k] * width) / 2));
}

/** Return the corners of a regular polygon about the origin, in order. */
function round(u, v, radius) {
  return Array.from({ length: SIDES }, (_, number) => {
    const angle = (2 * Math.PI * number) / SIDES;
    return u.map((value, k) => radius * (Math.cos(angle) * value + Math.sin(angle) * v[k]));
  });
}

/** Add the surface of a section that is moved along a line; of a grasp that failed, in stripes. */
function addPrism(look, line, section) {
  const [from, to] = [line.slice(0, 3), line.slice(3)];
  const along = minus(to, from);
  const pieces = look.failed ? Math.max(1, Math.round(Math.hypot(...along) / STRIPE_M)) : 1;
  const at = (corner, share) => corner.map((value, k) => from[k] + value + along[k] * share);
  for (let piece = 0; piece < pieces; piece += 1) {
    const tint = piece % 2 ? look.tint.map((part) => 0.35 * part + 0.65) : look.tint;
    const [low, high] = [piece / pieces, (piece + 1) / pieces];
    section.forEach((corner, number) => {
      const next = section[(number + 1) % section.length];
      const normal = unit(corner.map((value, k) => value + next[k]));
      addFace(look, [at(corner, low), at(next, low), at(next, high), at(corner, high)], normal, tint);
    });
  }
  for (const [share, side] of [[0, -1], [1, 1]]) {
    const tint = share && look.failed && pieces % 2 === 0 ? look.tint.map((part) => 0.35 * part + 0.65) : look.tint;
    addFace(look, section.map((corner) => at(corner, share)), unit(along).map((value) => side * value), tint);
  }
}

/** Add a flat, convex face as triangles, as bright as the light from above makes it. */
function addFace(look, corners, normal, tint) {
  const light = 0.5 + 0.5 * Math.max(0, dot(normal, LIGHT));
  for (let number = 1; number + 1 < corners.length; number += 1) {
    for (const corner of [corners[0], corners[number], corners[number + 1]]) {
      look.places.push(...corner);
      look.colours.push(...tint.map((part) => light * part));
    }
  }
}

const parts = (colour) => colour.match(/\d+/g).map((part) => Number(part) / 255);
const moved = (line, by, length) => line.map((value, k) => value + by[k % 3] * length);
const longer = (line, by, length) => line.map((value, k) => value + (k < 3 ? 1 : -1) * by[k % 3] * length);
const minus = (a, b) => a.map((value, axis) => value - b[axis]);
const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];

function unit(vector) {
  const length = Math.hypot(...vector) || 1;
  return vector.map((value) => value / length);
}
