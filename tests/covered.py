"""Which share of each room's lines its tests run, without the deep ones and with them.

``make coverage ARGS="reasoner grasp"``. The difference of both columns is what `make test` leaves
to `make test-deep`, which should be half a point at most; ``--no-deep`` measures the first alone. A
room is tried by the tests that mirror it and by its own examples; what other rooms' tests run of it
does not count, so that the shares are lower bounds.

A room is measured folder by folder of its tests, and what a folder ran is kept in `--keep`: called
again, the command goes on after the last. It takes half as long again as the tests.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("ontology", "reasoner", "features", "grasp", "rtask", "endpoint", "simulate")
MARKS = {"quick": "not deep and not browser", "deep": "deep and not night and not browser"}
# Servers and commands of tests are forks, which end without the interpreter's own end.
_CONFIG = """
[run]
parallel = true
source = {room}
data_file = {data}
patch = subprocess, fork, _exit
[report]
omit = */generated/*
"""


@dataclass(frozen=True)
class Piece:
    """Some tests of a room, which one process runs.

    Parameters
    ----------
    kind
        ``quick`` or ``deep``, as in `MARKS`.
    tests
        Folders and files.
    """

    room: str
    kind: str
    name: str
    tests: tuple[str, ...]


def pieces(room: str, kind: str) -> Iterator[Piece]:
    """Yield the parts of a room's tests: each folder, the files beside them, its examples."""
    folder = ROOT / "tests" / room
    for inner in sorted(p for p in folder.iterdir() if p.is_dir()):
        if any(inner.rglob("test_*.py")):
            yield Piece(room, kind, inner.name, (str(inner.relative_to(ROOT)),))
    beside = tuple(str(p.relative_to(ROOT)) for p in sorted(folder.glob("test_*.py")))
    if beside:
        yield Piece(room, kind, "beside", beside)
    if kind == "quick":
        yield Piece(room, kind, "examples", (room,))


def _environment(config: Path) -> dict[str, str]:
    # Without compiled modules each process of a test would compile what it imports.
    kept = {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"CI": "true", "OMP_NUM_THREADS": "1", "COVERAGE_RCFILE": str(config)}


def _coverage(config: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "coverage", *map(str, arguments)],
        cwd=ROOT, env=_environment(config), check=False, capture_output=True, text=True,
    )  # fmt: skip


def _config(room: str, data: Path) -> Path:
    file = data.with_suffix(".cfg")
    file.write_text(_CONFIG.format(room=room, data=data), encoding="utf-8")
    return file


def measure(piece: Piece, folder: Path) -> None:
    """Run the tests of a piece, unless that was done before, and print how they ended."""
    data = folder / f"{piece.kind}-{piece.name}"
    ended = data.with_suffix(".ended")
    if ended.exists():
        return
    for left in folder.glob(f"{data.name}.*"):
        left.unlink()  # of a run that was killed
    config = _config(piece.room, data)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = _coverage(
        config, "run", "-m", "pytest", "-q", "-p", "no:schemathesis",
        "--timeout", "900", "-m", MARKS[piece.kind], *piece.tests,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    _coverage(config, "combine", "-q")
    counts = re.findall(r"^.*(?:passed|failed|error|deselected).*$", done.stdout, re.MULTILINE)
    last = counts[-1].strip("= ") if counts else "no tests ran"
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    line = f"{piece.room}/{piece.name} ({piece.kind}): {last}; {spent:.0f} s CPU {' '.join(failed)}"
    ended.write_text(line + "\n", encoding="utf-8")
    sys.stdout.write(f"  {line}\n")
    sys.stdout.flush()


def share(room: str, folder: Path, kinds: tuple[str, ...]) -> float:
    """Return the share of a room's lines that its measured pieces ran, in percent."""
    data = folder / ("total-" + "-".join(kinds))
    config = _config(room, data)
    parts = [p for kind in kinds for p in sorted(folder.glob(f"{kind}-*")) if not p.suffix]
    _coverage(config, "combine", "-q", "--keep", *parts)
    report = _coverage(config, "report", "--format=total", "--precision=2")
    return float(report.stdout or "nan")


def main() -> None:
    """Measure the rooms named, or all, and print a line for each as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("rooms", nargs="*", default=[], help="Without, all.")
    parser.add_argument("--no-deep", action="store_true", help="The tests of make test alone.")
    parser.add_argument(
        "--keep", type=Path, default=ROOT / ".coverage-rooms", metavar="FOLDER",
        help="What was measured; remove it to begin anew.",
    )  # fmt: skip
    given = parser.parse_args()
    for room in given.rooms or ROOMS:
        folder = given.keep.resolve() / room
        folder.mkdir(parents=True, exist_ok=True)
        kinds = ("quick",) if given.no_deep else ("quick", "deep")
        for kind in kinds:
            for piece in pieces(room, kind):
                measure(piece, folder)
        quick = share(room, folder, ("quick",))
        row = f"{room:10} make test {quick:6.2f} %"
        if not given.no_deep:
            whole = share(room, folder, kinds)
            row += f", with deep {whole:6.2f} %, left {whole - quick:5.2f}"
        sys.stdout.write(row + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
