"""Default graphs made of several graphs (SPARQL 1.1 Query, 13.2.1: their RDF merge, a set).

The store concatenates the graphs of a dataset and yields a statement once for each graph that holds
it. Where that can change an answer, the query is evaluated on a copy that holds it once. This file
is part of the keeper's script and needs only the standard library and pyoxigraph.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Collection, Iterable
from typing import Any

import pyoxigraph as ox

__all__ = ["MergedCopy", "with_merged_graphs"]

_WORD = re.compile(r"[A-Z_]+")
_DISTINCT = re.compile(r"\bSELECT\s+DISTINCT\b")
# With these, how often a pattern matches may show even in an answer without duplicates.
_COUNTING = {
    *("AVG", "COUNT", "GROUP_CONCAT", "SUM"),
    *("BNODE", "CONSTRUCT", "DESCRIBE", "RAND", "STRUUID", "UUID"),
}
_SHARED = "ASK { GRAPH ?g { ?s ?p ?o } GRAPH ?h { ?s ?p ?o } FILTER(STR(?g) < STR(?h)) }"

_MAX_LEFT_OUT = 3
"""A choice of all graphs but so many is kept; others are as many as there are callers."""
_MAX_COPIED = 1_500_000
"""Quads of a store of which a copy is kept; a reader may use so much memory for queries."""
_MAX_FOLLOWED = 20_000
"""A change with more statements costs more to follow than a new copy that nobody may ask for."""
_MERGED = ox.DefaultGraph()


class MergedCopy:
    """Copy of all graphs but a few that holds each of their statements once, and follows changes.

    It is made for the first query that reads such a choice, e.g. of the asserted graphs, and for
    the first of another choice; the graphs themselves are in it as well.
    """

    def __init__(self) -> None:
        self._copy: ox.Store | None = None
        self._left_out: frozenset[Any] = frozenset()
        self._changes = 0
        self._making, self._lock = threading.Lock(), threading.Lock()

    @property
    def is_made(self) -> bool:
        """Whether there is a copy that has to follow changes."""
        return self._copy is not None

    def serve(
        self, store: ox.Store, text: str, graphs: Collection[Any], named: Collection[Any] | None
    ) -> ox.Store | None:
        """Return the copy for a query, or ``None`` where the store itself serves it.

        Parameters
        ----------
        graphs, named
            Graphs of the default graph, and those that ``GRAPH`` may name.
        """
        chosen = set(graphs)
        if named is None or chosen != set(named):
            return None
        left_out = frozenset(graph for graph in store.named_graphs() if graph not in chosen)
        if len(left_out) > _MAX_LEFT_OUT:
            return None
        if self._copy is not None and left_out == self._left_out:
            return self._copy
        if not _shows_repeats(text) or len(store) > _MAX_COPIED:
            return None
        with self._making:
            with self._lock:
                if self._copy is not None and left_out == self._left_out:
                    return self._copy  # made while this one waited
                self._copy, changes = None, self._changes
            copy = _merged(store, graphs, graphs)
            with self._lock:
                if changes == self._changes:  # else it may lack a part of what came meanwhile
                    self._copy, self._left_out = copy, left_out
            return copy

    def drop(self) -> None:
        """Take note of a change that is not to be followed."""
        with self._lock:
            self._copy = None
            self._changes += 1

    def follow(
        self,
        removed: list[ox.Quad],
        added: list[ox.Quad],
        created: Iterable[Any],
        dropped: Collection[Any],
    ) -> None:
        """Apply a change of the store; applying it twice does no harm."""
        with self._lock:
            self._changes += 1
            self._follow(removed, added, created, dropped)

    def _follow(
        self,
        removed: list[ox.Quad],
        added: list[ox.Quad],
        created: Iterable[Any],
        dropped: Collection[Any],
    ) -> None:
        copy = self._copy
        if copy is None:
            return
        if dropped or len(removed) + len(added) > _MAX_FOLLOWED:
            self._copy = None
            return
        gone = [quad for quad in removed if self._holds(quad.graph_name)]
        for quad in gone:
            copy.remove(quad)
        for quad in gone:
            triple = quad.subject, quad.predicate, quad.object
            if all(q.graph_name == _MERGED for q in copy.quads_for_pattern(*triple, None)):
                copy.remove(ox.Quad(*triple, _MERGED))
        arrivals = [quad for quad in added if self._holds(quad.graph_name)]
        copy.extend(arrivals)
        copy.extend(ox.Quad(quad.subject, quad.predicate, quad.object) for quad in arrivals)
        for graph in created:
            if self._holds(graph):
                copy.add_graph(graph)

    def _holds(self, graph: Any) -> bool:
        return graph != _MERGED and graph not in self._left_out


def with_merged_graphs(
    store: ox.Store, text: str, dataset: dict[str, Any], merged: MergedCopy | None = None
) -> tuple[ox.Store, dict[str, Any]]:
    """Return a store and dataset in which the default graph holds no statement twice.

    Parameters
    ----------
    store
        Where the query would be evaluated.
    text
        The query.
    dataset
        Options of ``pyoxigraph.Store.query``; ``default_graph`` is a list, or absent where the
        store or the text chooses.
    merged
        A copy that follows the changes of the store, if the caller keeps one.

    Returns
    -------
    The same store, unless some of the graphs share a statement and the number of matches can show
    in the answer: then a copy in memory of the graphs that the query may read.
    """
    graphs = list(dict.fromkeys(dataset.get("default_graph") or ()))
    if not graphs:
        return store, dataset
    dataset = {**dataset, "default_graph": graphs}
    if len(graphs) == 1:
        return store, dataset
    if merged is not None:
        copy = merged.serve(store, text, graphs, dataset.get("named_graphs"))
        if copy is not None:
            return copy, {**dataset, "default_graph": [_MERGED]}
    if not _shows_repeats(text):
        return store, dataset
    if not bool(store.query(_SHARED, named_graphs=graphs)):
        return store, dataset
    named = dataset.get("named_graphs")
    if named is None:
        named = list(store.named_graphs())
    copy = _merged(store, graphs, named)
    return copy, {**dataset, "default_graph": [_MERGED], "named_graphs": named}


def _merged(store: ox.Store, graphs: Iterable[Any], named: Iterable[Any]) -> ox.Store:
    """Return a copy in memory of named graphs, with the merge of some graphs as default graph."""
    copy = ox.Store()
    for graph in graphs:
        copy.bulk_extend(
            ox.Quad(quad.subject, quad.predicate, quad.object)
            for quad in store.quads_for_pattern(None, None, None, graph)
        )
    for graph in named:
        if store.contains_named_graph(graph):
            copy.add_graph(graph)
            copy.bulk_extend(store.quads_for_pattern(None, None, None, graph))
    return copy


def _shows_repeats(text: str) -> bool:
    r"""Whether an answer may depend on how often a pattern matches; if in doubt, it may.

    >>> _shows_repeats("SELECT ?s { ?s ?p 1 }"), _shows_repeats("SELECT DISTINCT ?s { ?s ?p 1 }")
    (True, False)
    """
    upper = text.upper()
    words = _WORD.findall(upper)
    if "\\U" in upper or _COUNTING.intersection(words):
        return True
    selects = words.count("SELECT")
    if selects == 0:
        return "ASK" not in words
    return selects != 1 or not _DISTINCT.search(upper)
