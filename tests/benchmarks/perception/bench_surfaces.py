"""Reconstructed surfaces against the true ones, and grasps planned on them against those on clouds.

    python tests/benchmarks/perception/bench_surfaces.py surfaces 0 40
    python tests/benchmarks/perception/bench_surfaces.py grasps 0 64 4

prints a line of JSON for each object; ``report FILE...`` tabulates such lines. Cameras stand around
the object, 35 to 55 cm away and 30 to 60 degrees up; depth has the noise of a structured-light
sensor; each pose but the first, which defines the frame, is off by .3 degrees and 1 mm (standard
deviations of each component). Surfaces are of seven families of shapes and of the household shapes
that pybullet brings; grasps are first ones of the Panda's hand, each carried out four times with
errors of pose, friction and centre of mass, the same draws for both plans.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.geometry import Frame
from features.modelling import ObjectModel, Reconstruction, reconstruct
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, plan_on_mesh
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.mesh_files import read_mesh
from simulate.study.grasp_shapes import FAMILIES, sample_shape
from simulate.study.grasp_views import depth_frame
from simulate.study.intervals import bootstrap
from simulate.world.noise import SensorNoise

SEED, FIRST_SHAPE, FIRST_PUBLIC = 88001, 940, 600
VIEWS = (2, 4, 8)
TRIALS = 4
POINTS = 4000
_TURN, _SHIFT_M = np.deg2rad(0.3), 0.001
_CUT_M = 0.003  # a segmentation leaves out what is so near to the table

Floats = NDArray[np.float64]


def public_shape(number: int) -> Mesh:
    """Return one of pybullet's household shapes, 8 to 18 cm long, resting on a side on z = 0."""
    import pybullet_data

    folder = Path(pybullet_data.getDataPath()) / "random_urdfs" / f"{number:03d}"
    mesh = read_mesh(folder / f"{number:03d}.obj")
    rng = np.random.default_rng([SEED, number])
    scale = rng.uniform(0.08, 0.18) / mesh.extent.max()
    sides = Rotation.from_euler("xyz", rng.integers(0, 4, 3) * 90, degrees=True).as_matrix()
    vertices = scale * mesh.vertices @ sides.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2
    return as_mesh(vertices - (middle[0], middle[1], low[2]), mesh.faces)


def frames_around(mesh: Mesh, count: int, rng: np.random.Generator) -> Iterator[tuple[Frame, Any]]:
    """Yield frames of a mesh on the table, and the poses that a robot believes of its camera."""
    start = rng.uniform(0, 2 * np.pi)
    for number in range(count):
        azimuth = start + 2 * np.pi * number / count + rng.normal(0, 0.1)
        elevation, away = np.deg2rad(rng.uniform(30, 60)), rng.uniform(0.35, 0.55)
        flat = np.cos(elevation)
        eye = away * np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
        frame, pose = depth_frame(mesh, eye, SensorNoise(), int(rng.integers(1 << 31)))
        height = frame.points() @ pose[2, :3] + pose[2, 3]
        error = np.eye(4)
        if number:
            turn = Rotation.from_rotvec(rng.normal(0, _TURN, 3)).as_matrix()
            error[:3, :3], error[:3, 3] = turn, rng.normal(0, _SHIFT_M, 3)
        yield replace(frame, mask=frame.object_mask() & (height > _CUT_M)), pose @ error


def grown(mesh: Mesh, count: int, rng: np.random.Generator) -> ObjectModel:
    """Return the model of so many views."""
    model = ObjectModel()
    for number, (frame, pose) in enumerate(frames_around(mesh, count, rng)):
        model, _ = model.add(frame, object_from_camera=pose, name=str(number), is_measured=True)
    return model


def distances(mesh: Mesh, points: Floats) -> Floats:
    """Return distances (n,) of points from a mesh, m."""
    import open3d

    scene: Any = open3d.t.geometry.RaycastingScene()
    tensor: Any = open3d.core.Tensor.from_numpy
    scene.add_triangles(
        tensor(mesh.vertices.astype(np.float32)), tensor(mesh.faces.astype(np.uint32))
    )
    return np.asarray(scene.compute_distance(tensor(points.astype(np.float32))).numpy(), float)


def figures(truth: Mesh, made: Reconstruction) -> dict[str, Any]:
    """Return how far a surface is from the true one, in mm, and how much of that it covers."""
    rng = np.random.default_rng(0)
    mesh = as_mesh(made.vertices, made.faces)
    corners = made.vertices[made.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    chosen = rng.choice(len(areas), POINTS, p=areas / areas.sum())
    shares = rng.dirichlet(np.ones(3), POINTS)
    points = np.einsum("nk,nki->ni", shares, corners[chosen])
    seen = made.seen[made.faces[chosen]].all(axis=1)
    off = distances(truth, points)
    missing = distances(mesh, truth.sample(POINTS, rng)[0])
    return {
        "median_mm": 1000 * float(np.median(off)),
        "seen_median_mm": 1000 * float(np.median(off[seen])),
        "seen_90_mm": 1000 * float(np.quantile(off[seen], 0.9)),
        "filled_median_mm": 1000 * float(np.median(off[~seen])) if (~seen).any() else 0.0,
        "within_3_mm": float((missing < 0.003).mean()),
        "within_5_mm": float((missing < 0.005).mean()),
        "seen_share": made.seen_share,
        "residual_mm": 1000 * made.median_residual_m,
        "watertight": made.is_watertight,
    }


def measure_surface(number: int) -> Iterator[dict[str, Any]]:
    """Yield the figures of one object for each number of views; shapes and public ones in turn."""
    if number % 2:
        name, truth = f"public-{number}", public_shape(FIRST_PUBLIC + number // 2)
    else:
        half = number // 2
        family = FAMILIES[half % len(FAMILIES)]
        name, truth = f"{family}-{number}", sample_shape(family, FIRST_SHAPE + half)
    for count in VIEWS:
        model = grown(truth, count, np.random.default_rng([SEED, number, count]))
        start = time.process_time()
        made = reconstruct(model)
        spent = time.process_time() - start
        yield {"name": name, "views": count, "cpu_s": spent, **figures(truth, made)}


def measure_grasps(number: int, count: int) -> Iterator[dict[str, Any]]:
    """Yield how often first grasps hold that were planned on the surface, and on the cloud."""
    from simulate.study.quality.bench import draws, laid_out
    from simulate.study.quality.made_hands import studied_hand
    from simulate.study.quality.objects import fits, generated
    from simulate.world.seeds import mix_seed

    hand = studied_hand("panda")
    item = generated(SEED, number, hand)
    if not fits(item, hand):
        return
    with laid_out(item, "fast") as bench:
        table_from_object = bench.world_from_object.copy()
        table_from_object[:2, 3] = 0.0
        truth = bench.mesh.moved(table_from_object)
        model = grown(truth, count, np.random.default_rng([SEED, number]))
        made = reconstruct(model)
        options = SpatialOptions(mass=item.mass, seed=mix_seed(SEED, 41, number))
        eyes = np.array([pose[:3, 3] for _, pose in model.sources])
        row: dict[str, Any] = {"name": item.name, "views": count, **figures(truth, made)}
        trials = draws(SEED, number, TRIALS, float(bench.mesh.extent.max()))
        for source in ("cloud", "mesh"):
            start = time.process_time()
            if source == "cloud":
                points = model.cloud[:, :3].astype(np.float64)
                plan = plan_on_cloud(points, hand, Support(0.0), eyes, options)
            else:
                mesh = as_mesh(made.vertices, made.faces)
                plan = plan_on_mesh(mesh, hand, Surroundings(Support(0.0)), options)
            row[f"{source}_cpu_s"] = time.process_time() - start
            row[source] = row[f"{source}_carried"] = 0.0
            if plan:
                pose = np.linalg.inv(table_from_object) @ plan[0].frame_from_gripper
                done = bench.try_out(replace(plan[0], frame_from_gripper=pose), hand, trials)
                row[source] = float(np.mean([trial.held for trial in done]))
                row[f"{source}_carried"] = float(np.mean([bool(trial.carried) for trial in done]))
        yield row


def report(rows: list[dict[str, Any]]) -> None:
    """Print means by number of views, and of grasps the paired difference with its interval."""
    for count in sorted({row["views"] for row in rows}):
        mine = [row for row in rows if row["views"] == count]
        numbers = [key for key, value in mine[0].items() if not isinstance(value, str)]
        means = {key: round(float(np.mean([row[key] for row in mine])), 3) for key in numbers}
        worst = max(row["median_mm"] for row in mine)
        print(f"{count} views, {len(mine)} objects, worst median {worst:.2f} mm: {means}")
        if "mesh" not in mine[0]:
            continue
        for kind in ("", "_carried"):
            gain = np.array([row[f"mesh{kind}"] - row[f"cloud{kind}"] for row in mine])
            low, high = bootstrap(lambda i, gain=gain: float(gain[i].mean()), len(gain), 4000)
            print(f"mesh{kind} - cloud{kind}: {gain.mean():+.3f} [{low:+.3f}, {high:+.3f}]")


def main() -> None:
    """Measure a range of objects, or tabulate measured ones."""
    what, *given = sys.argv[1:]
    if what == "report":
        lines = [line for name in given for line in Path(name).read_text("utf-8").splitlines()]
        report([json.loads(line) for line in lines if line.startswith("{")])
        return
    first, last, *views = (int(word) for word in given)
    for number in range(first, last):
        is_of_grasps = what == "grasps"
        rows = measure_grasps(number, *views) if is_of_grasps else measure_surface(number)
        for row in rows:
            print(json.dumps(row, default=float), flush=True)


if __name__ == "__main__":
    main()
