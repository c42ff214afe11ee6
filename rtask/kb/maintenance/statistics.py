"""Counts of statements, graphs and commits in a knowledge base."""

from __future__ import annotations

from typing import Any

from rtask.kb.base import GraphBase
from rtask.kb.reading import Reading
from rtask.rdf.terms import NamedNode

__all__ = ["closure_state", "collect"]

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
_COUNT_DISTINCT = "SELECT (COUNT(*) AS ?n) { SELECT DISTINCT ?s ?p ?o { ?s ?p ?o } }"
_COUNT_BY_GRAPH = "SELECT ?g (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } } GROUP BY ?g"


def collect(kb: Reading) -> dict[str, Any]:
    """Return the counts of a knowledge base.

    Returns
    -------
    ``triples`` distinct statements of all graphs together; ``asserted`` and ``inferred``
    statements; ``shared`` = statements counted in more than one graph; ``graphs`` name to size;
    ``commits``; ``closure`` ``current``, ``behind`` or ``off``; ``readers`` see
    :meth:`rtask.kb.readers.pool.Readers.stats`.
    """
    sizes = _sizes(kb)
    count = _COUNT_DISTINCT if kb.store.is_view else _COUNT
    distinct = int(str(kb.select(count)[0].value("n")))
    total = sum(sizes.values())
    inferred = sizes.get(kb.graphs.inferred.value, 0)
    records = sum(sizes.get(g.value, 0) for g in (kb.graphs.meta, kb.graphs.provenance))
    return {
        "base": kb.base,
        "triples": distinct,
        "asserted": distinct if kb.plain else total - inferred - records,
        "inferred": inferred,
        "shared": 0 if kb.plain else total - distinct,
        "graphs": dict(sorted(sizes.items())),
        "commits": kb.seq,
        "closure": closure_state(kb),
        "readers": kb.readers.stats(),
    }


def _sizes(kb: Reading) -> dict[str, int]:
    if kb.plain:
        rows = kb.select(_COUNT_BY_GRAPH)
        return {str(row.value("g")): int(str(row.value("n"))) for row in rows}
    names = [g for g in kb.store.named_graphs() if isinstance(g, NamedNode)]
    counts = {g.value: kb.catalogue.triple_count(g) for g in names}
    for graph in (kb.graphs.meta, kb.graphs.provenance):
        counts[graph.value] = len(kb.match(graph=graph))
    return counts


def closure_state(kb: GraphBase) -> str:
    """Return whether the inferred graph fits the asserted ones: current, behind or off.

    It is behind after writes made with reasoning switched off; the catalogue names the inferred
    graph's commit only while the two agree.
    """
    if not kb.reasons:
        return "off"
    fits = kb.catalogue.revision(kb.graphs.inferred) is not None
    empty = not any(map(kb.graphs.is_input, kb.store.named_graphs()))
    return "current" if fits or empty else "behind"
