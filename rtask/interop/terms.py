"""Terms of the store and of rdflib."""

from __future__ import annotations

import pyoxigraph as ox
import rdflib
from rdflib.term import BNode, Identifier, URIRef

from rtask.errors import DataError
from rtask.rdf.terms import Graph, Term

__all__ = ["from_rdflib", "graph_name", "to_rdflib"]


def to_rdflib(term: Term) -> Identifier:
    """Return a term as rdflib has it; literals keep their spelling.

    Raises
    ------
    DataError
        For a triple term (RDF 1.2), which rdflib has not.
    """
    if isinstance(term, ox.NamedNode):
        return URIRef(term.value)
    if isinstance(term, ox.BlankNode):
        return BNode(term.value)
    if isinstance(term, ox.Literal):
        if term.language:
            return rdflib.Literal(term.value, lang=term.language)
        datatype = URIRef(term.datatype.value)
        return rdflib.Literal(term.value, datatype=datatype, normalize=False)
    raise DataError("rdflib has no triple terms (RDF 1.2)")


def from_rdflib(term: object) -> Term:
    """Return a term as the store has it."""
    if isinstance(term, BNode):
        return ox.BlankNode(str(term))
    if isinstance(term, URIRef):
        return ox.NamedNode(str(term))
    if isinstance(term, rdflib.Literal):
        if term.language:
            return ox.Literal(str(term), language=term.language)
        if term.datatype is None:
            return ox.Literal(str(term))
        return ox.Literal(str(term), datatype=ox.NamedNode(str(term.datatype)))
    raise DataError(f"not an RDF term: {term!r}")


def graph_name(context: object) -> Graph | None:
    """Return the name of an rdflib graph; ``None`` for the default graph, the union."""
    name = getattr(context, "identifier", context)
    if name is None or str(name) in ("urn:x-rdflib:default", ""):
        return None
    found = from_rdflib(name)
    return found if isinstance(found, ox.NamedNode) else None
