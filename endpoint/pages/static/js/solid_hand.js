// A gripper as a body of shaded splats: two fingers, a palm and a wrist.

const STEP_M = 0.002;
const SPLAT_M = 0.0024;
const STRIPE_M = 0.008; // of a grasp that failed
const LIGHT = unit([0.35, -0.5, 0.8]);
// Thickness along the closing direction and width across it, m; of the palm, along the approach.
const FINGER_M = [0.006, 0.012];
const PALM_M = [0.01, 0.016];
const WRIST_M = [0.016, 0.014];

/**
 * Return the splats of a hand: places, m, and colours, 0..1, three numbers each.
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
  const out = FINGER_M[0] / 2; // the inner side of a finger is where it touches
  addBar(look, moved(first, closing, out), closing, across, FINGER_M);
  addBar(look, moved(second, closing, -out), closing, across, FINGER_M);
  addBar(look, longer(palm, closing, FINGER_M[0]), approach, across, PALM_M);
  addBar(look, wrist, closing, across, WRIST_M);
  return { ...look, size: SPLAT_M };
}

/** Add the surface of a bar along a line, with its thickness and width along two directions. */
function addBar(look, line, thick, wide, [thickness, width]) {
  const [from, to] = [line.slice(0, 3), line.slice(3)];
  const along = minus(to, from);
  const length = Math.hypot(...along);
  const axes = [[unit(along), length], [thick, thickness], [wide, width]];
  const middle = from.map((value, axis) => (value + to[axis]) / 2);
  for (const [face, [normal, depth]] of axes.entries()) {
    const [[u, sizeU], [v, sizeV]] = axes.filter((_, other) => other !== face);
    for (const side of [-1, 1]) {
      const light = 0.55 + 0.45 * Math.max(0, side * dot(normal, LIGHT));
      for (const a of steps(sizeU)) {
        for (const b of steps(sizeV)) {
          const place = middle.map((value, k) => value + (side * normal[k] * depth) / 2 + u[k] * a + v[k] * b);
          const isPale = look.failed && Math.floor((dot(minus(place, from), axes[0][0]) + 1) / STRIPE_M) % 2 === 0;
          look.places.push(...place);
          look.colours.push(...look.tint.map((part) => light * (isPale ? 0.35 * part + 0.65 : part)));
        }
      }
    }
  }
}

/** Return places across a length, from its middle. */
function steps(length) {
  const count = Math.max(2, Math.ceil(length / STEP_M));
  return Array.from({ length: count }, (_, number) => length * (number / (count - 1) - 0.5));
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
