"""CPU that withdrawing a contributor takes.

    python bench_withdraw.py [--outcomes 50] [--objects 4] [--robots 10] [--disk] [--day]

All robots report as many outcomes each of eight grasps of each object, with reasoning on; then a
person withdraws the last one, with --day what it reported in the middle third. Every repetition has
a store of its own, in memory or on disk. Prints CPU of the process, so that other programs on the
machine do not count, and time by the clock.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from pathlib import Path

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from tests.rtask.engine import conftest as bench

_GRASP = {
    "in_object": {"x": 0.01, "y": 0.0, "z": 0.03, "theta": 1.57}, "quality": 0.6, "opening": 0.04,
}  # fmt: skip


def withdrawal(
    outcomes: int,
    objects: int,
    team: int,
    store: str,
    profile: cProfile.Profile | None = None,
    is_day: bool = False,
) -> tuple[float, float, int]:
    """Return CPU and clock time of one withdrawal, s, and the statements that it removed."""
    rng = np.random.default_rng(0)
    ann = Access("ann", "teacher")
    with rtask.open(store, base="https://example.org/kb/") as kb, Engine(kb) as engine:
        robots = [bench.Robot(f"nao-{k}", engine) for k in range(team)]
        for robot in robots:
            robot.register()
        things = [
            robots[0].insert(bench.sight(bench.Thing((0.06 + 0.002 * k, 0.05, 0.12), False, k)))[
                "objects"
            ][0]["object"]
            for k in range(objects)
        ]
        asked: dict[str, object] = {"contributor": robots[-1].name}
        for number in range(outcomes):
            if is_day and number in (outcomes // 3, 2 * outcomes // 3):
                asked["since" if number == outcomes // 3 else "until"] = time.time()
            for robot in robots:
                x = 0.005 * int(rng.integers(-4, 4))
                robot.call(
                    "report_outcome", object=things[number % objects], gripper_id=robot.gripper,
                    grasp={**_GRASP, "in_object": {**_GRASP["in_object"], "x": x}},
                    outcome=bench.held() if rng.random() < 0.6 else bench.missed(),
                )  # fmt: skip
        start, started = time.process_time(), time.perf_counter()
        if profile is not None:
            profile.enable()
        done = engine.call("withdraw_contributor", asked, ann).as_json()
        if profile is not None:
            profile.disable()
        cpu, clock = time.process_time() - start, time.perf_counter() - started
        return cpu, clock, int(done["removed"])


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--outcomes", type=int, default=50)
    parser.add_argument("--objects", type=int, default=4)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--disk", action="store_true", help="a store on disk, not in memory")
    parser.add_argument("--day", action="store_true", help="withdraw the middle third only")
    parser.add_argument("--profile", action="store_true", help="where the time goes")
    args = parser.parse_args()
    profile = cProfile.Profile() if args.profile else None
    took = []
    for _ in range(args.repeat):
        with tempfile.TemporaryDirectory() as folder:
            store = str(Path(folder) / "kb") if args.disk else ":memory:"
            sizes = args.outcomes, args.objects, args.robots
            took.append(withdrawal(*sizes, store, profile, args.day))
    cpu, clock, removed = zip(*took, strict=True)
    print(
        f"{'a third of ' if args.day else ''}{args.outcomes} outcomes of one of {args.robots} "
        f"robots, {args.objects} objects, "
        f"{removed[0]} statements removed {'on disk' if args.disk else 'in memory'}: "
        f"CPU {min(cpu):.3f} s at best, {np.median(cpu):.3f} s in the middle of {len(cpu)}; "
        f"by the clock {min(clock):.3f} s and {np.median(clock):.3f} s"
    )
    if profile is not None:
        pstats.Stats(profile).sort_stats("cumulative").print_stats(45)


if __name__ == "__main__":
    main()
