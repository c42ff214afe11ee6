"""A pending change against plain sets: what it shows, and that it stays exact."""

from __future__ import annotations

import random

import pytest
from pyoxigraph import Store

from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import DEFAULT, GraphName, NamedNode, Quad

_P = NamedNode("urn:p")
_G, _H = NamedNode("urn:g"), NamedNode("urn:h")
_GRAPHS: tuple[GraphName, ...] = (DEFAULT, _G, _H, NamedNode("urn:new"))
_QUADS = [Quad(NamedNode(f"urn:{n}"), _P, NamedNode("urn:o"), g) for n in range(3) for g in _GRAPHS]
_STORED = [quad for quad in _QUADS if quad.graph_name != _GRAPHS[3]][:7]


def _overlay() -> Overlay:
    store = EmbeddedStore(Store())
    store.extend(_STORED)
    return Overlay(store)


def _check(overlay: Overlay, shown: set[Quad], graphs: set[GraphName]) -> None:
    stored = set(_STORED)
    assert set(overlay.removed) == stored - shown
    assert set(overlay.added) == shown - stored
    assert {quad for quad in _QUADS if quad in overlay} == shown
    assert set(overlay.named_graphs()) == graphs
    assert {graph for graph in _GRAPHS if overlay.has_graph(graph)} == {DEFAULT, *graphs}
    before = {_G, _H}
    assert (set(overlay.created), set(overlay.dropped)) == (graphs - before, before - graphs)
    assert overlay.is_empty() is (shown == stored and graphs == before)
    assert overlay.touched_graphs() == {
        *(quad.graph_name for quad in shown ^ stored),
        *(graphs ^ before),
    }
    for graph in _GRAPHS:
        assert set(overlay.quads(graph)) == {q for q in shown if q.graph_name == graph}


@pytest.mark.parametrize("seed", range(30))
def test_any_changes_lead_where_plain_sets_lead(seed: int) -> None:
    chance = random.Random(seed)
    overlay = _overlay()
    shown: set[Quad] = set(_STORED)
    graphs: set[GraphName] = {_G, _H}
    _check(overlay, shown, graphs)
    for _ in range(12):
        quad, graph = chance.choice(_QUADS), chance.choice(_GRAPHS)
        match chance.randrange(5):
            case 0:
                overlay.add(quad)
                shown.add(quad)
                graphs |= {quad.graph_name} - {DEFAULT}
            case 1:
                overlay.remove(quad)
                shown.discard(quad)
            case 2:
                several = chance.choices(_QUADS, k=chance.randint(0, 6))
                overlay.add_all(several)
                shown.update(several)
                graphs |= {quad.graph_name for quad in several} - {DEFAULT}
            case 3:
                drop = chance.random() < 0.5
                if not overlay.has_graph(graph):
                    continue
                overlay.clear(graph, drop)
                shown -= {quad for quad in shown if quad.graph_name == graph}
                if drop:
                    graphs.discard(graph)
            case 4:
                overlay.create(graph)
                graphs |= {graph} - {DEFAULT}
        _check(overlay, shown, graphs)
