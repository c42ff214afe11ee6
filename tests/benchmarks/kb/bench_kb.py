"""Benchmark of commits, opening and validation, beside the bare store.

python tests/benchmarks/kb/bench_kb.py
python tests/benchmarks/kb/bench_kb.py --triples 1000000
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pyoxigraph as ox

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Quad, iri, literal

_OPEN = """
import sys, time
{imports}
start = time.perf_counter()
{work}
print(time.perf_counter() - start)
"""
_OURS = (
    "import rtask, rtask.opening",
    "kb = rtask.open(sys.argv[1]{options})\nassert kb.query('ASK {{ <urn:s1> ?p ?o }}')",
)
_RAW = (
    "import pyoxigraph",
    "store = pyoxigraph.Store(sys.argv[1] + '/store')\n"
    "assert bool(store.query('ASK {{ <urn:s1> ?p ?o }}'))",
)


def _statements(number: int) -> list[Quad]:
    subject, graph = iri(f"urn:s{number}"), iri("urn:g")
    return [Quad(subject, iri(f"urn:p{part}"), literal(number), graph) for part in range(3)]


def commit_rate(write: Callable[[int], object], seconds: float, threads: int = 1) -> float:
    """Return how many commits a second some threads make together."""
    done = [0] * threads
    end = time.perf_counter() + seconds

    def work(mine: int) -> None:
        number = mine
        while time.perf_counter() < end:
            write(number)
            number += threads
            done[mine] += 1

    workers = [threading.Thread(target=work, args=(mine,)) for mine in range(threads)]
    start = time.perf_counter()
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return sum(done) / (time.perf_counter() - start)


def commits(place: Path, seconds: float) -> None:
    """Compare commits of three statements."""
    store = ox.Store(place / "raw")

    def raw(number: int) -> None:
        store.extend(_statements(number))

    def ours(kb: KnowledgeBase) -> Callable[[int], None]:
        def write(number: int) -> None:
            with kb.transaction() as tx:
                tx.add_quads(_statements(number))

        return write

    cases: list[tuple[str, dict[str, object], int, int | None]] = [
        ("plain, flush='os'", {"flush": "os", "plain": True}, 1, 4_000),
        ("flush='os', no reasoning", {"flush": "os", "reason": False}, 1, 4_000),
        ("flush='os', closure", {"flush": "os"}, 1, None),
        ("flush='commit', 1 writer", {"reason": False}, 1, None),
        ("flush='commit', 64 writers", {"reason": False}, 64, 2_000),
        ("plain, 'commit', 64 writers", {"plain": True}, 64, 2_000),
    ]
    print(
        f"{'commits of 3 statements':30s}{'ours/s':>9s}{'extend/s':>10s}{'ratio':>7s}{'target':>8s}"
    )
    for name, options, threads, target in cases:
        peer = commit_rate(raw, seconds)
        with rtask.open(place / name.replace("'", ""), ontologies=False, **options) as kb:
            kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } }")
            rate = commit_rate(ours(kb), seconds, threads)
        goal = "" if target is None else f"{target}"
        print(f"{name:30s}{rate:9.0f}{peer:10.0f}{rate / peer:7.2f}{goal:>8s}")


def opening(place: Path, triples: int, rounds: int) -> None:
    """Compare opening a large store, first answer included, imports apart."""
    folder = place / "large"
    file = place / "large.nt"
    with file.open("w") as out:
        for number in range(triples):
            out.write(f"<urn:s{number // 4}> <urn:p{number % 4}> <urn:o{number % 1000}> .\n")
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        kb.load(file, graph="urn:g")
    sides = {
        "rtask.open": (_OURS, ", ontologies=False, reason=False"),
        "rtask.open, with ontology": (_OURS, ""),
        "pyoxigraph.Store": (_RAW, ""),
    }
    with rtask.open(folder):
        pass  # loads the ontology and derives once
    took: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(rounds):
        for name, ((imports, work), options) in sides.items():
            code = _OPEN.format(imports=imports, work=work.format(options=options))
            command = [sys.executable, "-c", code, str(folder)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True)
            took[name].append(float(answer.stdout))
    print(f"\n{f'opening {triples} triples':30s}{'seconds':>9s}   target 0.2")
    for name, times in took.items():
        print(f"{name:30s}{statistics.median(times):9.3f}")


def validation(seconds: float) -> None:
    """Compare commits of a described object with and without shapes."""
    print(f"\n{'commits of an object':30s}{'per s':>9s}{'ms':>8s}")
    for name in ("off", "warn"):
        with rtask.open(":memory:", validate=name) as kb:

            def write(number: int, kb: KnowledgeBase = kb) -> None:
                text = f'<urn:o{number}> a rt:Mug ; rt:objectId "lab/{number}" ; rt:mass 0.3e0'
                prefix = "PREFIX rt: <https://w3id.org/rtask-kg/ns#>"
                kb.update(f"{prefix} INSERT DATA {{ {text} }}", "nao-1")

            write(-1)
            rate = commit_rate(write, seconds)
        print(f"{'validate=' + name:30s}{rate:9.0f}{1e3 / rate:8.1f}")


def whole(count: int) -> None:
    """Validate a graph with many outcomes as a whole, ours and by pySHACL alone."""
    import pyshacl
    from rdflib import Graph

    import ontology

    lines = [
        f"<urn:a{n}> a rt:GraspAttempt ; rt:performedBy <urn:nao> ; rt:activates <urn:m{n}> ; "
        f"rt:executesGrasp <urn:g{n % 20}> ; rt:hasOutcome <urn:o{n}> . "
        f"<urn:o{n}> a rt:GraspOutcome ; rt:success {'true' if n % 3 else 'false'} ; "
        f"rt:hasReason rt:reason_ok ; rt:hasFeedback <urn:f{n}> . "
        f"<urn:f{n}> a rt:PhysicsFeedback ; rt:verdict true ; rt:holdTime 0.5e0 ."
        for n in range(count)
    ]
    with rtask.open(":memory:") as kb:
        prefix = "PREFIX rt: <https://w3id.org/rtask-kg/ns#>"
        kb.update(f"{prefix} INSERT DATA {{ {' '.join(lines)} }}", "nao-1")
        kb.validate()  # imports the validator
        started = time.process_time()
        found = len(kb.validate())
        ours = time.process_time() - started
        triples = kb.query("CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o }").serialize()  # type: ignore[union-attr]
    shapes = Graph()
    for path in ontology.shapes():
        shapes.parse(path)
    started = time.process_time()
    data = Graph().parse(data=triples, format="turtle")
    pyshacl.validate(data, shacl_graph=shapes, advanced=True, allow_warnings=True)
    peer = time.process_time() - started
    print(f"\n{f'validation of {count} outcomes':30s}{'s CPU':>9s}   target 3")
    print(f"{f'kb.validate(), {found} results':30s}{ours:9.2f}")
    print(f"{'pySHACL, one pass, with parsing':30s}{peer:9.2f}")


def main() -> None:
    """Measure everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triples", type=int, default=300_000)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--outcomes", type=int, default=1_000)
    options = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as place:
        commits(Path(place), options.seconds)
        opening(Path(place), options.triples, options.rounds)
    validation(options.seconds)
    whole(options.outcomes)


if __name__ == "__main__":
    main()
