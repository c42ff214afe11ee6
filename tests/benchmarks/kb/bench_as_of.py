"""Earlier states of any age: how long `kb.as_of` and a first query take.

python tests/benchmarks/kb/bench_as_of.py --statements 100000 --commits 7000

Times are of the processor, with its threads, in a folder of its own. A commit adds one statement,
which with its notes are fourteen changes. The first question goes back to the first commit and
leaves copies on its way; then commits of all ages are asked for at random, and again after the
folder was closed and opened.
"""

from __future__ import annotations

import argparse
import datetime as dt
import random
import statistics
import tempfile
import time
from pathlib import Path

import rtask
from rtask.knowledge_base import KnowledgeBase

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s <urn:q> ?o }"
_SEED = 1


def fill(kb: KnowledgeBase, folder: Path, statements: int, commits: int) -> list[str]:
    """Load so many statements, add one by one, and return the times of these commits."""
    lines = (f'<urn:s{k // 5}> <urn:p{k % 5}> "v{k}" .\n' for k in range(statements))
    file = folder / "loaded.nt"
    file.write_text("".join(lines), encoding="utf-8")
    kb.load(file)
    times = []
    for number in range(commits):
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


def memory_mb() -> float:
    """Return the resident memory of this process, MB."""
    text = Path("/proc/self/status").read_text("ascii")
    return int(text.split("VmRSS:")[1].split()[0]) / 1e3


def ages(kb: KnowledgeBase, last: int, commits: int, count: int, what: str) -> None:
    """Print how long commits of all ages take, and what the kept copies take."""
    rng = random.Random(_SEED)
    before_mb, took, replayed = memory_mb(), [], []
    for _ in range(count):
        back = rng.randrange(commits)
        replayed.append(kb.replayed_for(last - back))
        took.append(asked_ms(kb, last - back, commits - back))
    ladder = kb._files.ladder
    assert ladder is not None
    p50, p95 = (statistics.quantiles(took, n=100)[k - 1] for k in (50, 95))
    print(
        f"{what}\t{p50:.0f}\t{p95:.0f}\t{max(took):.0f}\t{max(replayed)}\t{len(ladder.seqs())}\t"
        f"{ladder.own_bytes() / 1e6:.0f}\t{memory_mb() - before_mb:.1f}",
        flush=True,
    )


def main() -> None:
    """Print a row for commits of all ages: asked first, again, and after a restart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--statements", type=int, default=100_000)
    parser.add_argument("--commits", type=int, default=7_000)
    parser.add_argument("--questions", type=int, default=100)
    asked = parser.parse_args()
    commits = asked.commits
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kb"
        with rtask.open(path) as kb:
            times = fill(kb, Path(folder), asked.statements, commits)
            last = kb.seq
            oldest = last - commits + 1
            far, recent = kb.changed_since(oldest), kb.changed_since(last - 10)
            print(f"changed since the oldest {far}, since ten commits ago {recent}")
            for back in (0, 10):
                median = statistics.median(asked_ms(kb, last - back, commits - back)
                                           for _ in range(7))  # fmt: skip
                print(f"{back} commits ago: {median:.0f} ms")
            first = asked_ms(kb, oldest, 1)
            print(f"first question about the oldest: {first:.0f} ms", flush=True)
            print("asked\tp50_ms\tp95_ms\tmax_ms\tmax_replayed\tcopies\town_mb\tmemory_mb")
            ages(kb, last, commits, asked.questions, "at random")
            by_time = [asked_ms(kb, times[k], k + 1) for k in range(0, commits, commits // 20)]
            print(f"by time, median of {len(by_time)}: {statistics.median(by_time):.0f} ms")
        with rtask.open(path) as kb:
            ages(kb, last, commits, asked.questions, "after a restart")


if __name__ == "__main__":
    main()
