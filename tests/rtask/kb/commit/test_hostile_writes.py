"""Each hostile write is stored whole or refused whole, within the bounds of a robot's commit."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

import rtask
from reasoner.fixpoint.maintenance import Maintainer
from reasoner.rules.work import Work
from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import OF_ROBOTS
from rtask.knowledge_base import KnowledgeBase
from tests.hostile_writes import KINDS, hostile_write

# With the right to state axioms, since most of these writes are refused before without it.
WRITER = Access("nao-1", "robot", frozenset(("schema",)))
SIZE = 150
ONE_STEP = 10_000
"""Combinations that one step of a rule may try before they are counted."""


@pytest.fixture(scope="module")
def opened() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:") as kb:
        kb.update("INSERT DATA { <urn:a> a <urn:B> }")
        yield kb


def state(kb: KnowledgeBase) -> tuple[int, int, set[str]]:
    count = "SELECT (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } }"
    about = "SELECT ?s ?p ?o { ?s ?p ?o FILTER(STRSTARTS(STR(?s), 'urn:')) }"
    return kb.seq, int(next(iter(kb.query(count)))["n"].value), set(map(str, kb.query(about)))


def attempt(kb: KnowledgeBase, text: str) -> rtask.Commit | RtaskError:
    try:
        return kb.update(text, access=WRITER)
    except RtaskError as refused:
        return refused


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        kind if number % 2 == 0 else pytest.param(kind, marks=pytest.mark.deep)
        for number, kind in enumerate(KINDS)
    ],
)
def test_a_hostile_write_is_stored_or_refused_whole_within_the_bounds(
    opened: KnowledgeBase, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    counters: list[Work] = []
    work = Maintainer.work

    def counted(maintainer: Maintainer, asserted: int | None = None) -> Work:
        counters.append(work(maintainer, asserted))
        return counters[-1]

    monkeypatch.setattr(Maintainer, "work", counted)
    rng = random.Random(kind)
    for number in range(3 if kind == "vocabulary" else 1):
        opened.update(f"INSERT DATA {{ <urn:harmless> <urn:p> '{kind} {number}' }}", access=WRITER)
        before = state(opened)
        counters.clear()
        text = hostile_write(kind, rng, SIZE)
        stored = attempt(opened, text)
        if isinstance(stored, RtaskError):
            assert stored.status in (409, 422), stored
            assert state(opened) == before
        else:
            assert stored.derived <= OF_ROBOTS.derived + stored.added * OF_ROBOTS.derived_each
            opened.update(text.replace("INSERT", "DELETE", 1), access=WRITER)
            assert state(opened)[2] == before[2]
        for counter in counters:
            assert counter.firings is None or counter.spent <= counter.firings + ONE_STEP
    after = opened.update(f"INSERT DATA {{ <urn:after> <urn:p> '{kind}' }}", access=WRITER)
    assert after.added == 1
