"""Effect of the shipped filters on plans from one view of YCB's models.

    python tests/benchmarks/bench_shipped_filter.py --gripper panda
    python tests/benchmarks/bench_shipped_filter.py --gripper nao --views 2

Each view of a model is planned on as a robot does (`plan_on_cloud`), with and without the filter;
on the same view, geometry alone orders what the hand search finds. A grasp is right when both jaws
meet the whole mesh within their friction cones and the hand gets there free of object and table. An
object counts as graspable when any way, or sampling on its mesh, finds a right grasp. Differences
are paired; 95 % bootstrap over models.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np
from bench_grasp_classifier import ycb

from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import plan_on_cloud
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.select import diverse
from simulate.study.grasp_views import TABLE, correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise

WAYS = ("geometry", "plan", "plan with the filter")


def right_ones(
    mesh: Mesh, number: int, view: int, gripper: ParallelGripper
) -> dict[str, np.ndarray] | None:
    """Return which of the first five of each way are right; None = nothing can be grasped."""
    rng = np.random.default_rng([7, number, view])
    seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
    eye, support = seen.viewpoint[None], Support()
    # A robot's segmentation gives the object without its table.
    found = {
        "geometry": propose_from_cloud(seen.points, gripper, table=TABLE, viewpoints=eye),
        "plan": plan_on_cloud(seen.points, gripper, support, eye),
        "plan with the filter": plan_on_cloud(
            seen.points, gripper, support, eye, classifier="shipped"
        ),
    }
    right = {
        way: correct(diverse(list(one), gripper, most=5), mesh, gripper)
        for way, one in found.items()
    }
    if any(one.any() for one in right.values()):
        return right
    known = propose_on_mesh(mesh, gripper, Surroundings(support))
    return right if correct(list(known), mesh, gripper).any() else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--gripper", default="panda", help="nao or panda")
    parser.add_argument("--views", type=int, default=1, help="of each model")
    parser.add_argument("--first", type=int, default=1, help="number of the first view")
    options = parser.parse_args()
    gripper = gripper_named(options.gripper)
    began = time.process_time()
    rows: dict[int, list[dict[str, np.ndarray]]] = {}
    for number, (mesh, _) in enumerate(ycb(1)):
        for view in range(options.first, options.first + options.views):
            right = right_ones(mesh, number, view, gripper)
            if right is not None:
                rows.setdefault(number, []).append(right)
    kinds = {"one of five": lambda one: float(one.any()), "first": lambda one: float(one[:1].any())}
    count = sum(len(views) for views in rows.values())
    print(f"{options.gripper}: {count} graspable views of {len(rows)} models")
    rng = np.random.default_rng(0)
    draws = rng.integers(len(rows), size=(4000, len(rows)))
    for kind, take in kinds.items():
        share = {
            way: np.array([np.mean([take(one[way]) for one in views]) for views in rows.values()])
            for way in WAYS
        }
        print(
            f"  {kind:11s}", *(f"{way} {100 * share[way].mean():.1f} %" for way in WAYS), sep="  "
        )
        for other in WAYS[:2]:
            gain = 100 * (share[WAYS[2]] - share[other])
            low, high = np.percentile(gain[draws].mean(axis=1), (2.5, 97.5))
            print(f"    filter less {other}: {gain.mean():+.1f} [{low:+.1f}, {high:+.1f}] points")
    load = os.getloadavg()[0]
    print(f"{time.process_time() - began:.0f} s of processor time, load {load:.1f} on two cores")


if __name__ == "__main__":
    main()
