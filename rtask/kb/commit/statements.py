"""Annotations of single statements: confidence, validity and source (RDF 1.2 reifiers).

A reifier is an IRI that names a statement of one graph: ``<r> rdf:reifies <<( s p o )>>``, with
``rt:confidence``, ``rt:validUntil``, ``prov:wasDerivedFrom`` and, once it is withdrawn,
``prov:invalidatedAtTime`` as properties. A statement without annotations has no reifier.
"""

from __future__ import annotations

import datetime as dt
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from pyoxigraph import Quad

import ontology
from rtask.errors import DataError, UsageError
from rtask.kb.store.graph_store import GraphStore
from rtask.rdf.terms import (
    GraphName,
    Literal,
    NamedNode,
    Subject,
    Term,
    Triple,
    TripleKey,
    literal,
    moment,
    stored,
    written,
)

__all__ = [
    "CONFIDENCE",
    "INVALIDATED",
    "REIFIES",
    "VALID_UNTIL",
    "Annotation",
    "held_by",
    "notes",
    "read_annotations",
    "reification",
    "reifier_of",
    "reifiers",
    "stamp",
    "when",
]

REIFIES = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#reifies")
CONFIDENCE = NamedNode(ontology.NS + "confidence")
VALID_UNTIL = NamedNode(ontology.NS + "validUntil")
_PROV = "http://www.w3.org/ns/prov#"
SOURCE = NamedNode(_PROV + "wasDerivedFrom")
INVALIDATED = NamedNode(_PROV + "invalidatedAtTime")
_STAMP = NamedNode("http://www.w3.org/2001/XMLSchema#dateTimeStamp")


@dataclass(frozen=True)
class Annotation:
    """Annotations of a statement in one graph.

    Parameters
    ----------
    reifier
        IRI that stands for the statement.
    confidence
        In [0, 1].
    valid_until, invalidated
        When it expires, and when it was withdrawn.
    source
        IRI of what it was derived from.
    """

    graph: GraphName
    reifier: Subject
    confidence: float | None = None
    valid_until: dt.datetime | None = None
    source: NamedNode | None = None
    invalidated: dt.datetime | None = None


def stamp(value: dt.datetime | str) -> Literal:
    """Return a time as a literal of the ontology; it must have a time zone."""
    text = moment(value).isoformat().replace("+00:00", "Z")
    stamp_literal = stored(Literal(text, datatype=_STAMP))
    assert isinstance(stamp_literal, Literal)
    return stamp_literal


def notes(
    confidence: float | None = None,
    valid_until: dt.datetime | str | None = None,
    source: NamedNode | str | None = None,
) -> dict[NamedNode, Term]:
    """Return the annotations to write, by property.

    Raises
    ------
    UsageError
        If a confidence is not in [0, 1].
    """
    annotations: dict[NamedNode, Term] = {}
    if confidence is not None:
        if not 0.0 <= confidence <= 1.0:
            raise UsageError(f"a confidence lies in [0, 1], got {confidence}")
        annotations[CONFIDENCE] = stored(literal(float(confidence)))
    if valid_until is not None:
        annotations[VALID_UNTIL] = stamp(valid_until)
    if source is not None:
        annotations[SOURCE] = source if isinstance(source, NamedNode) else NamedNode(source)
    return annotations


def reifier_of(base: str, quad: Quad) -> NamedNode:
    """Return the IRI of a statement's reifier; always the same for a statement of a graph."""
    # Without chance, so that a statement that is made again finds its former annotations.
    key = f"{written(_triple(quad))} {quad.graph_name}"
    return NamedNode(f"{base}statement/{hashlib.sha256(key.encode()).hexdigest()[:32]}")


def _triple(quad: Quad) -> Triple:
    return Triple(quad.subject, quad.predicate, quad.object)


def reification(reifier: NamedNode, quad: Quad) -> Quad:
    """Return the quad that links a reifier to its statement."""
    return Quad(reifier, REIFIES, _triple(quad), quad.graph_name)


def reifiers(store: GraphStore, key: TripleKey, graph: GraphName | None = None) -> Iterator[Quad]:
    """Yield the reification quads of a statement."""
    yield from store.quads_for_pattern(None, REIFIES, Triple(*key), graph)


def read_annotations(store: GraphStore, key: TripleKey) -> list[Annotation]:
    """Return the annotations of a statement in each graph."""
    annotations = []
    for quad in [q for q in reifiers(store, key) if isinstance(q.graph_name, NamedNode)]:
        values: dict[NamedNode, Term] = {}
        for note in store.quads_for_pattern(quad.subject, None, None, quad.graph_name):
            values[note.predicate] = note.object
        source = values.get(SOURCE)
        annotations.append(
            Annotation(
                quad.graph_name,
                quad.subject,
                _number(values.get(CONFIDENCE)),
                when(values.get(VALID_UNTIL)),
                source if isinstance(source, NamedNode) else None,
                when(values.get(INVALIDATED)),
            )
        )
    return sorted(annotations, key=lambda annotation: str(annotation.reifier))


def _number(term: Term | None) -> float | None:
    try:
        return float(term.value) if isinstance(term, Literal) else None
    except ValueError:
        return None


def when(term: Term | None) -> dt.datetime | None:
    """Return the time of a literal; ``None`` if it is not a time."""
    if not isinstance(term, Literal):
        return None
    try:
        return moment(term.value)
    except UsageError:
        return None


def held_by(store: GraphStore, key: TripleKey) -> list[NamedNode]:
    """Return the named graphs that hold a statement.

    Raises
    ------
    DataError
        If no graph does.
    """
    graphs = [
        quad.graph_name
        for quad in store.quads_for_pattern(*key, None)
        if isinstance(quad.graph_name, NamedNode)
    ]
    if not graphs:
        text = " ".join(written(term) for term in key)
        raise DataError(f"no graph states {text}; nothing to retract")
    return sorted(graphs, key=str)
