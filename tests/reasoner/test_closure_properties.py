"""The closure equals the naive engine's, and every stage equals a rebuild."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from naive import consequences
from worlds import axioms, facts, merges, worlds

from reasoner import Closure

SLOW = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def everything(closure: Closure) -> set:
    return set(closure.match())


def check_names(closure: Closure) -> set[str]:
    names = {c.rule for c in closure.contradictions()}
    return {
        "maxqc" if n.startswith("cls-maxqc") else "maxc" if n.startswith("cls-maxc") else n
        for n in names
    }


@SLOW
@given(worlds())
def test_closure_is_that_of_the_rules_as_printed(world):
    schema, data = world
    closure = Closure.build(schema, data)
    expected, bad = consequences([*schema, *data])
    asserted = {*schema, *data}
    assert everything(closure) - asserted == expected - asserted
    assert check_names(closure) == bad


def edits():
    part = st.one_of(
        facts().map(lambda t: [t]),
        facts().map(lambda t: [t]),
        merges().map(lambda t: [t]),
        axioms(),
    )
    batch = st.lists(part, max_size=4).map(lambda parts: [t for p in parts for t in p])
    return st.lists(
        st.tuples(batch, st.lists(st.integers(0, 200), max_size=3)), min_size=1, max_size=4
    )


@SLOW
@given(worlds(), edits())
def test_every_stage_equals_a_rebuild(world, script):
    schema, data = world
    closure = Closure.build(schema, data)
    asserted = {*schema, *data}
    for add, picks in script:
        ordered = sorted(asserted, key=str)
        remove = {ordered[i % len(ordered)] for i in picks} - set(add) if ordered else set()
        before = set(closure.inferred())
        staged = closure.stage(add=add, remove=remove)
        assert set(closure.inferred()) == before
        asserted = (asserted - remove) | set(add)
        fresh = Closure.build(asserted, [])
        staged.apply()
        after = set(closure.inferred())
        assert after == set(fresh.inferred())
        assert not after & asserted
        assert set(staged.inferred_added) == after - before
        assert set(staged.inferred_removed) == before - after
        assert {(c.rule, *c.triples) for c in closure.contradictions()} == {
            (c.rule, *c.triples) for c in fresh.contradictions()
        }
