"""One grasp outcome in a store of a million triples: add, delete; opening and the first write.

    python tests/benchmarks/reasoner/bench_reasoner.py
    python tests/benchmarks/reasoner/bench_reasoner.py --facts 1000000 --folder /var/tmp/million

The store holds RTASK's ontology, its sample laboratory, and kitchens until asserted and inferred
triples together pass a million. Each outcome is a commit of 26 triples by a robot (pose estimate,
attempt, outcome, feedback) with all that belongs to one: the closure, the union graph, provenance,
the journal and its fsync. Beside it, by turns, the same quads go into a bare pyoxigraph store.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from pyoxigraph import Quad, RdfFormat, Store, parse

import ontology
import rtask
from rtask.kb.commit.commit import Request
from rtask.knowledge_base import KnowledgeBase
from tests.benchmarks.reasoner.kitchens import facts, schema

LAB = "https://w3id.org/rtask-kg/kb/sample/"
OUTCOME = """
@prefix rt: <https://w3id.org/rtask-kg/ns#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix : <{lab}> .
@prefix n: <{lab}{number}/> .
n:pe a rt:PoseEstimate ; rt:poseOf :mug ; rt:estimatedPose n:p ; rt:poseConfidence 0.9e0 .
n:p a rt:Pose ; rt:inFrame :camF ; rt:atTime "{time}"^^xsd:dateTimeStamp ;
    rt:x 0.5e0 ; rt:y 0.{number}e0 ; rt:z 0.8e0 ;
    rt:qx 0.0e0 ; rt:qy 0.0e0 ; rt:qz 0.0e0 ; rt:qw 1.0e0 .
n:a a rt:GraspAttempt ; rt:performedBy :pr2 ; rt:activates :pr2Hand ; rt:executesGrasp :g1 ;
    rt:usedPoseEstimate n:pe ; rt:hasOutcome n:o .
n:o a rt:GraspOutcome ; rt:success true ; rt:hasReason rt:reason_ok ; rt:hasFeedback n:f .
n:f a rt:PhysicsFeedback ; rt:verdict true .
"""


def outcome(number: int) -> list[Quad]:
    """Return one grasp outcome as a robot writes it."""
    stamp = f"2026-02-01T{number // 3600:02}:{number // 60 % 60:02}:{number % 60:02}Z"
    text = OUTCOME.format(lab=LAB, number=number, time=stamp)
    return list(parse(text, format=RdfFormat.TURTLE))


def build(folder: Path, count: int) -> None:
    """Make the store."""
    with rtask.open(folder, base=LAB) as kb:
        kept = (kb.graphs.meta, kb.graphs.provenance)
        sample = parse(path=str(ontology.path("examples/sample.trig")))
        with kb.commit_block(Request(kb.access(), check_blobs=False)) as tx:
            tx.add_quads(quad for quad in sample if quad.graph_name not in kept)
        graph = kb.graphs.imported("kitchens")
        with kb.transaction() as tx:
            tx.add_quads((Quad(*t) for t in schema()), graph)
        request = Request(kb.access(), trusted=True)
        kb.bulk_add((Quad(*t, graph) for t in facts(count)), graph, request)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Return wall and processor seconds of a piece of work."""
    start, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - start, time.process_time() - cpu


def report(what: str, samples: list[tuple[float, float]], target: str = "") -> None:
    """Print median and 95th percentile in milliseconds."""
    walls, cpus = (sorted(s[i] * 1e3 for s in samples) for i in (0, 1))
    last = min(len(walls) - 1, int(len(walls) * 0.95))
    print(
        f"  {what:<34} {statistics.median(walls):8.2f} / {walls[last]:8.2f} ms   "
        f"cpu {statistics.median(cpus):7.2f} / {cpus[last]:7.2f} ms   {target}"
    )


def sync(folder: Path) -> None:
    """Write some kilobytes durably."""
    with (folder.parent / "probe").open("wb") as file:
        file.write(b"x" * 8_000)
        file.flush()
        os.fdatasync(file.fileno())


def change(kb: KnowledgeBase, quads: list[Quad], add: bool) -> None:
    """Commit an outcome or its deletion."""
    graph = kb.graphs.agent("pr2")
    with kb.transaction(agent="pr2") as tx:
        if add:
            tx.add_quads(quads, graph)
        else:
            for quad in quads:
                tx.remove(quad.subject, quad.predicate, quad.object, graph)


def measure(folder: Path, rounds: int) -> None:
    """Open the store, write the first time, then outcomes by turns with a bare store."""
    opening = timed(lambda: rtask.open(folder).close())
    kb = rtask.open(folder)
    with kb, tempfile.TemporaryDirectory(dir=folder.parent) as beside:
        size = kb.stats()
        parts = ", ".join(f"{size[part]} {part}" for part in ("asserted", "inferred"))
        print(f"  {size['triples']} triples: {parts}")
        report("open and close", [opening])
        report("first write, closure loaded", [timed(lambda: change(kb, outcome(0), add=True))])
        bare = Store(beside)
        batches = [outcome(i) for i in range(1, rounds + 1)]
        added, extended, removed = [], [], []
        for quads in batches:
            added.append(timed(lambda q=quads: change(kb, q, add=True)))
            extended.append(timed(lambda q=quads: (bare.extend(q), bare.flush())))
        for quads in batches:
            removed.append(timed(lambda q=quads: change(kb, q, add=False)))
        report(f"add an outcome ({len(batches[0])} triples)", added, "target 10 ms")
        synced = [timed(lambda: sync(folder)) for _ in range(rounds)]
        report("of this one fsync on this disk", synced)
        report("the same, bare store and flush", extended)
        report("delete it", removed, "target 50 ms")
        ratio = statistics.median(a for a, _ in added) / statistics.median(e for e, _ in extended)
        print(f"  adding takes {ratio:.1f} times as long as in a bare store")
        left = kb.stats()
        kept = "as before" if abs(left["inferred"] - size["inferred"]) < 100 else "CHANGED"
        print(f"  inferred graph afterwards: {left['inferred']}, {kept}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  peak resident {peak:.0f} MB")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--facts", type=int, default=280_000, help="asserted facts of kitchens")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--folder", type=Path, help="keep the store here for the next run")
    args = parser.parse_args()
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {load}")
    folder = args.folder or Path(tempfile.mkdtemp(prefix="rtask-bench-")) / "kb"
    if not folder.exists():
        wall, cpu = timed(lambda: build(folder, args.facts))
        print(f"  built the store in {wall:.0f} s (cpu {cpu:.0f} s)")
    try:
        measure(folder, args.rounds)
    finally:
        if args.folder is None:
            shutil.rmtree(folder.parent, ignore_errors=True)
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
