// Clouds as the server sends them: binary PLY, little-endian, x y z as float and r g b as bytes.

const ROW_BYTES = 15;

/**
 * Fetch a cloud.
 * @returns {Promise<{count: number, positions: Float32Array, colours: Float32Array, low: number[], high: number[]}>}
 */
export async function fetchCloud(address) {
  const response = await fetch(address);
  if (!response.ok) {
    const problem = await response.json().catch(() => ({ detail: response.statusText }));
    throw new Error(problem.detail);
  }
  return parsePly(await response.arrayBuffer());
}

/** Return the cloud in a file; same form as `fetchCloud`. */
export function parsePly(buffer) {
  const text = new TextDecoder("latin1").decode(buffer.slice(0, 512));
  const end = text.indexOf("end_header\n");
  const found = /element vertex (\d+)/.exec(text);
  if (end < 0 || !found) throw new Error("the cloud is no PLY file");
  const start = end + "end_header\n".length;
  const count = Math.min(Number(found[1]), Math.floor((buffer.byteLength - start) / ROW_BYTES));
  const data = new DataView(buffer, start);
  const positions = new Float32Array(3 * count);
  const colours = new Float32Array(3 * count);
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < count; i += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      const value = data.getFloat32(i * ROW_BYTES + 4 * axis, true);
      positions[3 * i + axis] = value;
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
      colours[3 * i + axis] = data.getUint8(i * ROW_BYTES + 12 + axis) / 255;
    }
  }
  return { count, positions, colours, low, high };
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
