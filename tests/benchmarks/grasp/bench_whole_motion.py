"""Time of an object from home to home: the fastest posture that holds as well, or the first free.

    python tests/benchmarks/grasp/bench_whole_motion.py --robot panda --objects 24 --seed 1

Products of all kinds, one at a time on the table, poses known, both sides in turns. Each is grasped
and put into the box twice, with the same seed, the two ways in turns. The rule: it passes if no
fewer objects are placed, and the interval of the differences of time, over what both placed, lies
below 0. Bootstrap intervals of paired differences.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from simulate.grasping.executor import Workcell
from simulate.grasping.rules import GraspRequest
from simulate.study.intervals import mean_interval
from simulate.world.objects import KINDS, product
from simulate.world.scene import arrange
from simulate.world.seeds import stream

PRODUCTS = 200


def attempt(robot: str, seed: int, number: int, shortest: bool) -> tuple[bool, bool, float, float]:
    """Return whether the object was held and placed, the time of all phases and of planning, s."""
    with Workcell(robot, preset="fast") as cell:
        kind = KINDS[number % len(KINDS)]
        spec = product(kind, int(stream(seed, 1, number).integers(PRODUCTS)))
        side = 1 if number % 2 else -1
        (spot,) = arrange([spec], stream(seed, 2, number), [side], cell.description.workplace)
        cell.world.spawn(spec, (spot.x, spot.y), spot.yaw)
        cell.world.step(0.2)
        across = 0.0 if spec.extent[0] <= spec.extent[1] else np.pi / 2
        request = GraspRequest(
            spot.x, spot.y, spot.yaw + across,
            width=min(spec.extent[:2]), length=max(spec.extent[:2]), height=spec.extent[2],
            table_height=cell.world.table_height, round=kind in ("can", "ball", "bottle"),
        )  # fmt: skip
        cell.executor.planner.takes_shortest = shortest
        started = time.process_time()
        plan = cell.executor.plan(request, seed=number)
        planning = time.process_time() - started
        if isinstance(plan, str):
            print(f"{number}\t{spec.name}\t{plan}", flush=True)
            return False, False, np.nan, planning
        record = cell.executor.execute(plan)
        total = sum(record.times.values())
        words = f"{record.reason}\t{record.place_reason}\t{total:.1f} s\t{planning:.2f} s"
        print(f"{number}\t{spec.name}\t{'fastest' if shortest else 'first'}\t{words}", flush=True)
        return record.held, record.placed, total, planning


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--objects", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rows = []
    for number in range(args.objects):
        ways = (False, True) if number % 2 else (True, False)
        both = {way: attempt(args.robot, args.seed, number, way) for way in ways}
        rows.append([both[False], both[True]])
        table = np.array(rows, dtype=float)
        if number < args.objects - 1 and (number + 1) % 8:
            continue
        held, placed = table[:, :, 0].sum(axis=0), table[:, :, 1].sum(axis=0)
        both_placed = table[:, :, 1].all(axis=1)
        gain = table[both_placed, 1, 2] - table[both_placed, 0, 2]
        print(f"{len(table)} objects, first free | fastest")
        print(f"  held {held[0]:.0f} | {held[1]:.0f}, placed {placed[0]:.0f} | {placed[1]:.0f}")
        means = table[both_placed][:, :, 2].mean(axis=0)
        print(f"  mean time {means[0]:.1f} | {means[1]:.1f} s, difference {mean_interval(gain)}")
        plans = np.median(table[:, :, 3], axis=0)
        print(f"  planning, median {plans[0]:.3f} | {plans[1]:.3f} s of the processor", flush=True)


if __name__ == "__main__":
    main()
