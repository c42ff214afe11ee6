// A cloud with grippers in 3D, by three.js. Draws only when something changes.

import { solidHand, splatsOf } from "./solid_hand.js";

const UP = [0, 0, 1];
const PICK_PX = 24;
const FIELD_DEG = 40;
const LIGHT = [0.36, -0.48, 0.8];
const SEEN_M = 0.13; // at least so much is seen: a hand is larger than many things
const FAINT = 0.15; // opacity of the hands that are not selected
const FAINT_SPLAT = 0.02; // where many lie on each other
const BOTH_SIDES = 2; // the library's DoubleSide
const PICKED = 12; // places along each line of a hand at which it can be picked
const SPLAT = 1 / Math.tan((FIELD_DEG * Math.PI) / 360); // the library's size of points leaves the field of view out

/** Colours of corners under a light from above and the front, so that a shape shows without its print. */
function shaded({ positions, faces }, colours) {
  const normals = new Float32Array(positions.length);
  const corner = (k) => positions.subarray(3 * k, 3 * k + 3);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [corner(faces[f]), corner(faces[f + 1]), corner(faces[f + 2])];
    const [u, v] = [b, c].map((p) => [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    const across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (let k = f; k < f + 3; k += 1) across.forEach((value, axis) => (normals[3 * faces[k] + axis] += value));
  }
  return colours.map((value, at) => {
    const [x, y, z] = normals.subarray(at - (at % 3), at - (at % 3) + 3);
    const towards = (LIGHT[0] * x + LIGHT[1] * y + LIGHT[2] * z) / (Math.hypot(x, y, z) || 1);
    return value * (0.6 + 0.4 * towards);
  });
}

/** Return places along a line, m. */
function placesOn(line) {
  return Array.from({ length: PICKED }, (_, number) => {
    const share = number / (PICKED - 1);
    return [0, 1, 2].map((axis) => (1 - share) * line[axis] + share * line[axis + 3]);
  });
}

/** Return the lowest and the highest corner, m, round a cloud and the lines of grippers. */
function roundAll(cloud, lines) {
  const ends = lines.flatMap((line) => [line.slice(0, 3), line.slice(3)]);
  return [[Math.min, cloud.low], [Math.max, cloud.high]].map(([most, corner]) =>
    corner.map((value, axis) => most(value, ...ends.map((end) => end[axis]))));
}

/**
 * @param {object} three the bundled library
 * @param {HTMLElement} place where the canvas goes
 * @param {(index: number) => void} onPick
 */
export function cloudIn3D(three, place, onPick) {
  const renderer = new three.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  const scene = new three.Scene();
  const camera = new three.PerspectiveCamera(FIELD_DEG, 1, 0.005, 20);
  camera.up.set(...UP);
  const controls = new three.OrbitControls(camera, renderer.domElement);
  const grippers = new three.Group();
  let points = null;
  let due = 0;
  scene.add(grippers);
  place.replaceChildren(renderer.domElement);
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));

  function draw() {
    due = 0;
    scene.background = new three.Color(getComputedStyle(place).backgroundColor);
    renderer.render(scene, camera);
    place.dataset.drawn = String(Number(place.dataset.drawn ?? 0) + 1);
  }
  const redraw = () => (due ||= requestAnimationFrame(draw));

  function resize() {
    const { clientWidth: width, clientHeight: height } = place;
    renderer.setSize(width, height, false);
    camera.aspect = width / Math.max(height, 1);
    camera.updateProjectionMatrix();
    redraw();
  }

  function showCloud(cloud, colours) {
    if (points) {
      scene.remove(points);
      points.geometry.dispose();
    }
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.Float32BufferAttribute(cloud.positions, 3));
    // The library mixes colours as light, pictures store them as perceived.
    const light = colours.map((value) => value ** 2.2);
    // A bundle made before surfaces were drawn has no Mesh: then the corners are shown.
    if (cloud.faces.length && three.Mesh) {
      geometry.setAttribute("color", new three.Float32BufferAttribute(shaded(cloud, light), 3));
      geometry.setIndex(new three.Uint32BufferAttribute(cloud.faces, 1));
      points = new three.Mesh(geometry, new three.MeshBasicMaterial({ vertexColors: true }));
      scene.add(points);
      redraw();
      return;
    }
    geometry.setAttribute("color", new three.Float32BufferAttribute(light, 3));
    const size = Math.hypot(...cloud.high.map((value, axis) => value - cloud.low[axis]));
    // Half of the box's area is about what is seen of its surface; splats twice as wide as their distance close it.
    const splat = Math.min(Math.max((2 * size) / Math.sqrt(2 * cloud.count), size / 250), size / 40);
    points = new three.Points(geometry, new three.PointsMaterial({ size: SPLAT * splat, vertexColors: true }));
    scene.add(points);
    redraw();
  }

  function lookAt(cloud, camera_, grasps = []) {
    const [low, high] = roundAll(cloud, grasps.flatMap((grasp) => grasp.lines));
    const middle = high.map((value, axis) => (value + low[axis]) / 2);
    const size = Math.max(SEEN_M, Math.hypot(...high.map((value, axis) => value - low[axis])));
    controls.target.set(...middle);
    if (camera_?.length === 3) camera.position.set(...camera_);
    else camera.position.set(middle[0] + 0.7 * size, middle[1] - 0.9 * size, middle[2] + 0.75 * size);
    controls.update();
    redraw();
  }

  /** A hand as a surface; as splats with a bundle made before surfaces were drawn. */
  function bodyOf(solid, look) {
    const { places, colours, size } = three.Mesh ? solid : splatsOf(solid);
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.Float32BufferAttribute(places, 3));
    geometry.setAttribute("color", new three.Float32BufferAttribute(colours.map((value) => value ** 2.2), 3));
    return three.Mesh
      ? new three.Mesh(geometry, new three.MeshBasicMaterial({ side: BOTH_SIDES, ...look }))
      : new three.Points(geometry, new three.PointsMaterial({ size: SPLAT * size, ...look }));
  }

  /** Show the selected gripper, else the first, and the others as shadows of themselves. */
  function showGrippers(grasps, selected) {
    for (const old of [...grippers.children]) {
      grippers.remove(old);
      old.geometry.dispose();
    }
    const solid = selected >= 0 ? selected : grasps.findIndex((grasp) => grasp.lines.length);
    grasps.forEach((grasp, index) => {
      if (!grasp.lines.length) return;
      const look = { vertexColors: true, ...(index === solid ? {} : { transparent: true, opacity: three.Mesh ? FAINT : FAINT_SPLAT, depthWrite: false }) };
      const hand = bodyOf(solidHand(grasp, index === selected), look);
      hand.userData = { index, places: grasp.lines.flatMap(placesOn) };
      grippers.add(hand);
    });
    redraw();
  }

  /** The gripper whose middle is nearest to a place on the screen. */
  function pick(event) {
    const box = renderer.domElement.getBoundingClientRect();
    let best = [PICK_PX, -1];
    for (const hand of grippers.children) {
      for (const place_ of hand.userData.places) {
        const at = new three.Vector3(...place_).project(camera);
        const x = box.left + ((at.x + 1) / 2) * box.width;
        const y = box.top + ((1 - at.y) / 2) * box.height;
        const distance = Math.hypot(x - event.clientX, y - event.clientY);
        if (distance < best[0]) best = [distance, hand.userData.index];
      }
    }
    if (best[1] >= 0) onPick(best[1]);
  }

  let pressed = null;
  renderer.domElement.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  renderer.domElement.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) pick(event);
  });
  controls.addEventListener("change", redraw);
  new ResizeObserver(resize).observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  resize();

  return {
    showCloud,
    showGrippers,
    lookAt,
    /** Turn about the vertical, rad. */
    turn(angle) {
      const offset = camera.position.clone().sub(controls.target);
      offset.applyAxisAngle(new three.Vector3(...UP), angle);
      camera.position.copy(controls.target).add(offset);
      controls.update();
      redraw();
    },
    camera: () => camera.position.toArray().map((value) => Number(value.toFixed(4))),
    onTurned: (callback) => controls.addEventListener("end", callback),
  };
}
