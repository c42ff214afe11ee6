"""Grasps between neighbours, planned with and without the margin that fingers have towards them.

    python tests/benchmarks/grasp/bench_finger_margin.py [--tables 30] [--seed 0]

A Panda plans one grasp from above of each of six things on a table, the other five in the way,
both ways with the same seed. Where the plans differ, each is carried out in a world of its own:
held, and whether it moved another thing by over 1 cm. Where they are the same, so is what comes of
them, and nothing is carried out.
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


def plans(table: Sequence[Placement], metres: float) -> list[PlannedGrasp | str]:
    """Return a plan for each thing of a table, or the reason code why there is none."""
    with Workcell("panda", "fast") as cell, margin(metres):
        height = cell.world.table_height
        boxes = [_box(one, height) for one in table]
        return [
            cell.executor.plan(request(one, height), boxes[:k] + boxes[k + 1 :], seed=k)
            for k, one in enumerate(table)
        ]


def outcome(table: Sequence[Placement], wanted: int, plan: PlannedGrasp | str) -> tuple[bool, int]:
    """Carry a plan out on a fresh table; return whether the thing held, and how many others moved.

    Without a plan, neither happens.
    """
    if isinstance(plan, str):
        return False, 0
    with Workcell("panda", "fast") as cell:
        world = cell.world
        bodies = [world.spawn(one.spec, (one.x, one.y), one.yaw) for one in table]
        world.step(0.2)
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
        return bool(held and held[0]), moved


def _is_same(one: PlannedGrasp | str, other: PlannedGrasp | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return isinstance(one, str) and isinstance(other, str)
    return all(
        np.array_equal(getattr(one, part).positions, getattr(other, part).positions)
        for part in ("free", "approach", "lift")
    )


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
    gains, planned, differing = [], np.zeros(2, int), 0
    for number in range(options.tables):
        rng = stream(options.seed, number)
        with Workcell("panda", "fast") as cell:
            table = arrange(_things(rng), rng, workplace=cell.description.workplace)
        both = list(zip(plans(table, 0.0), plans(table, 0.006), strict=True))
        for wanted, pair in enumerate(both):
            able = [not isinstance(plan, str) for plan in pair]
            planned += able
            gain = np.zeros(3)
            if not _is_same(*pair):
                differing += 1
                without, with_it = (
                    np.array([able[k], *outcome(table, wanted, plan)], float)
                    for k, plan in enumerate(pair)
                )
                print(f"table {number}, {_KINDS[wanted]}: planned, held, others moved",
                      without.tolist(), "->", with_it.tolist(), flush=True)  # fmt: skip
                gain = with_it - without
            gains.append(gain)
    print(f"{len(gains)} grasps, {differing} differ; planned without and with {planned.tolist()}")
    values = np.array(gains)
    for k, name in enumerate(("planned", "held", "others moved")):
        low, high = bootstrap(lambda i, k=k: float(values[i, k].mean()), len(values))
        print(f"{name}: with less without {values[:, k].mean():+.3f} [{low:+.3f}, {high:+.3f}]")


if __name__ == "__main__":
    main()
