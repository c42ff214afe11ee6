"""Full closure: this reasoner, `reasonable` and `owlrl` on the same triples, interleaved.

    python tests/benchmarks/reasoner/bench_closure.py
    python tests/benchmarks/reasoner/bench_closure.py --sizes 100000 --rounds 5

The data are the ontology of RTASK and the kitchens of `kitchens.py`. Every engine runs in a
process of its own; what one derives and another does not is counted by rule. The size of our
closure of the kitchens is fixed by the seed: another size means that the rules changed.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections import Counter
from collections.abc import Callable
from typing import Any

import pyoxigraph

import ontology
from reasoner import Closure
from tests.benchmarks.reasoner.kitchens import (
    CLOSURE_SIZES,
    OWL,
    Triple,
    facts,
    n,
    schema,
    size_of_closure,
)
from tests.benchmarks.reasoner.rivals import Run, ours, owlrl, reason_for, reasonable, run

NARROW = 3_000
"""Facts for owlrl, which takes minutes for more."""


def ontology_triples() -> list[Triple]:
    """Return the ontology of RTASK with CORA."""
    found: dict[Triple, None] = {}
    for path in ontology.modules():
        for quad in pyoxigraph.parse(path=str(path)):
            found[quad.subject, quad.predicate, quad.object] = None
    return list(found)


def without_disjointness(triples: list[Triple]) -> list[Triple]:
    """Leave out the axioms whose join `reasonable` does in square time."""
    return [t for t in triples if t[1] != n("disjointWith", OWL)]


def medians(
    engines: dict[str, Callable[[list[Triple]], Any]], triples: list[Triple], rounds: int
) -> dict[str, Run]:
    """Run engines by turns; return the run of each with the median time."""
    runs: dict[str, list[Run]] = {name: [] for name in engines}
    for _ in range(rounds):
        for name, engine in engines.items():
            if not (runs[name] and runs[name][0].failure):
                runs[name].append(run(engine, triples))
    return {
        name: sorted(done, key=lambda r: r.seconds)[len(done) // 2] for name, done in runs.items()
    }


def report(title: str, triples: list[Triple], runs: dict[str, Run]) -> None:
    """Print one table: times, ratios, and what the engines do not agree on."""
    print(f"{title}: {len(triples)} triples")
    mine = runs["reasoner"]
    for name, found in runs.items():
        if found.failure:
            print(f"  {name:<12} {found.failure}")
            continue
        ratio = f"{found.seconds / mine.seconds:8.1f} times ours" if found is not mine else ""
        print(
            f"  {name:<12} {found.seconds:8.3f} s  (cpu {found.cpu:7.3f} s) "
            f"{len(found.triples):>8} triples {ratio}"
        )
    for name, found in runs.items():
        if found is not mine and not found.failure:
            _compare(name, found, mine)


def _compare(name: str, theirs: Run, mine: Run) -> None:
    for side, left in (
        (f"only {name}", theirs.triples - mine.triples),
        ("only reasoner", mine.triples - theirs.triples),
    ):
        counts = Counter(map(reason_for, left)).most_common(6)
        print(f"    {side}: {len(left)}  " + "; ".join(f"{k} {c}" for k, c in counts))


def check_sizes() -> None:
    """Compare the closure of kitchens with the known size."""
    abox = facts(10_000)
    inferred = list(Closure.build(schema(), abox).inferred())
    found = size_of_closure(abox, inferred)
    print(f"closure of 10000 facts: {found} triples, expected {CLOSURE_SIZES[10_000]}")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 50_000])
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {load}")
    check_sizes()
    tbox = ontology_triples()
    small = [*schema(), *facts(NARROW)]
    three = {"reasoner": ours, "reasonable": reasonable, "owlrl": owlrl}
    report(f"kitchens, {NARROW} facts", small, medians(three, small, 1))
    two = {"reasoner": ours, "reasonable": reasonable}
    report("ontology alone", tbox, medians(two, tbox, args.rounds))
    for size in args.sizes:
        triples = [*tbox, *schema(), *facts(size)]
        report(f"ontology and kitchens, {size} facts", triples, medians(two, triples, args.rounds))
        best = without_disjointness(triples)
        report("  the same without disjointWith", best, medians(two, best, args.rounds))
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
