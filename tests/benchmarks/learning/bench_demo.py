"""The demo over several seeds: the first robot against the second.

    python tests/benchmarks/learning/bench_demo.py [--seeds 5] [--objects 6]

Prints one row a seed and robot, and the totals side by side with their ratio. A seed that fails
or takes longer than ten minutes is named and left out, and the exit code is 1; ten seeds take
about a quarter of an hour on two idle cores.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from simulate.study.intervals import wilson

_COLUMNS = (
    "objects_in_reach",
    "known_before",
    "recognised",
    "false_identities",
    "false_objects",
    "held",
    "placed",
    "mean_attempts_to_first_success",
    "seconds",
)


_LIMIT_S = 600.0


def run(seed: int, objects: int, folder: Path) -> list[dict[str, Any]]:
    """Run the demo once and return the totals of its two robots; none when it failed."""
    command = [
        sys.executable,
        "-m",
        "rtask",
        "demo",
        "--products",
        "plain",
        "--json",
        "--seed",
        str(seed),
    ]
    command += ["--objects", str(objects), "--data", str(folder / str(seed))]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_LIMIT_S
        )
    except subprocess.TimeoutExpired:
        print(f"{seed:4d} not done after {_LIMIT_S:.0f} s", flush=True)
        return []
    if done.returncode:
        print(f"{seed:4d} failed: {done.stderr.strip().splitlines()[-1]}", flush=True)
        return []
    robots: list[dict[str, Any]] = json.loads(done.stdout)["robots"]
    return robots


def mean_attempts(robots: list[dict[str, Any]]) -> float:
    """Return the mean over seeds of the mean attempts to first success."""
    known = [r["mean_attempts_to_first_success"] for r in robots]
    counted = [value for value in known if value is not None]
    return sum(counted) / max(len(counted), 1)


def main() -> None:
    """Run, and print both sides and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--start", type=int, default=0, help="first seed")
    parser.add_argument("--objects", type=int, default=6)
    options = parser.parse_args()
    print(f"{'seed':>4} {'robot':6s} " + " ".join(f"{name[:11]:>11s}" for name in _COLUMNS))
    failed: list[int] = []
    sides: tuple[list[dict[str, Any]], list[dict[str, Any]]] = ([], [])
    with tempfile.TemporaryDirectory(prefix="rtask-bench-") as name:
        for seed in range(options.start, options.start + options.seeds):
            robots = run(seed, options.objects, Path(name))
            if len(robots) != len(sides):
                failed.append(seed)
                continue
            for side, robot in zip(sides, robots, strict=True):
                side.append(robot)
                cells = (robot[column] for column in _COLUMNS)
                shown = (f"{c:11.2f}" if isinstance(c, float) else f"{c!s:>11s}" for c in cells)
                print(f"{seed:4d} {robot['name']:6s} " + " ".join(shown), flush=True)
    if not sides[0]:
        sys.exit("no seed ended")
    for side in sides:
        total = {column: sum(r[column] or 0 for r in side) for column in _COLUMNS}
        held, reach = total["held"], total["objects_in_reach"]
        low, high = wilson(held, reach)
        print(
            f"{side[0]['name']}: held {held}/{reach} ({held / max(reach, 1):.0%}, 95 % interval "
            f"{low:.0%} to {high:.0%}), placed {total['placed']}, "
            f"recognised {total['recognised']}/{total['known_before']}, "
            f"false {total['false_identities']}, mean attempts {mean_attempts(side):.2f}"
        )
    ratio = mean_attempts(sides[1]) / mean_attempts(sides[0])
    print(f"attempts to first success, second over first: {ratio:.2f}")
    if failed:
        sys.exit(f"seeds that did not end: {failed}")


if __name__ == "__main__":
    main()
