"""Pending changes: an overlay of a store, and the net effect of several changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad

from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import GraphName, TripleKey, triple_key

__all__ = ["Holders", "NetChange", "Overlay", "apply_change"]


_MAX_TAKEN = 10_000


class Holders:
    """Graphs of a store that hold triples, each looked up once while nothing about it changes."""

    def __init__(self, store: GraphStore) -> None:
        self._store = store
        self._writes = store.writes
        self._graphs_of: dict[TripleKey, Sequence[GraphName]] = {}
        self._touched: set[TripleKey] | None = None

    def of(self, key: TripleKey) -> Sequence[GraphName]:
        """Return the graphs that hold a triple, the default graph included."""
        before = self._store.writes
        if self._writes != before:
            self._writes = before
            self._graphs_of.clear()
        graphs = self._graphs_of.get(key)
        if graphs is None:
            graphs = self._store.holders(key)
            # If others wrote meanwhile, it cannot be told which state was looked at.
            if before == self._store.writes:
                self._graphs_of[key] = graphs
        return graphs

    def find(self, keys: Iterable[TripleKey]) -> None:
        """Look up many triples at once, while nobody writes."""
        if self._writes != self._store.writes:
            self._writes = self._store.writes
            self._graphs_of.clear()
        graphs_of = self._graphs_of
        graphs_of.update(self._store.holders_of_each(key for key in keys if key not in graphs_of))

    def learn(self, subjects: Iterable[Sequence[Quad]], writes: int) -> None:
        """Take over all that was read of subjects, unless the store was written to since.

        Parameters
        ----------
        subjects
            Everything that the store held about each subject, in every graph.
        writes
            Its writes so far by then.
        """
        if not writes == self._writes == self._store.writes:
            return
        for quads in subjects:
            holders: dict[TripleKey, list[GraphName]] = {}
            for quad in quads:
                holders.setdefault(triple_key(quad), []).append(quad.graph_name)
            self._graphs_of.update(holders)

    def find_meanwhile(
        self, keys: Iterable[TripleKey], lock: Callable[[], AbstractContextManager[object]]
    ) -> None:
        """Look up many triples while others write, in what is followed.

        Parameters
        ----------
        lock
            Returns a context in which nobody writes; it is entered for a moment in the end.
        """
        self._touched = touched = set[TripleKey]()
        try:
            holders = self._store.holders_of_each(keys)
            with lock():
                if self._writes == self._store.writes and self._touched is touched:
                    # What others changed meanwhile was looked up before or after, and nobody knows
                    # which.
                    for key in touched:
                        holders.pop(key, None)
                    self._graphs_of.update(holders)
        finally:
            self._touched = None

    def follow(self) -> None:
        """Keep what others' changes leave as it is; begin while nobody writes."""
        self._store.followers.append(self._take)

    def unfollow(self) -> None:
        """Forget everything at the next change."""
        self._store.followers.remove(self._take)

    def _take(self, writes: Writes) -> None:
        size = len(writes.removed) + len(writes.added)
        # A gap in the count of writes means a change that was not seen here.
        if writes.is_replacement or size > _MAX_TAKEN or self._writes + 1 != self._store.writes:
            return
        touched = {triple_key(quad) for quads in (writes.removed, writes.added) for quad in quads}
        for key in touched:
            self._graphs_of.pop(key, None)
        if self._touched is not None:
            self._touched |= touched
        self._writes += 1


@dataclass
class Overlay:
    """Pending quads and graphs on top of a store.

    ``removed`` holds quads of the store, ``added`` quads that it lacks; adding what was removed
    cancels out, so both stay exact. Dictionaries keep the order of the changes.
    """

    store: GraphStore
    removed: dict[Quad, None] = field(default_factory=dict)
    added: dict[Quad, None] = field(default_factory=dict)
    created: dict[GraphName, None] = field(default_factory=dict)
    dropped: dict[GraphName, None] = field(default_factory=dict)
    _stored: set[GraphName] = field(default_factory=set, repr=False, compare=False)

    @cached_property
    def holders(self) -> Holders:
        """Graphs of the store that hold triples of the change."""
        # One for the whole change: what a check looked up, the union need not look up again.
        return Holders(self.store)

    def is_empty(self) -> bool:
        """Whether there are no changes."""
        return not (self.removed or self.added or self.created or self.dropped)

    def __contains__(self, quad: Quad) -> bool:
        return quad in self.added or (quad in self.store and quad not in self.removed)

    def remove(self, quad: Quad) -> None:
        """Remove a quad if present."""
        # It may also be stored, but a pending quad is only ever pending because it was not.
        if quad in self.added:
            del self.added[quad]
        elif quad in self.store:
            self.removed[quad] = None

    def add(self, quad: Quad) -> None:
        """Add a quad if absent, and create its graph."""
        if quad in self.removed:
            del self.removed[quad]
        elif quad not in self.store:
            self.added[quad] = None
        self.create(quad.graph_name)

    def add_all(self, quads: Iterable[Quad]) -> None:
        """Add many quads; where all of a graph goes, they are not looked up one by one."""
        is_gone: dict[GraphName, bool] = {}
        removed, added, store = self.removed, self.added, self.store
        restored: set[Quad] = set()  # stored, though their graph goes: a repetition adds nothing
        for quad in quads:
            graph = quad.graph_name
            if graph not in is_gone:
                self.create(graph)
                # Where a graph is replaced, every look-up would find what goes anyway.
                going = sum(other.graph_name == graph for other in removed)
                is_gone[graph] = going == store.count(graph)
            if quad in removed:
                del removed[quad]
                restored.add(quad)
            elif quad not in restored and (is_gone[graph] or quad not in store):
                added[quad] = None

    def has_graph(self, graph: GraphName) -> bool:
        """Whether the graph exists; the default graph always does."""
        if isinstance(graph, DefaultGraph) or graph in self.created:
            return True
        return self.store.contains_named_graph(graph) and graph not in self.dropped

    def create(self, graph: GraphName) -> None:
        """Create a graph if absent."""
        if graph in self._stored:
            return
        if self.has_graph(graph):
            if graph not in self.created:
                self._stored.add(graph)
            return
        if graph in self.dropped:
            del self.dropped[graph]
        else:
            self.created[graph] = None

    def clear(self, graph: GraphName, drop: bool) -> None:
        """Remove all quads of a graph, and with ``drop`` the graph itself."""
        if graph in self.created or graph in self._stored:  # else nothing was added to it
            for quad in [quad for quad in self.added if quad.graph_name == graph]:
                del self.added[quad]
        stored = self.store.quads_for_pattern(None, None, None, graph)
        self.removed.update(dict.fromkeys(stored))
        if not drop or isinstance(graph, DefaultGraph):
            return
        if graph in self.created:
            del self.created[graph]
        else:
            self._stored.discard(graph)
            self.dropped[graph] = None

    def quads(self, graph: GraphName) -> Iterator[Quad]:
        """Yield the quads of a graph with the changes applied."""
        for quad in self.store.quads_for_pattern(None, None, None, graph):
            if quad not in self.removed:
                yield quad
        yield from [quad for quad in self.added if quad.graph_name == graph]

    def named_graphs(self) -> list[GraphName]:
        """Return the named graphs with the changes applied."""
        existing = [g for g in self.store.named_graphs() if g not in self.dropped]
        return [*existing, *self.created]

    def touched_graphs(self) -> set[GraphName]:
        """Return every graph that changes."""
        graphs: set[GraphName] = {*self.created, *self.dropped}
        graphs.update(quad.graph_name for quad in self.removed)
        graphs.update(quad.graph_name for quad in self.added)
        return graphs


@dataclass
class NetChange:
    """Sum of several changes made one after the other: what was added and removed again cancels.

    Dictionaries keep the order of the changes.
    """

    removed: dict[Quad, None] = field(default_factory=dict)
    added: dict[Quad, None] = field(default_factory=dict)
    created: dict[GraphName, None] = field(default_factory=dict)
    dropped: dict[GraphName, None] = field(default_factory=dict)

    def join(self, change: Overlay | NetChange) -> None:
        """Add a change that was made after all the others."""
        _cancel(change.removed, self.added, self.removed)
        _cancel(change.added, self.removed, self.added)
        _cancel(change.dropped, self.created, self.dropped)
        _cancel(change.created, self.dropped, self.created)


def _cancel(
    items: Mapping[Any, None], opposite: dict[Any, None], remaining: dict[Any, None]
) -> None:
    for item in items:
        if item in opposite:
            del opposite[item]
        else:
            remaining[item] = None


def apply_change(store: GraphStore, change: Overlay | NetChange) -> None:
    """Change a private copy of the store in place."""
    raw = embedded_store(store, "a private copy").raw
    for quad in change.removed:
        raw.remove(quad)
    raw.extend(change.added)
    for graph in change.created:
        if isinstance(graph, (NamedNode, BlankNode)):
            raw.add_graph(graph)
    for graph in change.dropped:
        if isinstance(graph, (NamedNode, BlankNode)):
            raw.remove_graph(graph)
