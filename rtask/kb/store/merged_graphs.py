"""Default graphs made of several graphs (SPARQL 1.1 Query, 13.2.1: their RDF merge, a set).

The store concatenates the graphs of a dataset and yields a statement once for each graph that holds
it. Where that can change an answer, the query is evaluated on a copy that holds it once. This file
is part of the keeper's script and needs only the standard library and pyoxigraph.
"""

from __future__ import annotations

import re
from typing import Any

import pyoxigraph as ox

__all__ = ["with_merged_graphs"]

_WORD = re.compile(r"[A-Z_]+")
_DISTINCT = re.compile(r"\bSELECT\s+DISTINCT\b")
# With these, how often a pattern matches may show even in an answer without duplicates.
_COUNTING = {
    *("AVG", "COUNT", "GROUP_CONCAT", "SUM"),
    *("BNODE", "CONSTRUCT", "DESCRIBE", "RAND", "STRUUID", "UUID"),
}
_SHARED = "ASK { GRAPH ?g { ?s ?p ?o } GRAPH ?h { ?s ?p ?o } FILTER(STR(?g) < STR(?h)) }"


def with_merged_graphs(
    store: ox.Store, text: str, dataset: dict[str, Any]
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

    Returns
    -------
    The same store, unless some of the graphs share a statement and the number of matches can show
    in the answer: then a copy in memory of the graphs that the query may read.
    """
    graphs = list(dict.fromkeys(dataset.get("default_graph") or ()))
    if not graphs:
        return store, dataset
    dataset = {**dataset, "default_graph": graphs}
    if len(graphs) == 1 or not _shows_repeats(text):
        return store, dataset
    if not bool(store.query(_SHARED, named_graphs=graphs)):
        return store, dataset
    copy = ox.Store()
    for graph in graphs:
        copy.bulk_extend(
            ox.Quad(quad.subject, quad.predicate, quad.object)
            for quad in store.quads_for_pattern(None, None, None, graph)
        )
    named = dataset.get("named_graphs")
    if named is None:
        named = list(store.named_graphs())
    for graph in named:
        if store.contains_named_graph(graph):
            copy.add_graph(graph)
            copy.bulk_extend(store.quads_for_pattern(None, None, None, graph))
    return copy, {**dataset, "default_graph": [ox.DefaultGraph()], "named_graphs": named}


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
