"""Random edits: after each, the closure kept current equals one built from nothing.

    python tests/benchmarks/reasoner/bench_reasoner_edits.py
    python tests/benchmarks/reasoner/bench_reasoner_edits.py --edits 20000 --seed 7

The long form of `tests/reasoner/test_closure_properties.py`: the same random schemas with every
construct of OWL 2 RL, owl:sameAs between individuals, classes and properties, rules with negation,
and edits that add and remove facts and axioms. Ends with exit code 1 and the smallest failing
script that hypothesis finds. Prints how long an edit takes beside a rebuild, too.
"""

from __future__ import annotations

import argparse
import os
import time

from hypothesis import HealthCheck, Phase, given, seed, settings

from reasoner import Closure
from tests.reasoner.test_closure_properties import IN_BULK, RULES
from tests.reasoner.worlds import NARROW, WIDE, World, owl


class Count:
    """Count of what was done so far."""

    edits = scripts = equalities = removals = 0
    staged = rebuilt = 0.0


def run_script(schema: list, data: list, script: list, rules: tuple[str, ...], done: Count) -> None:
    """Apply edits; compare after each with a closure built from nothing."""
    closure = Closure.build(schema, data, rules)
    asserted = {*schema, *data}
    done.scripts += 1
    for add, picks in script:
        ordered = sorted(asserted, key=str)
        remove = {ordered[i % len(ordered)] for i in picks if ordered} - set(add)
        asserted = (asserted - remove) | set(add)
        start = time.perf_counter()
        staged = closure.stage(add=add, remove=remove)
        staged.apply()
        middle = time.perf_counter()
        fresh = Closure.build(asserted, [], rules, IN_BULK)
        done.rebuilt += time.perf_counter() - middle
        done.staged += middle - start
        done.edits += len(set(add)) + len(remove)
        done.removals += len(remove)
        done.equalities += any(t[1] == owl("sameAs") for t in asserted)
        assert set(closure.inferred()) == set(fresh.inferred())
        assert closure.digest() == fresh.digest()
        clashes = [{(c.rule, c.triples) for c in x.contradictions()} for x in (closure, fresh)]
        assert clashes[0] == clashes[1]


def search(size: World, rules: tuple[str, ...], number: int, done: Count) -> None:
    """Try a hundred scripts."""

    @seed(number)
    @settings(
        max_examples=100,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(size.worlds(), size.edits())
    def check(world: tuple, script: list) -> None:
        run_script(*world, script, rules, done)

    check()


def main() -> None:
    """Run edits until there were as many as asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--edits", type=int, default=4_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    done, number = Count(), args.seed
    while done.edits < args.edits:
        for size in (WIDE, NARROW):
            for rules in ((), RULES):
                search(size, rules, number, done)
                number += 1
    print(
        f"{done.edits} edits ({done.removals} removals) in {done.scripts} scripts, "
        f"{done.equalities} commits with owl:sameAs: every closure equal to a rebuild"
    )
    ratio = done.rebuilt / done.staged
    print(f"kept current {done.staged:.1f} s, rebuilt {done.rebuilt:.1f} s: {ratio:.1f} times")
    print(f"seeds {args.seed} to {number - 1}, load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
