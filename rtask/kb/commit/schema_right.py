"""The right ``schema``: which statements act as axioms, and about whose terms.

What a robot stores is data, and never the schema of others: one `rt:Mug owl:disjointWith
rt:ManipulableObject` would have every other robot's mug refused. Without the right, a caller may
state axioms about its own terms only, and only such as say nothing about the terms of others. About
a term that an ontology declares it may state nothing at all.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from itertools import chain, islice
from urllib.parse import quote

from pyoxigraph import BlankNode, NamedNode, Quad

import ontology
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import RDF_TYPE, GraphName, Term, iri

__all__ = [
    "SchemaRight", "axiom_refused", "foreign_axioms", "is_axiom", "require_schema",
    "stored_axioms",
]  # fmt: skip

_RDF, _RDFS, _OWL = (ontology.PREFIXES[name] for name in ("rdf", "rdfs", "owl"))
_VOCABULARY = (_RDF, _RDFS, _OWL)
_SHORT_ID = iri(ontology.NS + "shortId")

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
        "targetIndividual", "targetValue", "minCardinality", "minQualifiedCardinality", "hasSelf",
        "onDataRange", "onDatatype", "withRestrictions", "datatypeComplementOf", "onProperties",
    )
)  # fmt: skip
"""Lists, identities and negations: they reach whatever they name, or whatever is related to it."""
_LISTS = frozenset(
    _OWL + name
    for name in (
        "propertyChainAxiom", "intersectionOf", "unionOf", "disjointUnionOf", "oneOf", "hasKey",
        "members", "distinctMembers", "withRestrictions", "onProperties",
    )
)  # fmt: skip
"""Those whose object is a list."""
_OBJECT_ID = NamedNode(ontology.NS + "objectId")
"""Key of objects (`owl:hasKey`)."""
_REST = NamedNode(_RDF + "rest")
_LINKS = frozenset((_RDF + "first", _REST.value))
_MAX_CELLS = 20_000
"""Cells before another that are looked at; a cell of a longer list counts as part of an axiom."""
_MAX_USES = 1_000
"""Statements about a term that are looked at one by one."""
_AXIOMS = _ABOUT_SUBJECT | _ABOUT_BOTH | _FILLERS | _ABOUT_ALL
_OF_OWN_PROPERTIES = frozenset(
    _OWL + name
    for name in (
        "TransitiveProperty", "SymmetricProperty", "AsymmetricProperty", "ReflexiveProperty",
        "IrreflexiveProperty", "ObjectProperty", "DatatypeProperty", "AnnotationProperty", "Class",
        "Restriction", "Ontology",
    )
) | {_RDFS + "Class", _RDFS + "Datatype", _RDF + "Property"}  # fmt: skip
_HARMLESS_CLASSES = (
    {_RDF + name for name in ("List", "Statement", "Bag", "Seq", "Alt", "CompoundLiteral")}
    | {_RDFS + name for name in ("Resource", "Container")}
    | {_OWL + name for name in ("Thing", "NamedIndividual", "Ontology", "Axiom", "Annotation")}
)
"""Nothing follows from being one: individuals, lists, containers, notes on statements."""
_NO_META = frozenset((_OWL + "Thing", _OWL + "Nothing", _RDFS + "Resource", _RDFS + "Literal"))
"""Terms of the vocabulary that an own class may be below: they make nobody's term an axiom."""
_ANNOTATIONS = frozenset(
    _RDFS + name for name in ("label", "comment", "seeAlso", "isDefinedBy", "member")
)


def _is_vocabulary(term: Term) -> bool:
    return isinstance(term, NamedNode) and term.value.startswith(_VOCABULARY)


def is_axiom(quad: Quad) -> bool:
    """Whether a statement may change what follows from others.

    A cell of a list does so if the list is part of an axiom, and is data otherwise.

    >>> from pyoxigraph import DefaultGraph
    >>> below = NamedNode("http://www.w3.org/2000/01/rdf-schema#subClassOf")
    >>> is_axiom(Quad(NamedNode("urn:a"), below, NamedNode("urn:b"), DefaultGraph()))
    True
    >>> is_axiom(Quad(NamedNode("urn:a"), NamedNode("urn:p"), NamedNode("urn:b"), DefaultGraph()))
    False
    """
    name = quad.predicate.value
    if name in _AXIOMS or name in _LINKS:
        return True
    if name == RDF_TYPE.value:
        return _is_vocabulary(quad.object) and str(quad.object)[1:-1] not in _HARMLESS_CLASSES
    return False


class SchemaRight:
    """Decides which axioms one caller may state without the right ``schema``.

    Parameters
    ----------
    access
        The caller, bound to the knowledge base.
    store
        What is stored before the change.
    declared
        Terms that ontologies declare.
    removed
        What the change removes.
    """

    def __init__(
        self,
        access: Access,
        graphs: Graphs,
        store: GraphStore,
        declared: Collection[NamedNode],
        removed: Collection[Quad] = (),
    ) -> None:
        self._removed = removed
        self._of_id: dict[Term, Term] = {}
        self._declared = declared
        self._graphs = graphs
        self._store = store
        self._home = access.home()
        self._namespaces = namespaces(access, graphs) if access.agent else ()
        self._own: dict[NamedNode | BlankNode, bool] = {}
        self._serves: dict[Term, bool] = {}
        self._last: Term | None = None
        self._is_of_schema = False
        self._may_matter: dict[NamedNode, bool] = {}

    def is_foreign(self, quad: Quad) -> bool:
        """Whether a statement needs the right: an axiom, or about a declared term."""
        subject, predicate = quad.subject, quad.predicate
        # Statements about one subject lie together, and most properties come again and again.
        if subject != self._last:
            self._last = subject
            self._is_of_schema = subject in self._declared or _is_vocabulary(subject)
        if self._is_of_schema:
            return True
        may_matter = self._may_matter.get(predicate)
        if may_matter is None:
            name = predicate.value
            may_matter = name in _AXIOMS or name in _LINKS or predicate in (RDF_TYPE, _OBJECT_ID)
            self._may_matter[predicate] = may_matter
        if not may_matter:
            return False
        if predicate == _OBJECT_ID:
            return self._is_id_of_another(quad)
        return is_axiom(quad) and not self._is_harmless(quad)

    def _is_id_of_another(self, quad: Quad) -> bool:
        """Tell whether another object has an id: two with one id would follow to be the same."""
        if self._of_id.setdefault(quad.object, quad.subject) != quad.subject:
            return True
        return any(
            other.subject != quad.subject
            and self._graphs.is_input(other.graph_name)
            and other not in self._removed
            for other in self._store.quads_for_pattern(None, _OBJECT_ID, quad.object, None)
        )

    def _is_harmless(self, quad: Quad) -> bool:
        """Tell whether an axiom says nothing about terms that are not the writer's own."""
        name, subject, value = quad.predicate.value, quad.subject, quad.object
        if name in _LINKS:
            return not self._serves_axiom(subject)
        if name in _ABOUT_ALL or not self._is_own(subject):
            return False
        if name == RDF_TYPE.value:
            return isinstance(value, NamedNode) and value.value in _OF_OWN_PROPERTIES
        if name in _ABOUT_SUBJECT:
            is_meta = _is_vocabulary(value) and str(value)[1:-1] not in _NO_META | _ANNOTATIONS
            return isinstance(subject, NamedNode) and not is_meta
        if name == _OWL + "onProperty":
            return isinstance(value, NamedNode) and self._is_own(value)
        if name in _ABOUT_BOTH:
            both = (subject, value)
            return all(isinstance(term, NamedNode) and self._is_own(term) for term in both)
        return name in _FILLERS

    def _is_own(self, term: Term) -> bool:
        """Tell whether a term is the caller's and used by nobody else.

        An IRI is the caller's if it is minted in its namespace. A blank node needs no such mark:
        those of others can be reached only where the store has them.
        """
        if not isinstance(term, NamedNode | BlankNode):
            return False
        is_own = self._own.get(term)
        if is_own is None:
            named = isinstance(term, BlankNode) or term.value.startswith(self._namespaces)
            is_own = self._own[term] = named and not self.is_used_by_others(term)
        return is_own

    def is_used_by_others(self, term: Term) -> bool:
        """Tell whether a graph that is not the caller's names an individual or a property."""
        if not isinstance(term, NamedNode | BlankNode):
            return False
        find = self._store.quads_for_pattern
        uses = chain(
            find(term, None, None, None),
            find(None, term, None, None) if isinstance(term, NamedNode) else (),
            find(None, None, term, None),
        )
        if any(self._is_of_others(quad.graph_name) for quad in islice(uses, _MAX_USES)):
            return True
        if next(uses, None) is None:
            return False
        # A class of many members: whether another graph has any is cheaper to ask of each graph.
        name = term if isinstance(term, NamedNode) else None
        for graph in filter(self._is_of_others, self._store.named_graphs()):
            here = chain(
                find(term, None, None, graph),
                find(None, name, None, graph) if name else (),
                find(None, None, term, graph),
            )
            if next(here, None) is not None:
                return True
        return False

    def _is_of_others(self, graph: GraphName) -> bool:
        return graph != self._home and self._graphs.is_input(graph)

    def _serves_axiom(self, cell: Term) -> bool:
        """Tell whether a stored axiom has a list to which a cell belongs."""
        path, todo = {cell}, [cell]
        while todo and len(path) <= _MAX_CELLS:
            node = todo.pop()
            if node in self._serves:
                if self._serves[node]:
                    return True
                continue
            for quad in self._store.quads_for_pattern(None, None, node, None):
                if quad.predicate.value in _LISTS and self._graphs.is_input(quad.graph_name):
                    self._serves[cell] = True
                    return True
                if quad.predicate == _REST and quad.subject not in path:
                    path.add(quad.subject)
                    todo.append(quad.subject)
        if not todo:
            self._serves.update(dict.fromkeys(path, False))
        return bool(todo)


def foreign_axioms(
    change: Overlay, access: Access, graphs: Graphs, declared: Collection[NamedNode]
) -> Iterator[Quad]:
    """Yield the added statements for which the caller needs the right ``schema``.

    Parameters
    ----------
    declared
        Terms that ontologies declare.
    """
    right = SchemaRight(access, graphs, change.store, declared, change.removed)
    inputs: dict[GraphName, bool] = {}
    for quad in change.added:
        graph = quad.graph_name
        if graph not in inputs:
            inputs[graph] = graphs.is_input(graph)
        if inputs[graph] and right.is_foreign(quad):
            yield quad


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
    change: Overlay,
    access: Access,
    graphs: Graphs,
    declared: Callable[[], Collection[NamedNode]],
) -> None:
    """Raise unless the caller may state the axioms of a change.

    Parameters
    ----------
    declared
        Returns the terms that ontologies declare.

    Raises
    ------
    ForbiddenError
        Naming the first statement and the right.
    """
    if access.may_state_axioms:
        return
    quad = next(foreign_axioms(change, access, graphs, declared()), None)
    if quad is None:
        return
    raise axiom_refused(quad, access, graphs)


def axiom_refused(quad: Quad, access: Access, graphs: Graphs) -> ForbiddenError:
    """Return the error for an axiom that the caller may not state."""
    statement = f"{quad.subject} {quad.predicate} {quad.object}"
    own = namespaces(access, graphs)[0] if access.agent else ""
    if quad.predicate == _OBJECT_ID:
        kind = "another object has that id, and two with one id would be the same"
    elif is_axiom(quad):
        kind = "it is an axiom"
    else:
        kind = f"{quad.subject} is a term of the schema"
    return ForbiddenError(
        f"{access.role} {access.agent} may not state {statement}: {kind}, which holds for "
        f"everybody; that needs the right schema. About its own terms ({own}...) it may state "
        "axioms that say nothing about others",
        statement=statement,
        right="schema",
    )


def stored_axioms(
    store: GraphStore, graphs: Graphs, declared: Collection[NamedNode], limit: int = 1_000
) -> Iterator[tuple[str, Quad]]:
    """Yield axioms about others' terms in the graphs of agents, with the agent's name.

    Parameters
    ----------
    declared
        Terms that ontologies declare; what is said about them counts as well.
    limit
        Axioms of one graph that are looked at.
    """
    for graph in store.named_graphs():
        name = graphs.owner(graph)
        if not name:
            continue
        access = Access(name, "robot").bind(graphs)
        change = Overlay(store)
        here = store.quads_for_pattern(None, None, None, graph)
        # The engine itself numbers a class in the graph of whoever first meets an object of it.
        held = (q for q in here if is_axiom(q)
                or (q.subject in declared and q.predicate != _SHORT_ID))  # fmt: skip
        for quad, _ in zip(held, range(limit), strict=False):
            change.added[quad] = None
        for quad in foreign_axioms(change, access, graphs, declared):
            yield name, quad
