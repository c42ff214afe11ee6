"""The closure equals the naive engine's, and every stage equals a rebuild."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from reasoner import Closure, Config
from tests.reasoner.naive import consequences
from tests.reasoner.worlds import NARROW, WIDE

MANY = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


EXAMPLES = [50, pytest.param(150, marks=pytest.mark.deep)]


def check_names(closure: Closure) -> set[str]:
    def short(name: str) -> str:
        return name.removeprefix("cls-").rstrip("1234") if name.startswith("cls-max") else name

    return {short(c.rule) for c in closure.contradictions()}


ONE_BY_ONE, IN_BULK = Config(bulk_from=10**9), Config(bulk_from=0)


@pytest.mark.slow
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("config", [ONE_BY_ONE, IN_BULK], ids=["one by one", "in bulk"])
def test_closure_is_that_of_the_rules_as_printed(config, examples):
    @settings(MANY, max_examples=examples)
    @given(st.one_of(WIDE.worlds(), NARROW.worlds(15)))
    def check(world):
        schema, data = world
        closure = Closure.build(schema, data, config=config)
        expected, bad = consequences([*schema, *data])
        asserted = {*schema, *data}
        assert set(closure.match()) - asserted == expected - asserted
        assert check_names(closure) == bad

    check()


def run_script(schema, data, script, rules=()) -> None:
    """Apply a script of edits; after each the closure must equal one built from nothing."""
    closure = Closure.build(schema, data, rules)
    asserted = {*schema, *data}
    for add, picks in script:
        ordered = sorted(asserted, key=str)
        remove = {ordered[i % len(ordered)] for i in picks if ordered} - set(add)
        before = set(closure.inferred())
        staged = closure.stage(add=add, remove=remove)
        assert set(closure.inferred()) == before
        asserted = (asserted - remove) | set(add)
        fresh = Closure.build(asserted, [], rules, IN_BULK)
        staged.apply()
        after = set(closure.inferred())
        assert after == set(fresh.inferred())
        assert not after & asserted
        assert set(staged.inferred_added) == after - before
        assert set(staged.inferred_removed) == before - after
        assert clashes(closure) == clashes(fresh)


def clashes(closure: Closure) -> set:
    return {(c.rule, c.triples) for c in closure.contradictions()}


@pytest.mark.slow
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_every_stage_equals_a_rebuild(size, examples):
    @settings(MANY, max_examples=examples)
    @given(size.worlds(), size.edits())
    def check(world, script):
        run_script(*world, script)

    check()


RULES = (
    "CONSTRUCT { ?x <urn:t:lonely> ?x } WHERE { ?x a <urn:t:C0> "
    "FILTER NOT EXISTS { ?x <urn:t:p0> ?y . ?y a <urn:t:C1> } }",
    "CONSTRUCT { ?x a <urn:t:C5> } WHERE { ?x <urn:t:lonely> ?x ; <urn:t:p1> ?y "
    "FILTER NOT EXISTS { ?y <urn:t:lonely> ?y } }",
    "CONSTRUCT { ?x <urn:t:covers> ?y } WHERE { ?x a <urn:t:C0> . ?y a <urn:t:C1> "
    "FILTER NOT EXISTS { ?y <urn:t:p0> ?z FILTER NOT EXISTS { ?x <urn:t:p1> ?z } } }",
    "CONSTRUCT { ?x <urn:t:largest> ?v } WHERE { ?x <urn:t:d0> ?v "
    "FILTER NOT EXISTS { ?x <urn:t:d0> ?w FILTER (?w > ?v) } }",
    "CONSTRUCT { ?x <urn:t:meets> ?z } WHERE { ?x <urn:t:p0>/^<urn:t:p1> ?z FILTER (?x != ?z) }",
)


@pytest.mark.slow
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_every_stage_equals_a_rebuild_with_rules_that_negate(size, examples):
    @settings(MANY, max_examples=examples)
    @given(size.worlds(), size.edits())
    def check(world, script):
        run_script(*world, script, RULES)

    check()


@pytest.mark.slow
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_changing_the_rules_equals_a_rebuild(size, examples):
    chosen = st.lists(st.sampled_from(RULES), unique=True, max_size=4)

    @settings(MANY, max_examples=examples)
    @given(size.worlds(), st.lists(chosen, min_size=1, max_size=4), st.data())
    def check(world, steps, data):
        schema, facts = world
        closure = Closure.build(schema, facts, data.draw(chosen))
        asserted = {*schema, *facts}
        for rules in steps:
            add = set(data.draw(st.lists(size.facts(), max_size=2)))
            before = set(closure.inferred())
            staged = closure.stage(rules=rules)
            assert set(closure.inferred()) == before
            staged.apply()
            closure.stage(add=add).apply()  # the rules stay in force
            asserted |= add
            fresh = Closure.build(asserted, [], rules, IN_BULK)
            assert set(closure.inferred()) == set(fresh.inferred())
            assert clashes(closure) == clashes(fresh)

    check()
