"""CPU that withdrawing a contributor takes.

    python -m tests.benchmarks.bench_withdraw [--outcomes 50] [--objects 4] [--robots 10]

All robots report as many outcomes each of eight grasps of each object, with reasoning on; then a
person withdraws the last one. Every repetition has a store of its own. Process CPU, so that other
programs on the machine do not count.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from tests.rtask.engine import conftest as bench

_GRASP = {
    "in_object": {"x": 0.01, "y": 0.0, "z": 0.03, "theta": 1.57}, "quality": 0.6, "opening": 0.04,
}  # fmt: skip


def withdrawal(
    outcomes: int, objects: int, team: int, profile: cProfile.Profile | None = None
) -> tuple[float, int]:
    """Return the CPU of one withdrawal, s, and the statements that it removed."""
    rng = np.random.default_rng(0)
    ann = Access("ann", "teacher")
    with rtask.open(":memory:", base="https://example.org/kb/") as kb, Engine(kb) as engine:
        robots = [bench.Robot(f"nao-{k}", engine) for k in range(team)]
        for robot in robots:
            robot.register()
        things = [
            robots[0].insert(bench.sight(bench.Thing((0.06 + 0.002 * k, 0.05, 0.12), False, k)))[
                "objects"
            ][0]["object"]
            for k in range(objects)
        ]
        for number in range(outcomes):
            for robot in robots:
                x = 0.005 * int(rng.integers(-4, 4))
                robot.call(
                    "report_outcome", object=things[number % objects], gripper_id=robot.gripper,
                    grasp={**_GRASP, "in_object": {**_GRASP["in_object"], "x": x}},
                    outcome=bench.held() if rng.random() < 0.6 else bench.missed(),
                )  # fmt: skip
        start = time.process_time()
        if profile is not None:
            profile.enable()
        done = engine.call("withdraw_contributor", {"contributor": robots[-1].name}, ann).as_json()
        if profile is not None:
            profile.disable()
        return time.process_time() - start, int(done["removed"])


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--outcomes", type=int, default=50)
    parser.add_argument("--objects", type=int, default=4)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--profile", action="store_true", help="where the time goes")
    args = parser.parse_args()
    profile = cProfile.Profile() if args.profile else None
    took = [
        withdrawal(args.outcomes, args.objects, args.robots, profile) for _ in range(args.repeat)
    ]
    cpu = [seconds for seconds, _ in took]
    print(
        f"{args.outcomes} outcomes of one of {args.robots} robots, {args.objects} objects, "
        f"{took[0][1]} statements removed: "
        f"CPU {min(cpu):.3f} s at best, {np.median(cpu):.3f} s in the middle of {len(cpu)}"
    )
    if profile is not None:
        pstats.Stats(profile).sort_stats("cumulative").print_stats(45)


if __name__ == "__main__":
    main()
