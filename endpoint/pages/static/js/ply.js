// Clouds as the server sends them: binary PLY, little-endian, x y z as float and r g b as bytes.

const ROW_BYTES = 15;
const FACE_BYTES = 13;
const UNSEEN = [0.62, 0.62, 0.62];

/**
 * Fetch a cloud.
 * @returns {Promise<{count: number, positions: Float32Array, colours: Float32Array, seen: Uint8Array,
 *   faces: Uint32Array, low: number[], high: number[]}>}
 */
export async function fetchCloud(address) {
  const response = await fetch(address);
  if (!response.ok) {
    const problem = await response.json().catch(() => ({ detail: response.statusText }));
    throw new Error(problem.detail);
  }
  return parsePly(await response.arrayBuffer());
}

/**
 * Return the cloud or surface in a file; same form as `fetchCloud`. A surface has its triangles as `faces`, and
 * `seen` says of each vertex whether it was measured (1) or filled in (0).
 */
export function parsePly(buffer) {
  const text = new TextDecoder("latin1").decode(buffer.slice(0, 512));
  const end = text.indexOf("end_header\n");
  const found = /element vertex (\d+)/.exec(text);
  if (end < 0 || !found) throw new Error("the cloud is no PLY file");
  const head = text.slice(0, end);
  const marks = head.includes("property uchar seen");
  const row = ROW_BYTES + Number(marks);
  const start = end + "end_header\n".length;
  const count = Math.min(Number(found[1]), Math.floor((buffer.byteLength - start) / row));
  const data = new DataView(buffer, start);
  const positions = new Float32Array(3 * count);
  const colours = new Float32Array(3 * count);
  const seen = new Uint8Array(count).fill(1);
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < count; i += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      const value = data.getFloat32(i * row + 4 * axis, true);
      positions[3 * i + axis] = value;
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
      colours[3 * i + axis] = data.getUint8(i * row + 12 + axis) / 255;
    }
    if (marks) seen[i] = data.getUint8(i * row + ROW_BYTES);
  }
  return { count, positions, colours, seen, faces: facesOf(head, data, count * row), low, high };
}

/** The corners of the triangles after the vertices, three numbers each; none of a cloud. */
function facesOf(head, data, start) {
  const promised = Number(/element face (\d+)/.exec(head)?.[1] ?? 0);
  const count = Math.min(promised, Math.floor((data.byteLength - start) / FACE_BYTES));
  const faces = new Uint32Array(3 * count);
  for (let i = 0; i < faces.length; i += 1) {
    faces[i] = data.getUint32(start + FACE_BYTES * Math.floor(i / 3) + 1 + 4 * (i % 3), true);
  }
  return faces;
}

/** Colours in which what was filled in is grey. */
export function greyWhereUnseen({ count, seen }, colours) {
  const marked = colours.slice();
  for (let i = 0; i < count; i += 1) if (!seen[i]) marked.set(UNSEEN, 3 * i);
  return marked;
}

/** Colours by height, blue below and yellow above, readable without red and green. */
export function byHeight({ count, positions, low, high }) {
  const colours = new Float32Array(3 * count);
  const span = Math.max(high[2] - low[2], 1e-6);
  for (let i = 0; i < count; i += 1) {
    const share = (positions[3 * i + 2] - low[2]) / span;
    colours.set([0.2 + 0.75 * share, 0.35 + 0.45 * share, 0.85 - 0.6 * share], 3 * i);
  }
  return colours;
}
