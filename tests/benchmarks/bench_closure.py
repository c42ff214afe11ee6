"""How long the closure takes: built from nothing, kept current, explained; owlrl beside it.

    python tests/benchmarks/bench_closure.py
    python tests/benchmarks/bench_closure.py --sizes 10000 100000 1000000 --no-rival

The data are those of `kitchens.py`. The size of a closure is fixed by the seed; another size means
that the rules changed.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import resource
import statistics
import sys
import time
from collections.abc import Callable

from kitchens import CLOSURE_SIZES, TYPE, Term, Triple, facts, n, schema, size_of_closure
from pyoxigraph import BlankNode, NamedNode

from reasoner import Closure

RIVAL_SIZE = 1_000


def seconds(work: Callable[[], object]) -> float:
    """Return how long a piece of work takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def spread(samples: list[float]) -> str:
    """Return median and 95th percentile in milliseconds."""
    ordered = sorted(samples)
    p95 = ordered[min(len(ordered) - 1, int(len(ordered) * 0.95))]
    return f"{statistics.median(ordered) * 1e3:7.2f} / {p95 * 1e3:7.2f} ms"


def new_objects(count: int, step: int) -> list[Triple]:
    """Return a commit of `count` facts about things that were not there."""
    out: list[Triple] = []
    for i in range(count):
        thing = n(f"new{step}_{i // 2}")
        out.append((thing, TYPE, n("Cup")) if i % 2 else (thing, n("locatedIn"), n("c0_tray0_0")))
    return out


def measure(size: int) -> None:
    """Print one line per operation for one size."""
    tbox, abox = schema(), facts(size)
    closure = Closure.build([], [])

    def build() -> None:
        nonlocal closure
        closure = Closure.build(tbox, abox)

    report("build", seconds(build), f"{len(abox)} asserted")
    inferred = list(closure.inferred())
    about_data = size_of_closure(abox, inferred)
    expected = CLOSURE_SIZES.get(size)
    note = "" if expected in (None, about_data) else f"  EXPECTED {expected}"
    print(f"  {'closure':<22} {about_data:>10} triples{note}")
    for count in (1, 25, 1_000):
        commits = [new_objects(count, count * 100 + i) for i in range(9)]
        staged = [seconds(lambda c=c: closure.stage(add=c).apply()) for c in commits]
        print(f"  {f'add {count}':<22} {spread(staged)}   median / p95")
        gone = [seconds(lambda c=c: closure.stage(remove=c).apply()) for c in commits]
        print(f"  {f'retract {count}':<22} {spread(gone)}")
    chance = random.Random(2)
    picked = chance.sample(inferred, min(300, len(inferred)))
    explained = [seconds(lambda t=t: closure.explain(t)) for t in picked]
    print(f"  {'explain':<22} {spread(explained)}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  {'peak resident':<22} {peak:10.0f} MB")


def report(what: str, took: float, note: str) -> None:
    """Print one line."""
    print(f"  {what:<22} {took * 1e3:10.0f} ms     {note}")


def rival(size: int) -> None:
    """Print the same closure by owlrl, in this process."""
    from owlrl import DeductiveClosure, OWLRL_Semantics
    from rdflib import BNode, Graph, URIRef
    from rdflib import Literal as RdflibLiteral

    def node(term: Term) -> URIRef | BNode | RdflibLiteral:
        if isinstance(term, NamedNode):
            return URIRef(term.value)
        if isinstance(term, BlankNode):
            return BNode(term.value)
        return RdflibLiteral(term.value, datatype=URIRef(term.datatype.value))

    triples = [*schema(), *facts(size)]
    graph = Graph()
    for triple in triples:
        graph.add(tuple(map(node, triple)))
    theirs = seconds(lambda: DeductiveClosure(OWLRL_Semantics).expand(graph))
    ours = seconds(lambda: Closure.build(triples, []))
    report("owlrl", theirs, f"{size} asserted")
    report("reasoner", ours, f"{theirs / ours:.0f} times as fast")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--no-rival", action="store_true", help="leave owlrl out")
    args = parser.parse_args()
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {load}")
    for size in args.sizes:
        print(f"{size} facts")
        measure(size)
    if not args.no_rival:
        print(f"against owlrl, {RIVAL_SIZE} facts")
        rival(RIVAL_SIZE)
    sys.stdout.flush()


if __name__ == "__main__":
    main()
