"""Kill writers with SIGKILL at random moments; nothing acknowledged may be lost, nothing torn.

    python tests/benchmarks/kb/stress_kills.py
    python tests/benchmarks/kb/stress_kills.py --kills 20 --seed 7

Writers commit one after the other, in eight threads that share an fsync, with a checkpoint behind
each commit, between large loads, and beside backups; each outcome is a blob and five changes. They
are killed after a random time, right after an acknowledgement, or before or behind a random
operation on a file or the store, and also while they recover from the kill before. Each folder
takes ten kills and is opened and examined between them. The folders lie in memory where the system
offers that: what SIGKILL can tear is the same there, and far more is written in the time.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import rtask
from rtask.kb.durability.journal import JournalFile
from rtask.kb.maintenance.backup import restore
from rtask.knowledge_base import KnowledgeBase
from tests.rtask.kb.writer_process import BULK, REPEATS

WORKS = ("commits", "group", "checkpoint", "bulk", "backup")
MOMENTS = ("time", "ack", "call", "call")
KILLS_PER_FOLDER = 10
IN_MEMORY = Path("/dev/shm")


class Victims:
    """The process that starts writers and kills them."""

    def __init__(self) -> None:
        script = Path(__file__).parents[2] / "rtask" / "kb" / "writer_process.py"
        self._process = subprocess.Popen(
            [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def kill_one(self, rng: random.Random, folder: Path, work: str, recovering: bool) -> str:
        """Start a writer, kill it, return at which kind of moment."""
        moment = rng.choice(("time", "call")) if recovering else rng.choice(MOMENTS)
        longest = 0.05 if recovering else 0.2
        order = {
            "folder": str(folder),
            "acks": str(folder) + ".acks",
            "work": work,
            "at": moment,
            "seconds": rng.uniform(0.0, longest),
            "calls": 2 + int(10 ** rng.uniform(0.3, 1.8 if recovering else 2.8)),
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "done\n"
        return moment

    def end(self) -> None:
        """Let the process go."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def acknowledged(folder: Path) -> dict[str, set[int]]:
    """Return what the writers of a folder were told to be stored."""
    said: dict[str, set[int]] = {"open": set(), "outcome": set(), "bulk": set(), "backup": set()}
    file = Path(str(folder) + ".acks")
    for line in file.read_text().splitlines() if file.exists() else ():
        kind, number = line.split()
        said[kind].add(int(number))
    return said


def examine(folder: Path) -> tuple[int, int]:
    """Open a folder after a kill and check everything; return outcomes and loads it holds."""
    said = acknowledged(folder)
    with rtask.open(folder, ontologies=False) as kb:
        outcomes = check_outcomes(kb, said["outcome"])
        loads = check_loads(kb, said["bulk"])
        errors = [finding for finding in kb.verify() if finding.severity == "error"]
        assert errors == [], errors
        assert kb.seq >= max(said["open"], default=0)
    numbers = [record.seq for record in JournalFile(folder / "journal").records()]
    assert numbers == list(range(1, len(numbers) + 1)), "the journal has a gap"
    assert kb_seq(folder) == len(numbers)
    return outcomes, loads


def kb_seq(folder: Path) -> int:
    """Return the number of the last commit of a closed folder."""
    return int(json.loads((folder / "checkpoint.json").read_text())["seq"])


def check_outcomes(kb: KnowledgeBase, acks: set[int]) -> int:
    """Check that outcomes 1..n are there, each whole, with every acknowledged one among them."""
    rows = kb.select("SELECT ?n { ?o <urn:number> ?n }")
    numbers = sorted(int(str(row.value("n"))) for row in rows)
    assert numbers == list(range(1, len(numbers) + 1)), "an outcome is missing or doubled"
    assert acks <= set(numbers), f"lost: {sorted(acks - set(numbers))}"
    for number in numbers:
        statements = kb.match(f"urn:outcome:{number}")
        assert len(statements) == 3, f"outcome {number} is torn"
        [image] = [q.object for q in statements if q.predicate.value == "urn:image"]
        assert kb.blobs.read(image) == b"image %d " % number * REPEATS  # type: ignore[arg-type]
    last = [quad.object.value for quad in kb.match("urn:last")]  # type: ignore[union-attr]
    assert last == ([str(len(numbers))] if numbers else [])
    return len(numbers)


def check_loads(kb: KnowledgeBase, acks: set[int]) -> int:
    """Check that each large load is there wholly or not at all."""
    rows = kb.select("SELECT ?g (COUNT(*) AS ?n) { GRAPH ?g { ?s <urn:bulk> ?o } } GROUP BY ?g")
    counts = {str(row.value("g")): int(str(row.value("n"))) for row in rows}
    assert set(counts.values()) <= {BULK}, f"torn loads: {counts}"
    assert {f"urn:bulk:{number}" for number in acks} <= set(counts), "a load is lost"
    return len(counts)


def check_backups(folder: Path) -> int:
    """Check that each backup that has its name is complete; return how many there are."""
    said = acknowledged(folder)["backup"]
    complete = 0
    for source in sorted(folder.parent.glob("backup-*")):
        if source.suffix == ".partial":
            continue
        target = source.with_name("restored-" + source.name)
        seq = int(source.name.rpartition("-")[2])
        restore(source, target)
        examine(target)
        complete += 1
        said.discard(seq)
    assert said == set(), f"backups {said} were acknowledged and cannot be restored"
    return complete


def main() -> None:
    """Kill and examine."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=None, help="random if not given")
    parser.add_argument("--disk", action="store_true", help="keep the folders on disk")
    options = parser.parse_args()
    room = IN_MEMORY if IN_MEMORY.is_dir() and not options.disk else None
    seed = random.randrange(10_000) if options.seed is None else options.seed
    rng, victims, started = random.Random(seed), Victims(), time.monotonic()
    print(f"seed {seed}", flush=True)
    kinds: Counter[str] = Counter()
    totals: Counter[str] = Counter()
    for first in range(0, options.kills, KILLS_PER_FOLDER):
        with tempfile.TemporaryDirectory(dir=room) as place:
            folder = Path(place) / "kb"
            recovering = False
            for kill in range(first, min(first + KILLS_PER_FOLDER, options.kills)):
                work = WORKS[kill % len(WORKS)]
                moment = victims.kill_one(rng, folder, work, recovering)
                kinds[f"{work}, {'recovering' if recovering else moment}"] += 1
                recovering = rng.random() < 0.4
                if not recovering:
                    examine(folder)
            outcomes, loads = examine(folder)
            totals.update(outcomes=outcomes, loads=loads, backups=check_backups(folder))
    victims.end()
    for kind, count in sorted(kinds.items()):
        print(f"{count:5d} kills: {kind}")
    held = ", ".join(f"{count} {what}" for what, count in totals.items())
    print(f"{options.kills} kills, none lost or torn: {held}; {time.monotonic() - started:.0f} s")


if __name__ == "__main__":
    main()
