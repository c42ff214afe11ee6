"""Benchmark of fleets: the last robot against the first, sharing and not.

    python bench_fleet.py
    python bench_fleet.py --robots 3 --objects 20 --preset faithful
    python bench_fleet.py --robots 3 --objects 20 --preset faithful --prior

The first is small, about two minutes on two idle cores; the others are the full size, half an hour
each. Half of what a robot meets is met by all, half by it alone. Without ``--prior`` robots cannot
judge shapes: they try blindly what the graph does not know, which is where sharing shows most. This
is real processes at real servers, and too few meetings for a narrow interval; many fleets in one
process are ``rtask study sharing``.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from simulate.fleet.commands import run_fleet


def main() -> None:
    """Run both ways and print both sides."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--objects", type=int, default=4)
    parser.add_argument("--table", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--preset", default="fast", choices=["faithful", "fast"])
    parser.add_argument("--prior", action="store_true")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rtask-bench-") as folder:
        result = run_fleet(
            options.robots, options.objects, options.table, options.seed,
            options.out or Path(folder), "both", options.prior, True, options.preset, False,
        )  # fmt: skip
    last = {
        name: figures["robots"][-1]["attempts_common"]
        for name, figures in result.items()
        if "robots" in figures
    }
    shared, alone = last["shared"]["mean"], last["not shared"]["mean"]
    if shared is not None and alone:
        print(f"the last robot's attempts on what others met: {shared:.2f} against {alone:.2f} "
              f"not shared, ratio {shared / alone:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
