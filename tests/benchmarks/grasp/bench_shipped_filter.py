"""Plans from one view of YCB's models: what pairs, filter, hedge and a second view change.

    python tests/benchmarks/grasp/bench_shipped_filter.py --gripper panda
    python tests/benchmarks/grasp/bench_shipped_filter.py --gripper nao --views 2
    python tests/benchmarks/grasp/bench_shipped_filter.py --gripper nao --shapes 3 --first 31

Each view of a model is planned on as a robot does (`plan_on_cloud`), with and without the filter
(which orders hands and pairs), without pairs of contacts (`pairs=False`), without the grasps of
what is seen alone (`hedge=False`), and with a second view from 90 degrees further around; on the
same view, geometry alone orders what the hand search finds. A grasp is right when both jaws meet
the whole mesh within their friction cones and the hand gets there free of object and table. An
object counts as graspable when any way, or sampling on its mesh, finds a right grasp. Differences
are paired; 95 % bootstrap over models. The processor time of all plans is taken in turns on the
same views.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np

from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, warm_up
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.select import diverse
from simulate.study.grasp_samples import shapes
from simulate.study.grasp_views import TABLE, correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise
from tests.benchmarks.grasp.bench_grasp_classifier import ycb

WAYS = ("geometry", "completed alone", "hands alone", "plan", "plan with the filter", "two views")
PAIRS = (("plan", "completed alone"), ("plan", "hands alone"), ("plan with the filter", "geometry"),
         ("plan with the filter", "plan"), ("two views", "plan"))  # fmt: skip
FIRST_SHAPE = 200_000


def right_ones(
    mesh: Mesh, number: int, view: int, gripper: ParallelGripper, spent: dict[str, list[float]],
    stream: int,
) -> dict[str, np.ndarray] | None:  # fmt: skip
    """Return which of the first five of each way are right; None = nothing can be grasped.

    The processor time of each way, s, goes into ``spent``.
    """
    rng = np.random.default_rng([stream, number, view])
    seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
    around = np.array([-seen.viewpoint[1], seen.viewpoint[0], seen.viewpoint[2]])
    other = depth_view(mesh, around, SensorNoise(), int(rng.integers(1 << 31)))
    eye, support = seen.viewpoint[None], Support()
    both = np.concatenate([seen.points, other.points]), np.stack([seen.viewpoint, around])
    alone, hands = SpatialOptions(hedge=False), SpatialOptions(pairs=False)
    # A robot's segmentation gives the object without its table.
    ways: dict[str, Callable[[], Proposals]] = {
        "geometry": lambda: propose_from_cloud(seen.points, gripper, table=TABLE, viewpoints=eye),
        "completed alone": lambda: plan_on_cloud(seen.points, gripper, support, eye, alone),
        "hands alone": lambda: plan_on_cloud(seen.points, gripper, support, eye, hands),
        "plan": lambda: plan_on_cloud(seen.points, gripper, support, eye),
        "two views": lambda: plan_on_cloud(both[0], gripper, support, both[1]),
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
    parser.add_argument("--start", type=int, default=0, help="number of the first model")
    parser.add_argument("--shapes", type=int, default=0, help="of each family, instead of YCB")
    options = parser.parse_args()
    gripper = gripper_named(options.gripper)
    began = time.process_time()
    rows: dict[int, list[dict[str, np.ndarray]]] = {}
    spent: dict[str, list[float]] = {}
    warm_up()
    generated = shapes(options.shapes, FIRST_SHAPE)
    meshes = generated if options.shapes else (mesh for mesh, _ in ycb(1))
    stream = 9 if options.shapes else 7
    for number, mesh in enumerate(meshes):
        if number % options.every != options.start % options.every:
            continue
        for view in range(options.first, options.first + options.views):
            right = right_ones(mesh, number, view, gripper, spent, stream)
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
    compared = ("completed alone", "hands alone", "plan", "plan with the filter")
    times = {way: np.array(spent[way]) for way in compared}
    each = times["plan"] / times["hands alone"]
    filtered = times["plan with the filter"].sum() / times["plan"].sum()
    print(
        "  processor time of a plan",
        *(f"{way} {1e3 * np.median(spent[way]):.0f} ms" for way in times),
        f"plan over hands alone: {times['plan'].sum() / times['hands alone'].sum():.2f} in all, "
        f"median {np.median(each):.2f}, 95 % below {np.percentile(each, 95):.2f}",
        f"with the filter over plan: {filtered:.2f} in all",
        sep="  ",
    )
    load = os.getloadavg()[0]
    print(f"{time.process_time() - began:.0f} s of processor time, load {load:.1f} on two cores")


if __name__ == "__main__":
    main()
