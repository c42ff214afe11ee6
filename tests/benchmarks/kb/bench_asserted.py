"""Queries of asserted statements alone against the same with derived ones, after each commit.

``python -m tests.benchmarks.kb.bench_asserted [STATEMENTS]`` asks both kinds in turn, each
with a commit before it. Target: at most 1.5 times the query that sees derived statements.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import psutil

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase

ROUNDS = 40
QUERIES = {
    "all about one subject": "SELECT ?p ?o { <urn:s5> ?p ?o }",
    "two patterns": "SELECT ?o { <urn:s77> <urn:q> ?x . ?x <urn:p> ?o }",
    "count over three": "SELECT (COUNT(*) AS ?n) "
    "{ ?s <urn:r> 'x5' . ?s <urn:q> ?y . ?y <urn:p> ?z }",
}


def processor_s() -> float:
    """Return the processor time of this process and its children, in s."""
    own = psutil.Process()
    return sum(sum(p.cpu_times()[:2]) for p in (own, *own.children(recursive=True)))


def ask(kb: KnowledgeBase, text: str, inferred: bool) -> float:
    """Return the time of a query in s."""
    started = time.perf_counter()
    kb.query(text, inferred=inferred, timeout_s=120)
    return time.perf_counter() - started


def main() -> None:
    """Measure and print."""
    subjects = (int(sys.argv[1]) if len(sys.argv) > 1 else 100_000) // 4
    print(f"{4 * subjects} statements and the ontology; load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder, rtask.open(":memory:") as kb:
        path = Path(folder) / "data.ttl"
        mug = f"<{ontology.NS}Mug>"
        path.write_text(
            "".join(
                f"<urn:s{i}> a {mug} ; <urn:p> {i} ; <urn:q> <urn:s{i // 7}> ; "
                f"<urn:r> 'x{i % 100}' .\n"
                for i in range(subjects)
            )
        )
        kb.load(path)
        ask(kb, QUERIES["two patterns"], True)
        before = processor_s()
        ask(kb, QUERIES["two patterns"], False)
        print(
            f"first query without derived statements: {processor_s() - before:.2f} s of processor"
        )
        for name, text in QUERIES.items():
            times: dict[bool, list[float]] = {True: [], False: []}
            for number in range(ROUNDS):
                for inferred in (True, False):
                    statement = f"<urn:{name.replace(' ', '-')}> <urn:n{inferred}> {number}"
                    kb.update(f"INSERT DATA {{ {statement} }}", agent=f"nao-{number % 3}")
                    times[inferred].append(ask(kb, text, inferred))
            default, asserted = (1e3 * statistics.median(times[kind]) for kind in (True, False))
            print(
                f"{name:24} {default:7.2f} ms, asserted {asserted:7.2f} ms: "
                f"{asserted / default:.2f} times; longest {1e3 * max(times[False]):.1f} ms"
            )


if __name__ == "__main__":
    main()
