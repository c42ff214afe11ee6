// A cloud with grippers from above, from the front and from the side, on one canvas. For browsers
// without WebGL, and where the 3D library is not installed.

const VIEWS = [["from above", 0, 1], ["from the front", 0, 2], ["from the side", 1, 2]];
const PICK_PX = 16;
const MAX_POINTS = 8000;
const HAND_M = 0.007; // thickness of fingers, palm and wrist

export function cloudIn2D(place, onPick) {
  const canvas = document.createElement("canvas");
  place.replaceChildren(canvas);
  let cloud = null;
  let colours = null;
  let grasps = [];
  let selected = -1;
  let segments = []; // what was drawn: index and places on the canvas

  /** Places on the canvas at which all three views fit, and their scale, px/m. */
  function layout() {
    const width = canvas.width / VIEWS.length;
    const ends = [0, 1, 2].map((axis) => {
      const values = grasps.flatMap((grasp) => grasp.lines.flatMap((line) => [line[axis], line[axis + 3]]));
      return [Math.min(cloud.low[axis], ...values), Math.max(cloud.high[axis], ...values)];
    });
    const span = Math.max(...ends.map(([low, high]) => high - low), 1e-6);
    const scale = (0.86 * Math.min(width, canvas.height)) / span;
    const places = VIEWS.map(([, a, b], number) => (point) => [
      width * (number + 0.5) + scale * (point[a] - (ends[a][0] + ends[a][1]) / 2),
      canvas.height / 2 - scale * (point[b] - (ends[b][0] + ends[b][1]) / 2),
    ]);
    return { places, scale };
  }

  function draw() {
    const ratio = Math.min(devicePixelRatio, 2);
    canvas.width = Math.max(1, place.clientWidth * ratio);
    canvas.height = Math.max(1, place.clientHeight * ratio);
    const paint = canvas.getContext("2d");
    paint.clearRect(0, 0, canvas.width, canvas.height);
    if (!cloud) return;
    const step = Math.max(1, Math.ceil(cloud.count / MAX_POINTS));
    const { places, scale } = layout();
    // Splats twice as wide as the distance of points on half of the surface of the object's box.
    const size = Math.hypot(...cloud.high.map((value, axis) => value - cloud.low[axis]));
    const splat = Math.min(Math.max((2 * scale * size) / Math.sqrt((2 * cloud.count) / step), 2 * ratio), 8 * ratio);
    segments = [];
    places.forEach((at, number) => {
      for (let i = 0; i < cloud.count; i += step) {
        const [r, g, b] = [0, 1, 2].map((part) => Math.round(255 * colours[3 * i + part]));
        paint.fillStyle = `rgb(${r} ${g} ${b})`;
        const [x, y] = at(cloud.positions.subarray(3 * i, 3 * i + 3));
        paint.fillRect(x - splat / 2, y - splat / 2, splat, splat);
      }
      grasps.forEach((grasp, index) => {
        paint.strokeStyle = index === selected ? grasp.marked : grasp.colour;
        paint.lineWidth = Math.max(HAND_M * scale, (index === selected ? 4 : 2) * ratio);
        paint.globalAlpha = selected < 0 || index === selected ? 0.9 : 0.25;
        paint.setLineDash(grasp.failed ? [8 * ratio, 3 * ratio] : []);
        for (const line of grasp.lines) {
          const [from, to] = [at(line.slice(0, 3)), at(line.slice(3))];
          paint.beginPath();
          paint.moveTo(...from);
          paint.lineTo(...to);
          paint.stroke();
          segments.push([index, from, to]);
        }
      });
      paint.globalAlpha = 1;
      paint.setLineDash([]);
      paint.fillStyle = getComputedStyle(place).color;
      paint.font = `${12 * ratio}px sans-serif`;
      paint.fillText(VIEWS[number][0], (canvas.width / VIEWS.length) * number + 8 * ratio, 16 * ratio);
    });
    place.dataset.drawn = String(Number(place.dataset.drawn ?? 0) + 1);
  }

  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect();
    const ratio = canvas.width / box.width;
    const [x, y] = [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
    let best = [PICK_PX * ratio, -1];
    for (const [index, from, to] of segments) {
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
      const along = Math.min(1, Math.max(0, ((x - from[0]) * dx + (y - from[1]) * dy) / (dx * dx + dy * dy || 1)));
      const distance = Math.hypot(from[0] + along * dx - x, from[1] + along * dy - y);
      if (distance < best[0]) best = [distance, index];
    }
    if (best[1] >= 0) onPick(best[1]);
  });
  new ResizeObserver(draw).observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  return {
    showCloud(newCloud, newColours) {
      [cloud, colours] = [newCloud, newColours];
      draw();
    },
    showGrippers(newGrasps, index) {
      [grasps, selected] = [newGrasps, index];
      draw();
    },
    lookAt() {},
    turn() {},
    camera: () => [],
    onTurned() {},
  };
}
