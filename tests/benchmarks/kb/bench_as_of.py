"""Earlier states, by how much was changed since: how long `kb.as_of` and a first query take.

python tests/benchmarks/kb/bench_as_of.py --statements 100000

Times are of the processor, with its threads, in a folder of its own. A commit adds one statement,
which with its notes are fourteen changes.
"""

from __future__ import annotations

import argparse
import datetime as dt
import statistics
import tempfile
import time
from pathlib import Path

import rtask
from rtask.knowledge_base import KnowledgeBase

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s <urn:q> ?o }"
_BACK = (0, 1, 10, 50, 100, 300)
_COMMITS = 300


def fill(kb: KnowledgeBase, folder: Path, statements: int) -> list[str]:
    """Load so many statements, add one by one, and return the times of these commits."""
    lines = (f'<urn:s{k // 5}> <urn:p{k % 5}> "v{k}" .\n' for k in range(statements))
    file = folder / "loaded.nt"
    file.write_text("".join(lines), encoding="utf-8")
    kb.load(file)
    times = []
    for number in range(_COMMITS + 1):
        with kb.transaction("nao-1") as tx:
            tx.add(f"urn:s{number}", "urn:q", number)
        times.append(dt.datetime.now(dt.UTC).isoformat())
    return times


def asked_ms(kb: KnowledgeBase, at: int | str, expected: int) -> float:
    """Return the processor's time, ms, for an earlier state and a query of it."""
    start = time.process_time()
    with kb.as_of(at) as past:
        [row] = past.select(_COUNT)
        took = time.process_time() - start
        assert int(str(row.value("n"))) == expected
    return 1e3 * took


def main() -> None:
    """Print a row for each number of commits that are undone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--statements", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=7)
    asked = parser.parse_args()
    print("commits_undone\tstatements_undone\tby_number_ms\tby_time_ms")
    with tempfile.TemporaryDirectory() as folder, rtask.open(Path(folder) / "kb") as kb:
        times = fill(kb, Path(folder), asked.statements)
        for back in _BACK:
            seq, left = kb.seq - back, _COMMITS + 1 - back
            medians = [
                statistics.median(asked_ms(kb, at, left) for _ in range(asked.repeats))
                for at in (seq, times[left - 1])
            ]
            row = "\t".join(f"{value:.0f}" for value in medians)
            print(f"{back}\t{kb.changed_since(seq)}\t{row}", flush=True)


if __name__ == "__main__":
    main()
