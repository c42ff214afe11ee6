"""The demo over several seeds: the first robot against the second.

    python tests/benchmarks/bench_demo.py [--seeds 5] [--objects 6]

Prints one row a seed and robot, and the totals side by side with their ratio.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

_COLUMNS = (
    "objects_in_reach",
    "known_before",
    "recognised",
    "false_identities",
    "held",
    "placed",
    "mean_attempts_to_first_success",
    "seconds",
)


def run(seed: int, objects: int, folder: Path) -> list[dict[str, Any]]:
    """Run the demo once and return the totals of its two robots."""
    command = [sys.executable, "-m", "rtask", "demo", "--json", "--seed", str(seed)]
    command += ["--objects", str(objects), "--data", str(folder / str(seed))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"seed {seed}: {done.stderr.strip().splitlines()[-1]}")
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
    parser.add_argument("--objects", type=int, default=6)
    options = parser.parse_args()
    print(f"{'seed':>4} {'robot':6s} " + " ".join(f"{name[:11]:>11s}" for name in _COLUMNS))
    sides: tuple[list[dict[str, Any]], list[dict[str, Any]]] = ([], [])
    with tempfile.TemporaryDirectory(prefix="rtask-bench-") as name:
        for seed in range(options.seeds):
            for side, robot in zip(sides, run(seed, options.objects, Path(name)), strict=True):
                side.append(robot)
                cells = (robot[column] for column in _COLUMNS)
                shown = (f"{c:11.2f}" if isinstance(c, float) else f"{c!s:>11s}" for c in cells)
                print(f"{seed:4d} {robot['name']:6s} " + " ".join(shown), flush=True)
    for side in sides:
        total = {column: sum(r[column] or 0 for r in side) for column in _COLUMNS}
        held = total["held"] / max(total["objects_in_reach"], 1)
        print(
            f"{side[0]['name']}: held {total['held']}/{total['objects_in_reach']} ({held:.0%}), "
            f"placed {total['placed']}, recognised {total['recognised']}/{total['known_before']}, "
            f"false {total['false_identities']}, mean attempts {mean_attempts(side):.2f}"
        )
    ratio = mean_attempts(sides[1]) / mean_attempts(sides[0])
    print(f"attempts to first success, second over first: {ratio:.2f}")


if __name__ == "__main__":
    main()
