"""Statements of a document as they are stored: in their graphs, and with names for blank nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyoxigraph import BlankNode, NamedNode, Quad, Triple

from rtask.rdf.namespaces import uuid7
from rtask.rdf.terms import DefaultGraph, GraphName, iri

__all__ = ["prepared"]


def prepared(
    quads: Iterable[Quad], graph: GraphName, base: str, keep_blank: bool
) -> Iterator[Quad]:
    """Yield statements with their graphs; blank nodes of data become IRIs.

    IRIs let the statements be withdrawn one by one and keep their meaning in every copy.

    Parameters
    ----------
    graph
        Graph of the statements that name none.
    base
        Start of the IRIs.
    keep_blank
        Whether only blank nodes that name graphs become IRIs.
    """
    names: dict[str, NamedNode] = {}

    def name(term: Any) -> Any:
        if isinstance(term, BlankNode):
            return names.setdefault(term.value, iri(f"{base}.well-known/genid/{uuid7()}"))
        if isinstance(term, Triple):
            return Triple(name(term.subject), term.predicate, name(term.object))
        return term

    for quad in quads:
        own, subject, value = quad.graph_name, quad.subject, quad.object
        where = graph if isinstance(own, DefaultGraph) else name(own)
        if not keep_blank:
            if not isinstance(subject, NamedNode):
                subject = name(subject)
            if isinstance(value, BlankNode | Triple):
                value = name(value)
        yield Quad(subject, quad.predicate, value, where)
