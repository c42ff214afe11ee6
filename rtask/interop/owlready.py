"""Bridge to owlready2: copy statements to a world, and write its changes back as one commit."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import ontology
from rtask.errors import UnsupportedError
from rtask.rdf.terms import (
    DEFAULT,
    XSD,
    BlankNode,
    Literal,
    NamedNode,
    Quad,
    Subject,
    Term,
    Triple,
    TripleKey,
    iri,
    stored,
)

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["to_world", "update_from"]

_OWL, _RDF = ontology.PREFIXES["owl"], ontology.PREFIXES["rdf"]
_TYPE, _NAMED = NamedNode(_RDF + "type"), NamedNode(_OWL + "NamedIndividual")
_COUNT = NamedNode(XSD + "nonNegativeInteger")
_HEADER = {_OWL + name for name in ("imports", "versionIRI", "priorVersion")}
_SCHEMA = tuple(ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_ANONYMOUS = "http://anonymous"
_IRI = "urn:rtask:knowledge-base#"


def to_world(kb: GraphCore, graphs: Iterable[NamedNode | str] | None = None) -> Any:
    """Return a new ``owlready2.World`` with the asserted statements of graphs.

    Individuals are declared, since owlready2 ignores undeclared ones, and cardinalities get the
    datatype that OWL requires. From then on, Python floats are ``xsd:double`` in all worlds.
    Statements about statements (RDF 1.2) are left out.

    Parameters
    ----------
    graphs
        Names of graphs; all but the derived ones and the catalogue if not given.

    Raises
    ------
    UnsupportedError
        If owlready2 is not installed.
    """
    try:
        import owlready2
    except ImportError as error:
        raise UnsupportedError("owlready2 is missing: pip install owlready2") from error
    # otherwise a float read as xsd:double is stored a second time as xsd:decimal
    owlready2.declare_datatype(float, XSD + "double", float, float)
    triples = _asserted(kb, graphs)
    lines = [f"{s} {p} {_restored(p, o)} ." for s, p, o in triples]
    lines += [f"{name} {_TYPE} {_NAMED} ." for name in sorted(_individuals(triples), key=str)]
    world = owlready2.World()
    loaded = world.get_ontology(_IRI)
    loaded.load(fileobj=io.BytesIO("\n".join(lines).encode() + b"\n"), only_local=True)
    return world


def _asserted(kb: GraphCore, graphs: Iterable[NamedNode | str] | None) -> list[TripleKey]:
    if graphs is None:
        own = {kb.graphs.inferred, kb.graphs.meta, kb.graphs.provenance}
        names = [name for name in kb.store.named_graphs() if name not in own]
    else:
        names = [iri(name) for name in graphs]
    quads = (quad for name in names for quad in kb.match(graph=name))
    return list(dict.fromkeys(_triple(q) for q in quads if _has_place(q)))


def _triple(quad: Quad) -> TripleKey:
    return quad.subject, quad.predicate, quad.object


def _has_place(quad: Quad) -> bool:
    """Whether to copy a statement to owlready2; imports are not, since it would fetch them."""
    terms = (quad.subject, quad.object)
    return not any(isinstance(t, Triple) for t in terms) and quad.predicate.value not in _HEADER


def _restored(predicate: NamedNode, value: Term) -> Term:
    if predicate.value.lower().endswith("cardinality") and isinstance(value, Literal):
        return Literal(value.value, datatype=_COUNT)
    return value


def _individuals(triples: Iterable[TripleKey]) -> set[Subject]:
    return {
        s
        for s, p, o in triples
        if p == _TYPE and isinstance(s, NamedNode) and isinstance(o, NamedNode)
        if not o.value.startswith(_SCHEMA)
    }


def update_from(
    kb: GraphCore,
    world: Any,
    graph: NamedNode | str,
    agent: str | None = None,
    graphs: Iterable[NamedNode | str] | None = None,
) -> Commit | None:
    """Write the new statements of a world to a graph, and withdraw the missing ones.

    Statements with blank nodes (class expressions) are left as they are on both sides.

    Parameters
    ----------
    graph
        Target graph: receives new statements, and loses those that the world no longer has.
    graphs
        Graphs that were passed to :func:`to_world`.
    """
    name = iri(graph)
    before = {_canonical(t) for t in _asserted(kb, graphs) if _is_ground(t)}
    own = {_canonical(_triple(quad)): quad for quad in kb.match(graph=name)}
    after = {_canonical(t) for t in _statements(world) if _is_ground(t)}
    added = {t for t in after - before if t[1:] != (_TYPE, _NAMED) and not _is_header(t)}
    # owlready2 adds inverses; statements that the knowledge base derives need not be asserted
    added = {(s, p, o) for s, p, o in added if not kb.match(s, p, o, DEFAULT)}
    removed = [own[t] for t in (before - after) & own.keys()]
    if not added and not removed:
        return None
    with kb.transaction(agent=agent, note="owlready2") as tx:
        for s, p, o in added:
            tx.add(s, p, o, name)
        for quad in removed:
            tx.remove(quad.subject, quad.predicate, quad.object, name)
    return tx.commit


def _is_ground(triple: TripleKey) -> bool:
    return not any(isinstance(term, BlankNode) for term in triple)


def _is_header(triple: TripleKey) -> bool:
    """Whether a statement describes the ontology that owlready2 creates to hold all others."""
    return isinstance(triple[0], NamedNode) and triple[0].value in (_IRI, _IRI[:-1], _ANONYMOUS)


def _canonical(triple: TripleKey) -> TripleKey:
    """Return a triple with literals in stored form and numbers in one spelling."""
    s, p, o = triple
    o = stored(o)
    if isinstance(o, Literal) and o.datatype.value == XSD + "double":
        o = stored(Literal(float(o.value)))
    return s, p, o


def _statements(world: Any) -> list[TripleKey]:
    from rtask.interop.rdflib_dataset import from_rdflib

    return [tuple(map(from_rdflib, triple)) for triple in world.as_rdflib_graph()]  # type: ignore[misc]
