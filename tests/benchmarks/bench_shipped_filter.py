"""Effect of the shipped filters on plans from one view of YCB's models.

    python tests/benchmarks/bench_shipped_filter.py --gripper panda
    python tests/benchmarks/bench_shipped_filter.py --gripper nao --views 2

Each view of a model is planned on as a robot does (`plan_on_cloud`), with and without the filter,
and without the grasps of what is seen alone (`hedge=False`); on the same view, geometry alone
orders what the hand search finds. A grasp is right when both jaws meet the whole mesh within their
friction cones and the hand gets there free of object and table. An object counts as graspable when
any way, or sampling on its mesh, finds a right grasp. Differences are paired; 95 % bootstrap over
models. The processor time of both plans without the filter is taken in turns on the same views.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np
from bench_grasp_classifier import ycb

from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, warm_up
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.select import diverse
from simulate.study.grasp_views import TABLE, correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise

WAYS = ("geometry", "completed alone", "plan", "plan with the filter")
PAIRS = (("plan", "completed alone"), ("plan with the filter", "geometry"),
         ("plan with the filter", "plan"))  # fmt: skip


def right_ones(
    mesh: Mesh, number: int, view: int, gripper: ParallelGripper, spent: dict[str, list[float]]
) -> dict[str, np.ndarray] | None:
    """Return which of the first five of each way are right; None = nothing can be grasped.

    The processor time of each way, s, goes into ``spent``.
    """
    rng = np.random.default_rng([7, number, view])
    seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
    eye, support = seen.viewpoint[None], Support()
    alone = SpatialOptions(hedge=False)
    # A robot's segmentation gives the object without its table.
    ways: dict[str, Callable[[], Proposals]] = {
        "geometry": lambda: propose_from_cloud(seen.points, gripper, table=TABLE, viewpoints=eye),
        "completed alone": lambda: plan_on_cloud(seen.points, gripper, support, eye, alone),
        "plan": lambda: plan_on_cloud(seen.points, gripper, support, eye),
        "plan with the filter": lambda: plan_on_cloud(
            seen.points, gripper, support, eye, classifier="shipped"
        ),
    }
    found = {}
    for way, propose in ways.items():
        began = time.process_time()
        found[way] = propose()
        spent.setdefault(way, []).append(time.process_time() - began)
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
    parser.add_argument("--every", type=int, default=1, help="take every so many-th model")
    options = parser.parse_args()
    gripper = gripper_named(options.gripper)
    began = time.process_time()
    rows: dict[int, list[dict[str, np.ndarray]]] = {}
    spent: dict[str, list[float]] = {}
    warm_up()
    for number, (mesh, _) in enumerate(ycb(1)):
        if number % options.every:
            continue
        for view in range(options.first, options.first + options.views):
            right = right_ones(mesh, number, view, gripper, spent)
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
        for one, other in PAIRS:
            gain = 100 * (share[one] - share[other])
            low, high = np.percentile(gain[draws].mean(axis=1), (2.5, 97.5))
            print(f"    {one} less {other}: {gain.mean():+.1f} [{low:+.1f}, {high:+.1f}] points")
    times = {way: np.array(spent[way]) for way in ("completed alone", "plan")}
    each = times["plan"] / times["completed alone"]
    print(
        "  processor time of a plan",
        *(f"{way} {1e3 * np.median(each):.0f} ms" for way, each in times.items()),
        f"{times['plan'].sum() / times['completed alone'].sum():.2f} times in all, "
        f"median {np.median(each):.2f}, 95 % below {np.percentile(each, 95):.2f}",
        sep="  ",
    )
    load = os.getloadavg()[0]
    print(f"{time.process_time() - began:.0f} s of processor time, load {load:.1f} on two cores")


if __name__ == "__main__":
    main()
