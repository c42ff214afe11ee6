"""Which share of each room's lines its tests run, without the deep ones and with them.

``make coverage ARGS="reasoner grasp"``. The difference of both columns is what `make test` leaves
to `make test-deep`, which should be half a point at most. A room is tried by the tests that mirror
it and by its own examples; what other rooms' tests run of it does not count, so that the shares are
lower bounds. Measuring takes about twice the time of the tests.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("ontology", "reasoner", "features", "grasp", "rtask", "endpoint", "simulate")
# Servers and commands of tests are forks, which end without the interpreter's own end.
_CONFIG = """
[run]
parallel = true
source = {room}
data_file = {folder}/data
patch = subprocess, fork, _exit
[report]
omit = */generated/*
"""


def share(room: str, folder: Path, marks: list[str]) -> tuple[float, str]:
    """Return the lines of a room that ran, %, in all runs so far, and how the tests ended.

    Parameters
    ----------
    folder
        Of the data; a second run with it adds to the first.
    marks
        Of pytest, such as ``-m deep``.
    """
    config = folder / "config"
    config.write_text(_CONFIG.format(room=room, folder=folder), encoding="utf-8")
    environment = os.environ | {
        "CI": "true",
        "OMP_NUM_THREADS": "1",
        "COVERAGE_RCFILE": str(config),
    }
    tests = [path for path in (f"tests/{room}", room) if (ROOT / path).is_dir()]
    done = subprocess.run(
        [sys.executable, "-m", "coverage", "run", "-m", "pytest", "-q", "-p", "no:schemathesis",
         *marks, *tests],
        cwd=ROOT, env=environment, check=False, capture_output=True, text=True,
    )  # fmt: skip
    tool = [sys.executable, "-m", "coverage"]
    subprocess.run(
        [*tool, "combine", "-q", "--append"],
        cwd=ROOT, env=environment, check=False, capture_output=True,
    )  # fmt: skip
    report = subprocess.run(
        [*tool, "report", "--format=total", "--precision=2"],
        cwd=ROOT, env=environment, check=False, capture_output=True, text=True,
    )  # fmt: skip
    ended = re.findall(r"^.*(?:passed|failed|error).*$", done.stdout, re.MULTILINE)
    return float(report.stdout or "nan"), ended[-1].strip("= ") if ended else "no tests ran"


def main() -> None:
    """Measure the rooms named, or all, and print a line for each as soon as it is there."""
    sys.stdout.write(f"{'room':10} {'make test':>9} {'with deep':>9} {'left':>6}\n")
    for room in sys.argv[1:] or ROOMS:
        with tempfile.TemporaryDirectory(prefix="covered-") as folder:
            quick, ended = share(room, Path(folder), ["-m", "not deep"])
            whole, ended_deep = share(room, Path(folder), ["-m", "deep and not night"])
        sys.stdout.write(
            f"{room:10} {quick:9.2f} {whole:9.2f} {whole - quick:6.2f}"
            f"   {ended}; deep: {ended_deep}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
