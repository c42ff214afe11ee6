"""Branches of a large graph: opening, writing, reading, comparing and dropping, in processor time.

``python tests/benchmarks/world/bench_branches.py [STATEMENTS]``, and with ``--growth`` instead the
time of a commit in a branch that holds more and more.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase

_ROUNDS = 12
_PAGE = 4096
T = TypeVar("T")


def _main(statements: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        for reason in (False, True):
            size = statements if not reason else min(statements, 100_000)
            with rtask.open(path / f"kb-{reason}", ontologies=False, reason=reason) as kb:
                _fill(kb, path / "data.nt", size)
                print(f"{size} statements, reasoning {'on' if reason else 'off'}")
                _measure(kb)
                print("load", *(f"{load:.0f}" for load in os.getloadavg()), flush=True)


def _fill(kb: KnowledgeBase, file: Path, size: int) -> None:
    with file.open("w", encoding="utf-8") as out:
        for number in range(size):
            out.write(f'<urn:s{number // 10}> <urn:p{number % 10}> "{number}" .\n')
    kb.load(file, graph=f"{kb.base}graph/import/large")
    kb.checkpoint()
    kb.update("INSERT DATA { <urn:first> a <urn:Thing> }")  # builds the closure


def _measure(kb: KnowledgeBase) -> None:
    kb.branch().drop()
    rows: dict[str, list[float]] = {}

    def timed(name: str, work: Callable[[], T]) -> T:
        started = time.process_time()
        result = work()
        rows.setdefault(name, []).append((time.process_time() - started) * 1e3)
        return result

    branches: list[Any] = []
    for number in range(_ROUNDS):
        before = _resident_bytes()
        branch = timed("open, ms", lambda name=f"b{number}": kb.branch(name))
        rows.setdefault("memory, MB", []).append((_resident_bytes() - before) / 1e6)
        rows.setdefault("disk, MB", []).append(_own_bytes(branch.graph.folder) / 1e6)
        text = "INSERT DATA { <urn:a> a <urn:Thing> ; <urn:b> 1 }"
        timed("write, ms", lambda branch=branch, text=text: branch.graph.update(text))
        query = "SELECT * { <urn:s77> ?p ?o }"
        found = timed("read, ms", lambda branch=branch, query=query: branch.graph.select(query))
        assert len(found) == 10
        timed("compare, ms", branch.compare)
        branches.append(branch)
    for branch in branches[:-1]:
        timed("drop, ms", branch.drop)
    timed("merge, ms", branches[-1].merge)
    for name, values in rows.items():
        print(f"  {name:12s} median {statistics.median(values):7.2f}  largest {max(values):7.2f}")


def _growth() -> None:
    """Print the processor time of a commit of nine statements in a branch as it fills."""
    with (
        tempfile.TemporaryDirectory() as folder,
        rtask.open(Path(folder) / "kb") as kb,
        kb.branch("grows") as branch,
    ):
        held = 0
        for number, more in enumerate((0, 16, 100, 333, 833, 1666)):
            if more:
                branch.graph.update(_objects(f"bulk{number}", more))
            spent = []
            for part in range(7):
                started = time.process_time()
                branch.graph.update(_objects(f"part{number}x{part}", 3))
                spent.append((time.process_time() - started) * 1e3)
            held += 3 * more + 63
            middle = statistics.median(spent)
            print(f"{held:6d} statements: median {middle:7.2f} ms  largest {max(spent):7.2f} ms")


def _objects(name: str, count: int) -> str:
    lines = (
        f"<urn:{name}/{k}> a rt:ManipulableObject ; rt:mass {k % 90 / 100 + 0.01:.2f}e0 ; "
        f"<urn:beside{k % 5}> <urn:{name}/{(k + 1) % count}> ."
        for k in range(count)
    )
    return f"PREFIX rt: <{ontology.NS}> INSERT DATA {{ {' '.join(lines)} }}"


def _own_bytes(folder: Path) -> int:
    """Return the bytes of files that are no hard links to those of the trunk."""
    files = [path.stat() for path in folder.rglob("*") if path.is_file()]
    return sum(file.st_size for file in files if file.st_nlink == 1)


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text("ascii").split()[1]) * _PAGE


if __name__ == "__main__":
    if "--growth" in sys.argv[1:]:
        _growth()
    else:
        _main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
