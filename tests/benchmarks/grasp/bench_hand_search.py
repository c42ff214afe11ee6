"""The hand search on a cloud of 16,000 points, against the same search in vectorised numpy.

    python tests/benchmarks/grasp/bench_hand_search.py
    python tests/benchmarks/grasp/bench_hand_search.py --samples 1000 --repeat 9

A noisy single view of a mug with its table. The peer finds neighbours in scipy's k-d tree and
handles all points and all slots of one turn at once; both find the same hands, which is asserted.
Times are medians of interleaved runs, of one core: clock and, in brackets, processor time.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.clouds.surfaces import surface_frames
from grasp.spatial.gripper import ParallelGripper, panda_hand
from grasp.spatial.hand_search.hand_search import propose_on
from grasp.spatial.hand_search.hands import SearchOptions, find_hands
from simulate.study.grasp_shapes import sample_shape
from simulate.study.grasp_views import TABLE, depth_view
from simulate.world.noise import SensorNoise

PALM_ROOM, PLACING = 0.005, 0.004


def scene(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a view of a mug on a table that fills about ``points`` voxels, and the viewpoint."""
    camera = np.array([0.45, 0.1, 0.4])
    view = depth_view(sample_shape("mug", 0), camera, SensorNoise(), 0)
    rng = np.random.default_rng(0)
    # The rest of a table, as evenly covered as a camera would.
    half = np.sqrt(points) * 0.003 / 2
    rest = np.c_[rng.uniform(-half, half, (9 * points, 2)), rng.normal(0, 3e-4, 9 * points)]
    low, high = view.points[:, :2].min(axis=0), view.points[:, :2].max(axis=0)
    outside = np.any((rest[:, :2] < low) | (rest[:, :2] > high), axis=1)
    return np.concatenate([view.points, rest[outside]]), camera[None]


def hands_in_numpy(
    cloud: SurfaceCloud, gripper: ParallelGripper, samples: int, options: SearchOptions
) -> np.ndarray:
    """Return sample, turn, x, bite and width of the hands (m, 5) that the kernel finds."""
    rng = np.random.default_rng(0)
    usable = np.flatnonzero(cloud.target)
    drawn = rng.choice(usable, size=min(samples, len(usable)), replace=False)
    frames, known = surface_frames(
        cloud.grid(options.normal_radius),
        np.where(cloud.counted[:, None], cloud.normals, 0.0),
        drawn,
        options.frame_radius,
        cloud.axes[0],
    )
    tree = cKDTree(cloud.points)
    thick, opening = gripper.thickness, gripper.max_opening
    depth = gripper.finger_length - PALM_ROOM
    half = gripper.finger_width / 2 + PLACING
    reach = np.sqrt((opening + 2 * thick) ** 2 + (depth + options.init_bite) ** 2 + half**2)
    shifts = np.arange(options.slots) * (opening + thick) / (options.slots - 1)
    found = []
    for s, (sample, frame) in enumerate(zip(drawn[known], frames[known], strict=True)):
        origin = cloud.points[sample]
        near = cloud.points[tree.query_ball_point(origin, reach)] - origin
        near = near[np.abs(near @ frame[0]) < half]
        for turn in range(options.turns):
            angle = 2 * np.pi * turn / options.turns
            approach = np.sin(angle) * frame[2] - np.cos(angle) * frame[1]
            if not np.any((origin - cloud.viewpoints) @ approach > 0):
                continue
            rotation = np.stack([np.cross(approach, frame[0]), approach, frame[0]])
            local = near @ rotation.T
            placed = _placed(local, origin, rotation, shifts, cloud, gripper, options)
            if placed is not None:
                found.append((s, turn, *placed))
    return np.array(found).reshape(-1, 5)


def _placed(
    local: np.ndarray,
    origin: np.ndarray,
    rotation: np.ndarray,
    shifts: np.ndarray,
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    options: SearchOptions,
) -> tuple[float, float, float] | None:
    thick, opening = gripper.thickness, gripper.max_opening
    depth, bite, step = gripper.finger_length - PALM_ROOM, options.init_bite, options.step
    x, y = local[:, 0], local[:, 1]
    at = x[:, None] - shifts
    inside = (at <= thick) & (at >= -opening - thick)
    finger = inside & ((at >= 0) | (at <= -opening))
    free = np.where(finger, y[:, None], np.where(inside, y[:, None] + depth, np.inf)).min(axis=0)
    filled = ((at > -opening) & (at < 0) & (y < bite)[:, None]).any(axis=0)
    usable = np.flatnonzero(filled & (free >= bite))
    if len(usable) == 0:
        return None
    slot = usable[len(usable) // 2]
    centre = shifts[slot] - opening / 2
    deepest = _deepest(free[slot], bite, step, depth)
    held = (np.abs(x - centre) < opening / 2) & (y < deepest) & (y >= deepest - depth)
    middle, width = (x[held].min() + x[held].max()) / 2, np.ptp(x[held])
    wanted = opening
    limit = _free(x, y, middle, wanted, thick, depth)
    if limit < bite:
        wanted = min(opening, width + 2 * (options.room + step))
        limit = _free(x, y, middle, wanted, thick, depth)
    if limit < bite:
        return None
    deepest = min(deepest, _deepest(limit, bite, step, depth))
    deepest = _over_table(origin, rotation, middle, wanted + 2 * thick, deepest, cloud, gripper)
    if deepest < bite / 2:
        return None
    held = (np.abs(x - middle) < wanted / 2) & (y < deepest) & (y >= deepest - depth)
    if not held.any():
        return None
    left = held & (x <= x[held].min() + cloud.voxel)
    right = held & (x >= x[held].max() - cloud.voxel)
    pads = (y[left].mean() + y[right].mean()) / 2 + gripper.fingertip
    if pads < deepest:
        deepest = max(pads, min(deepest, bite))
        held = (np.abs(x - middle) < wanted / 2) & (y < deepest) & (y >= deepest - depth)
    return (x[held].min() + x[held].max()) / 2, deepest, float(np.ptp(x[held]))


def _deepest(limit: float, bite: float, step: float, depth: float) -> float:
    while bite + step <= min(limit, depth) + 1e-12:
        bite += step
    return bite


def _free(
    x: np.ndarray, y: np.ndarray, middle: float, opening: float, thick: float, depth: float
) -> float:
    at = np.abs(x - middle)
    inside = at < opening / 2 + thick
    return float(np.min(np.where(at >= opening / 2, y, y + depth)[inside], initial=np.inf))


def _over_table(
    origin: np.ndarray,
    rotation: np.ndarray,
    middle: float,
    outer: float,
    bite: float,
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
) -> float:
    along = rotation @ cloud.table[:3]
    wide = max(gripper.finger_width, gripper.palm[1]) / 2
    depth = gripper.finger_length - PALM_ROOM
    height = cloud.table[:3] @ origin + cloud.table[3] - 0.002
    height += along[0] * middle - abs(along[0]) * outer / 2
    tips = height - abs(along[2]) * gripper.finger_width / 2 + along[1] * bite
    palm = height - abs(along[2]) * wide + along[1] * (bite - depth)
    lack = -min(tips, palm)
    if lack <= 0:
        return bite
    return float(bite + lack / along[1]) if along[1] < -1e-6 else -np.inf


def timed(call: Callable[[], object]) -> tuple[float, float]:
    clock, processor = time.perf_counter(), time.process_time()
    call()
    return 1e3 * (time.perf_counter() - clock), 1e3 * (time.process_time() - processor)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--points", type=int, default=16_000)
    parser.add_argument("--samples", type=int, default=200)
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    points, camera = scene(options.points)
    gripper, search = panda_hand(), SearchOptions()

    def prepare() -> SurfaceCloud:
        return prepare_cloud(points, table=TABLE, viewpoints=camera)

    cloud = prepare()
    whole = complete_by_symmetry(cloud)
    ours = find_hands(cloud, gripper, options.samples)
    theirs = hands_in_numpy(cloud, gripper, options.samples, search)
    columns = np.stack([ours.column(c) for c in ("sample", "turn", "x", "bite", "width")], axis=1)
    assert columns.shape == theirs.shape, (columns.shape, theirs.shape)
    assert np.allclose(columns, theirs, atol=1e-9)
    propose_on(whole, gripper, options.samples)
    print(
        f"{len(points)} points, {len(cloud.points)} voxels, {int(cloud.target.sum())} of the "
        f"object, {len(ours)} hands, the same on both sides; load {os.getloadavg()[0]:.1f}"
    )
    n = options.samples
    steps: dict[str, Callable[[], object]] = {
        "preparation": prepare,
        "completion": lambda: complete_by_symmetry(cloud),
        f"search, {n} samples": lambda: find_hands(cloud, gripper, n),
        f"peer, {n} samples": lambda: hands_in_numpy(cloud, gripper, n, search),
        "search, 30 samples": lambda: find_hands(cloud, gripper, 30),
        f"preparation and proposals, {n} samples": lambda: propose_on(prepare(), gripper, n),
        f"all with completion, {n} samples": lambda: propose_on(
            complete_by_symmetry(prepare()), gripper, n
        ),
    }
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in steps}
    for _ in range(options.repeat):
        for name, call in steps.items():
            times[name].append(timed(call))
    medians = {name: np.median(values, axis=0) for name, values in times.items()}
    for name, (clock, processor) in medians.items():
        print(f"  {name:<40} {clock:8.1f} ms ({processor:.1f})")
    ratio = medians[f"peer, {n} samples"] / medians[f"search, {n} samples"]
    print(f"  peer / search: {ratio[0]:.1f} by the clock, {ratio[1]:.1f} of the processor")


if __name__ == "__main__":
    main()
