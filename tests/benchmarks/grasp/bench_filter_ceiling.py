"""Ceiling of plans on single views of YCB's models: losses by the pool, its order, and the five.

    python tests/benchmarks/grasp/bench_filter_ceiling.py --gripper panda --views 2 3 --pools FOLDER

The pool of a view is all that a plan on it ranks, with `--filter` by the shipped filter. A right
grasp (as in `bench_shipped_filter.py`) can be missing in the pool (its share of the views is the
ceiling of any order), ranked too low, or kept out of the first five by variants of wrong ones.
Pools are kept in a folder, so that another way to choose five costs seconds: each is applied to the
same pools, and compared in pairs with the present one; 95 % bootstrap over models, whose views are
averaged first. A way is chosen on the models with odd numbers and judged on fresh views of the
others (`--models`).
"""

from __future__ import annotations

import argparse
import os
import pickle
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.select import diverse
from simulate.study.grasp_views import correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise
from tests.benchmarks.grasp.bench_grasp_classifier import ycb

Five = Callable[[Sequence[GraspCandidate], ParallelGripper], list[GraspCandidate]]
FIVES: dict[str, Five] = {
    "1 cm, 15 deg (present)": lambda pool, hand: diverse(pool, hand, most=5),
    "2 cm, 30 deg": lambda pool, hand: _spread(pool, hand, 0.02, 30.0),
    "3 cm, 45 deg": lambda pool, hand: _spread(pool, hand, 0.03, 45.0),
    "best first, then 3 cm, 45 deg": lambda pool, hand: _mixed(pool, hand),
}


def _spread(
    pool: Sequence[GraspCandidate], hand: ParallelGripper, apart_m: float, angle_deg: float
) -> list[GraspCandidate]:
    """Return five that differ by so much, filled up with the best others."""
    five = diverse(pool, hand, apart_m, np.deg2rad(angle_deg), most=5)
    rest = [one for one in diverse(pool, hand) if all(one is not other for other in five)]
    return [*five, *rest][:5]


def _mixed(pool: Sequence[GraspCandidate], hand: ParallelGripper) -> list[GraspCandidate]:
    """Return the two best, then those that differ most from them in the order of the pool."""
    best = diverse(pool, hand, most=2)
    return [*best, *[o for o in _spread(pool, hand, 0.03, 45.0) if all(o is not b for b in best)]][
        :5
    ]


def pool_of(
    mesh: Mesh, number: int, view: int, gripper: ParallelGripper, tries: int, filtered: bool
) -> dict[str, Any]:
    """Return the pool of a view, which of it is right, and whether the mesh can be grasped."""
    rng = np.random.default_rng([7, number, view])
    seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
    support = Support()
    options = SpatialOptions(tries=tries)
    judge = "shipped" if filtered else None
    found = list(plan_on_cloud(seen.points, gripper, support, seen.viewpoint[None], options, judge))
    right = correct(found, mesh, gripper)
    graspable = bool(right.any())
    if not graspable:
        known = propose_on_mesh(mesh, gripper, Surroundings(support))
        graspable = bool(correct(list(known), mesh, gripper).any())
    return {"number": number, "pool": found, "right": right, "graspable": graspable}


def pools(
    folder: Path, gripper: ParallelGripper, view: int, tries: int, filtered: bool, rest: int
) -> list[dict[str, Any]]:
    """Return the pools of the models with numbers that leave ``rest`` halved, as they are kept."""
    judge = "filter" if filtered else "plain"
    kept = folder / f"{gripper.name}-{view}-{tries}-{judge}-{rest}.pickle"
    if kept.exists():
        return list(pickle.loads(kept.read_bytes()))
    found = [
        pool_of(mesh, number, view, gripper, tries, filtered)
        for number, (mesh, _) in enumerate(ycb(1))
        if number % 2 == rest
    ]
    folder.mkdir(parents=True, exist_ok=True)
    kept.write_bytes(pickle.dumps(found))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--gripper", default="panda", help="nao or panda")
    parser.add_argument("--views", type=int, nargs="+", default=[1], help="numbers of the views")
    parser.add_argument("--models", choices=("odd", "even", "all"), default="all")
    parser.add_argument("--filter", action="store_true", help="plan with the shipped filter")
    parser.add_argument("--tries", type=int, default=2000, help="ten for each hand that is tried")
    parser.add_argument("--pools", type=Path, default=Path("pools"), help="folder to keep them in")
    options = parser.parse_args()
    gripper, began = gripper_named(options.gripper), time.process_time()
    halves = {"even": [0], "odd": [1], "all": [0, 1]}[options.models]
    every = [
        one
        for view in options.views
        for rest in halves
        for one in pools(options.pools, gripper, view, options.tries, options.filter, rest)
    ]
    views = [one for one in every if one["graspable"]]
    with_right = np.array([one["right"].any() for one in views])
    sizes = [len(one["pool"]) for one in views]
    print(
        f"{options.gripper}: {len(views)} of {len(every)} views of {options.models} models "
        f"graspable; pool of {np.median(sizes):.0f}"
    )
    print(f"  ceiling: some candidate of the pool is right in {100 * with_right.mean():.1f} %")
    hits: dict[str, np.ndarray] = {}
    for name, choose in FIVES.items():
        chosen = [_flags(one, choose(one["pool"], gripper)) for one in views]
        hits[name] = np.array([flags.any() for flags in chosen], float)
        first = np.mean([flags[:1].any() for flags in chosen])
        print(
            f"  {name:30s} one of five {100 * hits[name].mean():.1f} %, first {100 * first:.1f} %"
        )
    present, *others = hits
    lost = with_right & (hits[present] == 0)
    parted = np.max([hits[name] for name in others], axis=0) > 0
    by_choice, by_order = np.mean(lost & parted), np.mean(lost & ~parted)
    print(
        f"  lost: pool {100 * np.mean(~with_right):.1f} %, choice of five {100 * by_choice:.1f} %, "
        f"order {100 * by_order:.1f} %"
    )
    ranks = [
        int(np.argmax(one["right"])) for one, is_lost in zip(views, lost, strict=True) if is_lost
    ]
    print(f"  where it is lost after the pool, the first right one has rank {sorted(ranks)}")
    models = np.array([one["number"] for one in views])
    rng = np.random.default_rng(0)
    for name in others:
        gain = 100 * (hits[name] - hits[present])
        each = np.array([gain[models == number].mean() for number in np.unique(models)])
        draws = rng.integers(len(each), size=(4000, len(each)))
        low, high = np.percentile(each[draws].mean(axis=1), (2.5, 97.5))
        print(f"  {name} less present: {each.mean():+.1f} [{low:+.1f}, {high:+.1f}]")
    print(f"{time.process_time() - began:.0f} s of processor time, load {os.getloadavg()[0]:.1f}")


def _flags(view: dict[str, Any], chosen: Sequence[GraspCandidate]) -> np.ndarray:
    places = [next(k for k, one in enumerate(view["pool"]) if one is c) for c in chosen]
    return np.asarray(view["right"][places], bool)


if __name__ == "__main__":
    main()
