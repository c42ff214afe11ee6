"""What the union of all graphs gains and loses, against plain sets."""

from __future__ import annotations

import random

import pytest
from pyoxigraph import Store

from rtask.kb.store import union
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.union import input_change, union_change
from rtask.rdf.terms import DEFAULT, NamedNode, Quad, TripleKey, triple_key

_GRAPHS = [NamedNode(f"urn:g{n}") for n in range(3)]
_TRIPLES: list[TripleKey] = [
    (NamedNode(f"urn:{n}"), NamedNode("urn:p"), NamedNode("urn:o")) for n in range(4)
]
_QUADS = [Quad(*triple, graph) for triple in _TRIPLES for graph in _GRAPHS]


@pytest.fixture(params=[union._LARGE, 1], ids=["looked up", "read at once"])
def _either_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(union, "_LARGE", request.param)


def _triples(quads: set[Quad]) -> set[TripleKey]:
    return {triple_key(quad) for quad in quads}


def _drawn(seed: int) -> tuple[EmbeddedStore, set[Quad], set[Quad]]:
    """Return a store with its union, and what it has before and after a change."""
    chance = random.Random(seed)
    before = {quad for quad in _QUADS if chance.random() < 0.5}
    after = {quad for quad in _QUADS if chance.random() < 0.5}
    store = EmbeddedStore(Store())
    store.extend([*before, *(Quad(*triple, DEFAULT) for triple in _triples(before))])
    return store, before, after


@pytest.mark.usefixtures("_either_way")
@pytest.mark.parametrize("seed", range(10))
def test_the_union_changes_exactly(seed: int) -> None:
    store, before, after = _drawn(seed)
    change = union_change(store, before - after, after - before)
    assert _triples(set(change.added)) == _triples(after) - _triples(before)
    assert _triples(set(change.removed)) == _triples(before) - _triples(after)
    assert {quad.graph_name for quad in (*change.added, *change.removed)} <= {DEFAULT}


@pytest.mark.usefixtures("_either_way")
@pytest.mark.parametrize("seed", range(10))
def test_a_triple_that_the_union_gains_besides_is_not_lost(seed: int) -> None:
    store, before, after = _drawn(seed)
    besides = set(_TRIPLES[:2])
    change = union_change(store, before - after, after - before, besides=[besides])
    assert _triples(set(change.removed)) == _triples(before) - _triples(after) - besides


@pytest.mark.usefixtures("_either_way")
@pytest.mark.parametrize("seed", range(10))
def test_the_reasoner_loses_what_no_asserted_graph_holds_any_more(seed: int) -> None:
    store, before, after = _drawn(seed)
    asserted = _GRAPHS[:2]
    overlay = Overlay(
        store, removed=dict.fromkeys(before - after), added=dict.fromkeys(after - before)
    )
    gained, lost = input_change(overlay, lambda graph: graph in asserted)
    was, then = (_triples({q for q in s if q.graph_name in asserted}) for s in (before, after))
    assert then - was <= set(gained) <= then
    assert set(lost) == was - then
    assert (len(gained), len(lost)) == (len(set(gained)), len(set(lost)))
