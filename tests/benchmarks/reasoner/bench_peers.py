"""LUBM's 14 queries with inference, beside other engines that derive OWL 2 RL.

    python tests/benchmarks/reasoner/bench_peers.py
    python tests/benchmarks/reasoner/bench_peers.py --departments 1 --universities 1

RTASK loads the data with reasoning on and answers from its graph. The others close the same triples
in processes of their own with 8 GiB and a time limit; pyoxigraph, the store that RTASK uses, then
answers from their closure. An engine that is not installed is skipped and says so. The answers are
compared row by row with RTASK's, and with those that follow from the numbers drawn.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable
from typing import Any

from pyoxigraph import Quad, RdfFormat, Store, serialize
from pyoxigraph import Triple as RdfTriple

import rtask
from tests.benchmarks.reasoner import rivals
from tests.benchmarks.reasoner.lubm import QUERIES, Generator, query, schema

Rows = dict[int, frozenset[tuple[str, ...]]]


def main() -> None:
    """Run the benchmark and print one row for each engine."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--universities", type=int, default=1)
    given.add_argument("--departments", type=int, help="of each university; for a short run")
    given.add_argument("--limit", type=float, default=300.0, metavar="S")
    options = given.parse_args()
    generator = Generator()
    data = [
        triple
        for number in range(options.universities)
        for triple in generator.university(number, options.departments)
    ]
    axioms = schema()
    print(f"LUBM({options.universities}): {len(data)} triples, {len(axioms)} of schema; load "
          f"{os.getloadavg()[0]:.1f}")  # fmt: skip
    reference = _ours(data, axioms)
    for number, expected in generator.counts.answers.items():
        got = len(reference[number])
        print(f"  query {number}: {got} answers, {expected} drawn{_mark(got == expected)}")
    engines = {
        "RTASK's reasoner alone": rivals.ours,
        "reasonable": rivals.reasonable,
        "owlrl": rivals.owlrl,
    }
    for name, engine in engines.items():
        _peer(name, engine, [*axioms, *data], reference, options.limit)
    print("  owlready2: skipped: derives with HermiT or Pellet in Java, not with OWL 2 RL rules")
    print("  answers: " + " ".join(f"{n}:{len(rows)}" for n, rows in reference.items()))


def _ours(data: list[Any], axioms: list[Any]) -> Rows:
    text = serialize((RdfTriple(*t) for t in data), format=RdfFormat.N_TRIPLES)
    ontology = serialize((RdfTriple(*t) for t in axioms), format=RdfFormat.N_TRIPLES)
    assert text is not None
    assert ontology is not None
    with rtask.open(":memory:", ontologies=False) as kb:
        start = time.process_time()
        kb.load(ontology, format="nt", graph="urn:lubm:schema")
        report = kb.load(text, format="nt", graph="urn:lubm:data")
        loaded = time.process_time() - start
        start = time.process_time()
        rows = {n: _rows(kb.select(query(n))) for n in QUERIES}
        asked = time.process_time() - start
    _print("RTASK", loaded, asked, f"{report.derived} derived, into its store")
    return rows


def _peer(
    name: str, engine: Callable[..., Any], triples: list[Any], reference: Rows, limit_s: float
) -> None:
    context_start = time.perf_counter()
    found = rivals.closed(engine, triples, limit_s)
    if found.failure:
        print(f"  {name}: {found.failure} ({time.perf_counter() - context_start:.0f} s)")
        return
    store = Store()
    store.bulk_extend(Quad(*triple) for triple in found.triples)
    start = time.process_time()
    rows = {n: _rows(store.query(query(n))) for n in QUERIES}  # type: ignore[arg-type]
    asked = time.process_time() - start
    wrong = [str(n) for n in QUERIES if rows[n] != reference[n]]
    agrees = f"queries {', '.join(wrong)} differ" if wrong else "the same answers to all queries"
    _print(name, found.cpu, asked, f"closure only, without a store; {agrees}")


def _rows(solutions: Any) -> frozenset[tuple[str, ...]]:
    return frozenset(tuple(str(value) for value in row) for row in solutions)


def _print(name: str, loaded: float, asked: float, more: str) -> None:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  {name}: load and derive {loaded:.1f} s CPU, 14 queries {asked:.2f} s CPU, "
          f"this process up to {peak:.0f} MB; {more}")  # fmt: skip


def _mark(is_right: bool) -> str:
    return "" if is_right else "  WRONG"


if __name__ == "__main__":
    main()
