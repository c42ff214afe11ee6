"""Grasps between neighbours, planned with and without the margin that fingers have towards them.

    python tests/benchmarks/bench_finger_margin.py [--tables 30] [--seed 0]

A Panda plans one grasp from above of each of six things on a table, the other five in the way,
both ways with the same seed, and carries each plan out in a world of its own: held, and whether
it moved another thing by over 1 cm. Where the plans are the same, so is what comes of them.
The margin plays no part in grasps in full poses, such as those of piles.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from simulate.grasping import candidates, planning
from simulate.grasping.executor import GraspRequest, PlannedGrasp, Workcell
from simulate.motion.collision import Obstacle
from simulate.study.intervals import bootstrap
from simulate.world.objects import ObjectSpec, product
from simulate.world.scene import Placement, arrange
from simulate.world.seeds import stream

_KINDS = ("carton", "box", "bar", "can", "flask", "pen")
_MOVED_M = 0.01
_PAIR = ("neighbour", "finger")


@contextmanager
def margin(metres: float) -> Iterator[None]:
    """Let fingers come closer to neighbours by so much."""
    at_object = {**candidates.AT_OBJECT, _PAIR: metres}
    with (
        patch.object(candidates, "AT_OBJECT", at_object),
        patch.object(planning, "AT_OBJECT", at_object),
        patch.object(planning, "_LIFTING", {**planning._LIFTING, _PAIR: metres}),
    ):
        yield


def request(one: Placement, table: float) -> GraspRequest:
    """Return a grasp across the narrow side, near the middle."""
    x, y, height = one.spec.extent
    return GraspRequest(
        x=one.x, y=one.y, theta=float((one.yaw + (np.pi / 2 if x > y else 0.0)) % np.pi),
        width=min(x, y), length=max(x, y), height=height, table_height=table,
        round=one.spec.kind in ("can", "ball", "bottle"),
    )  # fmt: skip


def attempt(
    table: Sequence[Placement], wanted: int, metres: float
) -> tuple[PlannedGrasp | str, tuple[bool, int]]:
    """Plan one grasp on a fresh table; return the plan, and what carrying it out came to."""
    with Workcell("panda", "fast") as cell, margin(metres):
        world = cell.world
        bodies = [world.spawn(one.spec, (one.x, one.y), one.yaw) for one in table]
        world.step(0.2)
        around = [_box(one, world.table_height) for k, one in enumerate(table) if k != wanted]
        plan = cell.executor.plan(request(table[wanted], world.table_height), around, seed=wanted)
        if isinstance(plan, str):
            return plan, (False, 0)
        before = [world.object_pose(body).position for body in bodies]
        held: list[bool] = []

        def watch(phase: str) -> None:
            if phase == "hold":
                rise = world.object_pose(bodies[wanted]).z - before[wanted][2]
                held.append(bool(rise > 0.02))

        cell.executor.execute(plan, watch, place=False)
        moved = sum(
            float(np.linalg.norm(world.object_pose(body).position - was)) > _MOVED_M
            for k, (body, was) in enumerate(zip(bodies, before, strict=True))
            if k != wanted
        )
        return plan, (bool(held and held[0]), moved)


def _box(one: Placement, table: float) -> Obstacle:
    middle = (one.x, one.y, table + one.spec.extent[2] / 2)
    return Obstacle.box("neighbour", middle, one.spec.extent, one.yaw)


def _things(rng: np.random.Generator) -> list[ObjectSpec]:
    return [product(kind, int(rng.integers(200))) for kind in _KINDS]


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rows = []
    for number in range(options.tables):
        rng = stream(options.seed, number)
        with Workcell("panda", "fast") as cell:
            table = arrange(_things(rng), rng, workplace=cell.description.workplace)
        for wanted in range(len(table)):
            found = [attempt(table, wanted, metres) for metres in (0.0, 0.006)]
            rows.append([(not isinstance(plan, str), *outcome) for plan, outcome in found])
        shares = np.array(rows, dtype=float).mean(axis=0)
        print(number + 1, "tables: planned, held, others moved:", shares.round(3).tolist())
    gains = np.array(rows, dtype=float)
    gains = gains[:, 1] - gains[:, 0]
    for k, name in enumerate(("planned", "held", "others moved")):
        low, high = bootstrap(lambda i, k=k: float(gains[i, k].mean()), len(gains))
        print(f"{name}: with less without {gains[:, k].mean():+.3f} [{low:+.3f}, {high:+.3f}]")


if __name__ == "__main__":
    main()
