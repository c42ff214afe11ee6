"""First grasps of one view, ranked over samples of the shape or on one guess of it, in physics.

Each object lies on a table and is seen by one camera, with the sensor's noise, from 35 to 55 cm
away and 30 to 60 degrees above. A hand without an arm takes the first grasp of either ranking under
the same draws of pose error, friction and centre of mass, lifts it and shakes it. No grasp counts
as not held.

    bench_shape_samples.py run FILE --hand panda --objects 100 --seed 7  # resumes
    bench_shape_samples.py table FILE...
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pybullet_data import getDataPath
from scipy.spatial import ConvexHull

from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, warm_up
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.meshes.mesh_files import read_mesh
from grasp.spatial.scoring.holding import assumed_mass
from simulate.study.grasp_views import depth_view, sample_camera
from simulate.study.intervals import bootstrap
from simulate.study.quality.bench import Bench, draws, laid_out
from simulate.study.quality.objects import GraspObject, fits, generated
from simulate.world.noise import SensorNoise

RULES = {"guess": 0, "samples": 24}
"""Samples of the shape in each ranking."""
_OFF_TABLE_M = 0.006
_PUBLIC_SCALE = 0.015
"""Metres per unit, as the URDFs of these meshes say."""


def public_object(
    seed: int, number: int, hand: ParallelGripper, public: tuple[int, int]
) -> GraspObject | None:
    """Return the hull of a mesh of pybullet's ``random_urdfs``, as heavy as wood, at most 90 g."""
    rng = np.random.default_rng((seed, number))
    for _ in range(100):
        one = int(rng.integers(*public))
        path = Path(getDataPath()) / f"random_urdfs/{one:03d}/{one:03d}.obj"
        mesh = read_mesh(path, _PUBLIC_SCALE)
        if len(mesh.vertices) < 4:
            continue
        points = mesh.vertices[ConvexHull(mesh.vertices).vertices]
        item = GraspObject(f"urdf-{one}", (points,), 0.05)
        item = GraspObject(item.name, (points - item.mesh().com,), 0.05)
        item = replace(item, mass=min(assumed_mass(item.mesh()), 0.09))
        if fits(item, hand):
            return item
    return None


def object_of(
    seed: int, number: int, hand: ParallelGripper, public: tuple[int, int], every: int
) -> GraspObject | None:
    """Return a generated object, or every so many times a public one."""
    if number % every == every - 1:
        return public_object(seed, number, hand, public)
    return generated(seed, number, hand)


def outcomes(bench: Bench, plan: Proposals, hand: ParallelGripper, seed: int, number: int,
             trials: int) -> dict[str, Any]:  # fmt: skip
    """Return how often the first grasp lifts and carries, and what was promised of it."""
    if not plan:
        return {"held": 0.0, "carried": 0.0, "reason": plan.reason}
    first = plan[0]
    pose = np.linalg.inv(bench.world_from_object) @ first.frame_from_gripper
    done = bench.try_out(
        replace(first, frame_from_gripper=pose), hand,
        draws(seed, number, trials, float(bench.mesh.extent.max())),
    )  # fmt: skip
    return {
        "held": float(np.mean([d.held for d in done])),
        "carried": float(np.mean([bool(d.carried) for d in done])),
        "scores": {k: round(float(v), 4) for k, v in first.scores.items()},
        "source": f"{first.source} {first.antipodal} {first.completed}",
    }


def trial(
    name: str, seed: int, number: int, trials: int, public: tuple[int, int], every: int
) -> dict[str, Any] | None:
    """Return the outcomes of both rankings for one object; None where it is not to be seen."""
    hand = gripper_named(name)
    item = object_of(seed, number, hand, public, every)
    if item is None:
        return None
    with laid_out(item) as bench:
        mesh = bench.mesh.moved(bench.world_from_object)
        place = np.array([*bench.rest.position[:2], 0.0])
        eye = place + sample_camera(np.random.default_rng((seed, number)))
        view = depth_view(mesh, eye, SensorNoise(), number)
        points = view.points[view.points[:, 2] > _OFF_TABLE_M]
        if len(points) < 50:
            return None
        row: dict[str, Any] = {"number": number, "name": item.name}
        for rule, shapes in RULES.items():
            options = SpatialOptions(mass=item.mass, seed=number, shapes=shapes)
            start = time.process_time()
            plan = plan_on_cloud(points, hand, Support(0.0), eye[None], options)
            took = time.process_time() - start
            row[rule] = {**outcomes(bench, plan, hand, seed, number, trials), "cpu": took}
    return row


def table(paths: list[Path]) -> None:
    """Print means, paired differences with intervals over objects, and the promises' errors."""
    rows = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    print(f"{len(rows)} objects")
    for kind in ("held", "carried"):
        old, new = (np.array([r[rule][kind] for r in rows]) for rule in RULES)
        low, high = bootstrap(lambda k, d=new - old: float(d[k].mean()), len(rows))
        print(f"{kind:8} guess {old.mean():.3f} samples {new.mean():.3f} "
              f"difference {np.mean(new - old):+.3f} [{low:+.3f}, {high:+.3f}]")  # fmt: skip
    for rule in RULES:
        cpu = [1e3 * r[rule]["cpu"] for r in rows]
        none = sum("reason" in r[rule] for r in rows)
        print(f"{rule:8} median {np.median(cpu):.0f} ms, nothing found {none}")
    for score, kind in (("lift_chance", "held"), ("carry_chance", "carried"),
                        ("confidence", "held"), ("confidence", "carried")):  # fmt: skip
        for rule in RULES:
            pairs = [(r[rule]["scores"][score], r[rule][kind])
                     for r in rows if score in r[rule].get("scores", {})]  # fmt: skip
            if pairs:
                chance, held = np.array(pairs).T
                brier = np.mean((chance - held) ** 2 + held * (1 - held))
                quarters = np.array_split(np.argsort(chance), 4)
                shown = ", ".join(f"{chance[q].mean():.2f}/{held[q].mean():.2f}" for q in quarters)
                print(f"{rule:8} {score} of {kind}: Brier {brier:.3f}; {shown}")


def main() -> None:
    """Run trials into a file, or print the table of files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "table"])
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--hand", default="panda")
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--public", type=int, nargs=2, default=(200, 1000),
                        help="meshes of random_urdfs that are drawn")  # fmt: skip
    parser.add_argument("--every", type=int, default=3, help="1: all objects are public ones")
    parser.add_argument("--first", type=int, default=0)
    args = parser.parse_args()
    if args.what == "table":
        table(args.files)
        return
    (path,) = args.files
    done = [json.loads(line)["number"] for line in path.read_text().splitlines()] \
        if path.exists() else []  # fmt: skip
    warm_up()
    with path.open("a") as out:
        for number in range(args.first, args.objects):
            if number in done:
                continue
            row = trial(args.hand, args.seed, number, args.trials, tuple(args.public), args.every)
            if row is not None:
                out.write(json.dumps(row) + "\n")
                out.flush()


if __name__ == "__main__":
    main()
