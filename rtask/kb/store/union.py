"""The union of all named graphs, kept exactly in the store's default graph.

The default graph has one copy of each distinct triple, so COUNT does not count a triple once for
each graph that holds it. A triple is removed together with its last occurrence in a named graph.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator

from pyoxigraph import DefaultGraph, Quad

from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import DEFAULT, GraphName, Subject, TripleKey, triple_key

__all__ = ["input_change", "is_joined", "remaining", "union_change"]

_LARGE = 20_000
_MAX_HELD_RATIO = 4
"""So many quads that stay are read at once in less time than so many that go are looked up."""


def union_change(
    store: GraphStore,
    removed: Iterable[Quad],
    added: Iterable[Quad],
    fresh: Collection[GraphName] = (),
) -> Overlay:
    """Return the change of the default graph when these quads of named graphs change.

    Parameters
    ----------
    removed, added
        Exact change: all of ``removed`` are in the store and none of ``added`` are.
    fresh
        Graphs whose added statements are rarely in another graph, so that checking costs more
        than adding a duplicate.
    """
    change = Overlay(store)
    known = _Known(store)
    new = {triple_key(quad): quad for quad in added if is_joined(quad.graph_name)}
    gone = {quad: None for quad in removed if is_joined(quad.graph_name)}
    for key, quad in new.items():
        in_union = Quad(*key, DEFAULT)
        if quad.graph_name in fresh or not known.has(in_union):
            change.added[in_union] = None
    holds = _holder(store, gone, is_joined)
    for key in {triple_key(quad): None for quad in gone}:
        if key not in new and not holds(key):
            change.removed[Quad(*key, DEFAULT)] = None
    return change


def input_change(
    overlay: Overlay, is_input: Callable[[GraphName], bool]
) -> tuple[list[TripleKey], list[TripleKey]]:
    """Return the triples that the union of the asserted graphs gains and loses.

    A triple asserted in two graphs is lost only when it is removed from both.
    """
    new = {triple_key(quad): None for quad in overlay.added if is_input(quad.graph_name)}
    gone = {quad: None for quad in overlay.removed if is_input(quad.graph_name)}
    lost_keys = {triple_key(quad): None for quad in gone}
    known = _Known(overlay.store)
    gained = [
        key
        for key in new
        if not known.mentions(key[0]) or not _is_held(overlay.store, key, {}, is_input)
    ]
    holds = _holder(overlay.store, gone, is_input)
    lost = [key for key in lost_keys if key not in new and not holds(key)]
    return gained, lost


def _holder(
    store: GraphStore, gone: dict[Quad, None], counts: Callable[[GraphName], bool]
) -> Callable[[TripleKey], bool]:
    """Return a test whether some graph that counts holds a triple when these quads are gone."""
    if len(gone) >= _LARGE:
        graphs = [graph for graph in store.named_graphs() if counts(graph)]
        if sum(map(store.count, graphs)) <= _MAX_HELD_RATIO * len(gone):
            held = {triple_key(quad) for quad in remaining(store, gone, graphs)}
            return held.__contains__
    return lambda key: _is_held(store, key, gone, counts)


def remaining(
    store: GraphStore, gone: dict[Quad, None], graphs: Iterable[GraphName]
) -> Iterator[Quad]:
    """Yield the quads of some graphs that are not among those that go.

    Graphs that lose everything are not read.
    """
    losses = Counter(quad.graph_name for quad in gone)
    for graph in graphs:
        lost = losses[graph]
        if lost and lost == store.count(graph):
            continue
        for quad in store.quads_for_pattern(None, None, None, graph):
            if not lost or quad not in gone:
                yield quad


class _Known:
    """Cache of the subjects in a store; most subjects of a new file are new.

    Statements are grouped by subject, so one look-up covers all statements of a new subject.
    """

    def __init__(self, store: GraphStore) -> None:
        self._store = store
        self._mentioned: dict[object, bool] = {}

    def mentions(self, subject: Subject) -> bool:
        """Whether any graph has a statement about a subject."""
        found = self._mentioned.get(subject)
        if found is None:
            quads = self._store.quads_for_pattern(subject, None, None, None)
            found = self._mentioned[subject] = next(quads, None) is not None
        return found

    def has(self, quad: Quad) -> bool:
        """Whether the store holds a quad."""
        return self.mentions(quad.subject) and quad in self._store


def is_joined(graph: GraphName) -> bool:
    """Whether a graph is part of the union."""
    return not isinstance(graph, DefaultGraph) and not Graphs.is_quarantine(graph)


def _is_held(
    store: GraphStore, key: TripleKey, gone: dict[Quad, None], counts: Callable[[GraphName], bool]
) -> bool:
    return any(
        counts(quad.graph_name) and quad not in gone for quad in store.quads_for_pattern(*key, None)
    )
