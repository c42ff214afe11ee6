"""Sets of facts that come and go, compared with the sets of Python."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterable

import pytest

from reasoner.facts.changes import FactChange, facts_in
from reasoner.facts.layer import Layer
from reasoner.facts.relations import Facts
from reasoner.terms.dictionary import Fact

FACT: Fact = (300, 301, 302)


def drawn(chance: random.Random) -> set[Fact]:
    return {
        (300 + chance.randrange(3), 400 + chance.randrange(2), 500 + chance.randrange(3))
        for _ in range(chance.randrange(6))
    }


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([FACT], []),
        ([FACT], [(300, 301, 303)]),
        ([FACT], [(300, 305, 302)]),
        ([FACT], [FACT, (300, 301, 303)]),
        ([FACT], [FACT, (300, 305, 302)]),
    ],
)
def test_changes_of_other_facts_differ_both_ways(one: list[Fact], other: list[Fact]) -> None:
    for left, right in ((one, other), (other, one)):
        assert FactChange.of(left, []) != FactChange.of(right, [])
        assert FactChange.of([], left) != FactChange.of([], right)
        assert not left or FactChange.of(left, []) != FactChange.of([], left)
        assert FactChange.of(left, []) == FactChange.of(left, [])


def test_a_change_applied_is_the_difference_of_two_sets_and_two_make_one() -> None:
    chance = random.Random(4)
    for _ in range(60):
        states = [drawn(chance) for _ in range(3)]
        first, second = (
            FactChange.of(after - before, before - after)
            for before, after in itertools.pairwise(states)
        )
        assert first == between(states[0], states[1])
        assert first.then(second) == between(states[0], states[2])
        assert first.then(first.undone()) == FactChange()
        assert first.net == len(states[1]) - len(states[0])
        assert set(facts_in(first.added)) == states[1] - states[0]


def between(before: Iterable[Fact], after: Iterable[Fact]) -> FactChange:
    return FactChange.between(FactChange.of(before, []).added, FactChange.of(after, []).added)


def test_a_layer_shows_what_holds_after_its_changes_and_leaves_its_base() -> None:
    chance = random.Random(5)
    for _ in range(60):
        before, after = drawn(chance), drawn(chance)
        layer = Layer(Facts(before))
        for fact in before - after:
            assert layer.discard(*fact)
        for fact in after - before:
            assert layer.add(*fact)
        assert (set(layer), len(layer)) == (after, len(after))
        for p in (400, 401):
            assert set(layer.pairs(p)) == {(s, o) for s, q, o in after if q == p}
            assert all(set(layer.objects(p, s)) == {o for a, q, o in after if (a, q) == (s, p)}
                       for s in range(300, 303))  # fmt: skip
        assert set(layer.base) == before
        layer.apply()
        assert set(layer.base) == after
