"""Short names of terms for people: prefixed names, with labels where a name says little."""

from __future__ import annotations

import re

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

import ontology
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import XSD, Term, iri

__all__ = ["MAX_LABEL", "Names", "prefixed"]

_LABELS = (iri(ontology.PREFIXES["rdfs"] + "label"), iri(ontology.NS + "name"))
MAX_LABEL = 60
"""Characters of a label behind a name."""
_BARE = {XSD + name for name in ("integer", "decimal", "boolean")}
_LOCAL = re.compile(r"[\w/.\-]+")


def prefixed(term: Term, base: str = "") -> str:
    """Return a term in short: as in Turtle, with the prefixes of RTASK and ``kb:`` for the base.

    >>> prefixed(iri("http://www.w3.org/2001/XMLSchema#double")), prefixed(Literal(3))
    ('xsd:double', '3')
    >>> prefixed(iri("urn:lab/object/7"), "urn:lab/"), prefixed(iri("urn:x"))
    ('kb:object/7', '<urn:x>')
    """
    if isinstance(term, NamedNode):
        for prefix, start in (*ontology.PREFIXES.items(), ("kb", base)):
            local = term.value[len(start) :]
            if start and term.value.startswith(start) and _LOCAL.fullmatch(local):
                return f"{prefix}:{local}"
        return f"<{term.value}>"
    if isinstance(term, Literal):
        if term.datatype.value in _BARE:
            return term.value
        if term.language or term.datatype.value == XSD + "string":
            return str(term)
        text = str(Literal(term.value))
        return f"{text}^^{prefixed(term.datatype)}"
    if isinstance(term, Triple):
        parts = (term.subject, term.predicate, term.object)
        return f"<<( {' '.join(prefixed(part, base) for part in parts)} )>>"
    return str(term)


def _preference(label: Literal) -> tuple[bool, str]:
    return label.language not in ("en", None), str(label)


class Names:
    """Names of the terms of one knowledge base.

    An individual, and a term whose namespace has no known prefix, is shown with its label.

    Parameters
    ----------
    store, graphs
        Where labels are looked up, and what ``kb:`` stands for.
    """

    def __init__(self, store: GraphStore, graphs: Graphs) -> None:
        self._store = store
        self._base = graphs.base
        self._names: dict[Term, str] = {}

    def __call__(self, term: Term) -> str:
        """Return the name of a term."""
        name = self._names.get(term)
        if name is None:
            name = self._names[term] = self._name(term)
        return name

    def _name(self, term: Term) -> str:
        name = prefixed(term, self._base)
        if not isinstance(term, NamedNode) or name.partition(":")[0] in ontology.PREFIXES:
            return name
        label = self._label(term)
        return f"{name} {label}" if label else name

    def _label(self, term: NamedNode | BlankNode) -> str:
        """Return a label in quotes, the English one of several; empty without one."""
        for predicate in _LABELS:
            labels = [
                quad.object
                for quad in self._store.quads_for_pattern(term, predicate, None, None)
                if isinstance(quad.object, Literal)
            ]
            if labels:
                best = min(labels, key=_preference)
                return f'"{best.value[:MAX_LABEL]}"'
        return ""
