"""Grasping with perception in the loop: held, placed, and why what failed did.

    python tests/benchmarks/grasp/bench_perception_trials.py
    python tests/benchmarks/grasp/bench_perception_trials.py -n 120 --seed 4711 --out trials

The first is small, about a minute on two idle cores; the second the size of the published figures,
about ten minutes. With ``--out`` it can be killed and goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from simulate.study.grasping_report import (
    COLUMNS,
    grasping_rows,
    grasping_study,
)
from simulate.study.runner import run

_TARGETS = {"held": 0.80, "placed_of_held": 0.90}


def main() -> None:
    """Run, and print the table and the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rtask-bench-") as folder:
        out = options.out or Path(folder)
        study = grasping_study(options.n, options.seed)
        results = run(study, out, options.processes, resume=True)
        summary = study.describe(results, study.settings, out).figures
    widths = (10, 8, 24, 24, 24, 24, 9)
    for row in (COLUMNS, *grasping_rows(summary)):
        print("".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)))
    print("objects not held:", json.dumps(summary["reasons_of_objects_not_held"]))
    print("held, not placed:", json.dumps(summary["reasons_not_placed"]))
    for name, target in _TARGETS.items():
        part = summary["groups"]["all"][name]
        print(f"{name}: {part['share'] or 0:.0%} against {target:.0%}")


if __name__ == "__main__":
    main()
