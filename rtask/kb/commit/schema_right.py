"""The right ``schema``: which statements act as axioms, and about whose terms.

What a robot stores is data, and never the schema of others: one `rt:Mug owl:disjointWith
rt:ManipulableObject` would have every other robot's mug refused. Without the right, a caller may
state axioms about its own terms only, and only such as say nothing about the terms of others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from urllib.parse import quote

from pyoxigraph import Quad

import ontology
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import RDF_TYPE, NamedNode, Term

__all__ = ["axiom_refused", "foreign_axioms", "is_axiom", "require_schema", "stored_axioms"]

_RDF, _RDFS, _OWL = (ontology.PREFIXES[name] for name in ("rdf", "rdfs", "owl"))
_VOCABULARY = (_RDF, _RDFS, _OWL)

_ABOUT_SUBJECT = frozenset(
    {_RDFS + name for name in ("subClassOf", "subPropertyOf", "domain", "range")}
)
"""Say something about their subject, whose members or pairs belong to the object as well."""
_ABOUT_BOTH = frozenset(
    _OWL + name
    for name in (
        "sameAs", "differentFrom", "equivalentClass", "equivalentProperty", "inverseOf",
        "disjointWith", "propertyDisjointWith", "complementOf", "onProperty",
    )
)  # fmt: skip
_FILLERS = frozenset(_OWL + name for name in ("someValuesFrom", "allValuesFrom", "hasValue"))
"""Parts of a restriction; it is about the property of `owl:onProperty`."""
_ABOUT_ALL = frozenset(
    _OWL + name
    for name in (
        "propertyChainAxiom", "intersectionOf", "unionOf", "disjointUnionOf", "oneOf", "hasKey",
        "members", "distinctMembers", "maxCardinality", "maxQualifiedCardinality", "cardinality",
        "qualifiedCardinality", "onClass", "sourceIndividual", "assertionProperty",
        "targetIndividual", "targetValue",
    )
)  # fmt: skip
"""Lists, identities and negations: they reach whatever they name, or whatever is related to it."""
_LINKS = frozenset((_RDF + "first", _RDF + "rest"))
_AXIOMS = _ABOUT_SUBJECT | _ABOUT_BOTH | _FILLERS | _ABOUT_ALL
_OF_OWN_PROPERTIES = frozenset(
    _OWL + name
    for name in (
        "TransitiveProperty", "SymmetricProperty", "AsymmetricProperty", "ReflexiveProperty",
        "IrreflexiveProperty", "ObjectProperty", "DatatypeProperty", "AnnotationProperty", "Class",
        "Restriction", "Ontology",
    )
) | {_RDFS + "Class", _RDFS + "Datatype", _RDF + "Property"}  # fmt: skip
_HARMLESS_CLASSES = frozenset(
    (_OWL + "Thing", _OWL + "NamedIndividual", _RDFS + "Resource", _OWL + "Ontology")
)
_NO_META = frozenset((_OWL + "Thing", _OWL + "Nothing", _RDFS + "Resource", _RDFS + "Literal"))
"""Terms of the vocabulary that an own class may be below: they make nobody's term an axiom."""
_ANNOTATIONS = frozenset(
    _RDFS + name for name in ("label", "comment", "seeAlso", "isDefinedBy", "member")
)


def _is_vocabulary(term: Term) -> bool:
    return isinstance(term, NamedNode) and term.value.startswith(_VOCABULARY)


def is_axiom(quad: Quad) -> bool:
    """Whether a statement changes what follows from others.

    >>> from pyoxigraph import DefaultGraph
    >>> below = NamedNode("http://www.w3.org/2000/01/rdf-schema#subClassOf")
    >>> is_axiom(Quad(NamedNode("urn:a"), below, NamedNode("urn:b"), DefaultGraph()))
    True
    >>> is_axiom(Quad(NamedNode("urn:a"), NamedNode("urn:p"), NamedNode("urn:b"), DefaultGraph()))
    False
    """
    name = quad.predicate.value
    if name in _AXIOMS:
        return True
    if name == RDF_TYPE.value:
        return _is_vocabulary(quad.object) and str(quad.object)[1:-1] not in _HARMLESS_CLASSES
    return name in _LINKS and isinstance(quad.subject, NamedNode)


def foreign_axioms(
    change: Overlay, access: Access, graphs: Graphs, is_input: Callable[..., bool]
) -> Iterator[Quad]:
    """Yield the added statements for which the caller needs the right ``schema``.

    Parameters
    ----------
    is_input
        Whether the reasoner reads a graph.
    """
    own: dict[str, bool] = {}

    def is_own(term: object) -> bool:
        if not isinstance(term, NamedNode):
            return False
        known = own.get(term.value)
        if known is None:
            known = own[term.value] = _is_own(term, access, graphs, change.store)
        return known

    for quad in change.added:
        if is_axiom(quad) and is_input(quad.graph_name) and not _is_harmless(quad, is_own):
            yield quad


def _is_harmless(quad: Quad, is_own: Callable[[object], bool]) -> bool:
    """Tell whether an axiom says nothing about terms that are not the writer's own."""
    name, subject, value = quad.predicate.value, quad.subject, quad.object
    is_blank = not isinstance(subject, NamedNode)
    if name == RDF_TYPE.value:
        kind = value.value if isinstance(value, NamedNode) else ""
        return kind in _OF_OWN_PROPERTIES and (is_blank or is_own(subject))
    if name in _ABOUT_SUBJECT:
        is_meta = _is_vocabulary(value) and str(value)[1:-1] not in _NO_META | _ANNOTATIONS
        return is_own(subject) and not is_meta
    if name == _OWL + "onProperty":
        return (is_blank or is_own(subject)) and is_own(value)
    if name in _ABOUT_BOTH:
        return is_own(subject) and is_own(value)
    if name in _FILLERS:
        return is_blank or is_own(subject)
    return name in _LINKS and is_own(subject)


def _is_own(term: NamedNode, access: Access, graphs: Graphs, store: GraphStore) -> bool:
    """Tell whether a term is minted in the caller's namespace and used by nobody else."""
    if not access.agent or not term.value.startswith(namespaces(access, graphs)):
        return False
    home = access.home()
    find = store.quads_for_pattern
    found = chain(
        find(term, None, None, None), find(None, term, None, None), find(None, None, term, None)
    )
    return all(q.graph_name == home or not graphs.is_input(q.graph_name) for q in found)


def namespaces(access: Access, graphs: Graphs) -> tuple[str, ...]:
    """Return what the IRIs that a caller mints begin with.

    >>> namespaces(Access("nao-1", "robot"), Graphs("urn:lab/"))[0]
    'urn:lab/robot/nao-1/'
    """
    name = access.agent or ""
    roots = (
        graphs.agent_iri(name, access.role).value,
        f"{graphs.base}agent/{quote(name, safe='')}",
        graphs.agent(name).value,
    )
    return tuple(root + end for root in roots for end in ("/", "#"))


def require_schema(
    change: Overlay, access: Access, graphs: Graphs, is_input: Callable[..., bool]
) -> None:
    """Raise unless the caller may state the axioms of a change.

    Raises
    ------
    ForbiddenError
        Naming the first statement and the right.
    """
    if access.may_state_axioms:
        return
    quad = next(foreign_axioms(change, access, graphs, is_input), None)
    if quad is None:
        return
    raise axiom_refused(quad, access, graphs)


def axiom_refused(quad: Quad, access: Access, graphs: Graphs) -> ForbiddenError:
    """Return the error for an axiom that the caller may not state."""
    statement = f"{quad.subject} {quad.predicate} {quad.object}"
    own = namespaces(access, graphs)[0] if access.agent else ""
    return ForbiddenError(
        f"{access.role} {access.agent} may not state {statement}: it is an axiom, which holds for "
        f"everybody; that needs the right schema. About its own terms ({own}...) it may state "
        "axioms that say nothing about others",
        statement=statement,
        right="schema",
    )


def stored_axioms(
    store: GraphStore, graphs: Graphs, limit: int = 1_000
) -> Iterator[tuple[str, Quad]]:
    """Yield axioms about others' terms in the graphs of agents, with the agent's name.

    Parameters
    ----------
    limit
        Axioms of one graph that are looked at.
    """
    for graph in store.named_graphs():
        name = graphs.owner(graph)
        if not name:
            continue
        access = Access(name, "robot").bind(graphs)
        change = Overlay(store)
        held = (q for q in store.quads_for_pattern(None, None, None, graph) if is_axiom(q))
        for quad, _ in zip(held, range(limit), strict=False):
            change.added[quad] = None
        for quad in foreign_axioms(change, access, graphs, graphs.is_input):
            yield name, quad
