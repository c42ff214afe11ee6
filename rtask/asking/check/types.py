"""What the patterns of a query demand of the classes of its variables, and where that conflicts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import ontology
from rtask.asking.check.evidence import Evidence
from rtask.asking.check.metamodel import CLASS, PROPERTIES
from rtask.asking.check.syntax.outline import Edge, Group, Node, Step
from rtask.asking.check.vocabulary import Property, Vocabulary
from rtask.rdf.terms import RDF_TYPE, XSD

__all__ = ["Conflict", "Context", "Demand", "contexts", "read_demands"]

TYPE = RDF_TYPE.value
_SUB_CLASS = ontology.PREFIXES["rdfs"] + "subClassOf"
_Ends: TypeAlias = tuple[int | None, bool | None, frozenset[str]]
"""Classes, whether things, and datatypes of one end."""


@dataclass(slots=True)
class Demand:
    """What one end of an edge must be.

    Attributes
    ----------
    bits
        Classes, one of which it has; None where nothing is known.
    is_thing
        True for a resource, False for a literal, None for either.
    datatypes
        That a literal may have.
    is_observed
        Whether the classes are those that the graph shows, not those that axioms allow.
    is_seen
        Whether that it is a thing, or a literal, is what the graph shows.
    node
        The term or variable.
    """

    edge: Edge
    at: int
    bits: int | None
    is_thing: bool | None
    datatypes: frozenset[str] = frozenset()
    is_observed: bool = False
    is_seen: bool = False
    node: Node = field(init=False)

    def __post_init__(self) -> None:
        self.node = self.edge.object if self.at else self.edge.subject

    @property
    def is_of_terms(self) -> bool:
        """Whether the end is a class or property, which people call ``?kind`` or as they like."""
        return any(
            step.node.value in PROPERTIES
            or (step.node.value == TYPE and self.at == 1 - step.is_inverse)
            for step in self.edge.steps
        )


@dataclass(slots=True)
class Conflict:
    """Two demands on one variable that nothing meets."""

    first: Demand
    other: Demand
    is_certain: bool


@dataclass(slots=True)
class Context:
    """Patterns that must match together: those of a group and of the groups around it.

    Attributes
    ----------
    own
        Those of the group.
    around
        Those of the groups around it.
    columns
        Terms that VALUES, FILTER or BIND gives to variables.
    compared
        Variables that expressions read as values, and what they are read as.
    is_tested
        Whether only its matching or failing counts: EXISTS, NOT EXISTS and MINUS.
    """

    own: list[Edge]
    around: list[Edge]
    columns: dict[str, list[Node]] = field(default_factory=dict)
    compared: list[tuple[Node, str]] = field(default_factory=list)
    is_tested: bool = False
    _edges: list[Edge] = field(default_factory=list, init=False, repr=False)
    _at: dict[str, list[Edge]] = field(default_factory=dict, init=False, repr=False)
    _touching: dict[tuple[str, str], list[Edge]] = field(
        default_factory=dict, init=False, repr=False
    )

    @property
    def edges(self) -> list[Edge]:
        """All of them."""
        if not self._edges:
            self._edges = [*self.around, *self.own]
        return self._edges

    @property
    def key(self) -> str:
        """What its faults depend on beside the graph, wherever in a text it stands."""
        columns = (
            f"{name} {[term.value for term in terms]}" for name, terms in self.columns.items()
        )
        compared = (f"{node.value} {kind}" for node, kind in self.compared)
        edges = (edge.pattern for edge in self.edges)
        return "\f".join((f"{len(self.around)} {self.is_tested:d}", *edges, *columns, *compared))

    def having(self, variable: str) -> list[Edge]:
        """Return the patterns that have a variable at an end."""
        if not self._at:
            for edge in self.edges:
                first, other = edge.ends
                if first.kind == "variable":
                    self._at.setdefault(first.value, []).append(edge)
                if other.kind == "variable" and other.value != first.value:
                    self._at.setdefault(other.value, []).append(edge)
        return self._at.get(variable, [])

    def touching(self, edge: Edge) -> list[Edge]:
        """Return the patterns that have a variable in common with one, itself among them."""
        names = (edge.subject.value, edge.object.value)
        listed = self._touching.get(names)
        if listed is None:
            first, other = (
                self.having(end.value) if end.kind == "variable" else [] for end in edge.ends
            )
            if names[0] == names[1]:
                other = []
            listed = first + [beside for beside in other if not beside.mentions(names[0])]
            self._touching[names] = listed
        return listed


_READ_AS = {
    "number": ("double",), "text": ("string",), "moment": ("dateTime", "dateTimeStamp", "date"),
    "quantity": ("double", "dateTime", "dateTimeStamp", "date"), "literal": (),
    "ordered": (),
}  # fmt: skip


def read_demands(context: Context, names: Collection[str]) -> Iterator[Demand]:
    """Yield what expressions, and literals that VALUES gives, demand of some variables."""
    for node, kind in context.compared:
        if node.value in names:
            datatypes = frozenset(XSD + name for name in _READ_AS[kind])
            yield Demand(Edge(node, [], node, -1, -1), 0, None, False, datatypes)
    for name in names:
        given = context.columns.get(name)
        if given and all(term.kind == "literal" for term in given):
            node = Node("variable", name, -1, -1)
            datatypes = frozenset(term.datatype for term in given)
            yield Demand(Edge(node, [], node, -1, -1), 0, None, False, datatypes)


def contexts(group: Group, around: Context | None = None) -> Iterator[Context]:
    """Yield the context of a group, and those of the groups in it that need not match."""
    own = Context([], around.edges if around else [], dict(around.columns) if around else {})
    own.is_tested = group.role in ("minus", "exists")
    if around is not None and group.role != "minus":
        own.compared += around.compared
    apart: list[Group] = []
    _collect(group, own, apart)
    yield own
    for child in apart:
        yield from contexts(child, own)


def _collect(group: Group, own: Context, apart: list[Group]) -> None:
    """Add what must match in a group to a context, and the groups that stand apart to a list."""
    own.own += group.edges
    own.compared += group.compared
    own.columns.update((node.value, terms) for node, terms in group.values)
    for node, terms in group.equal:
        own.columns.setdefault(node.value, terms)
    for child in group.children:
        if child.role == "plain":
            _collect(child, own, apart)
        elif child.role != "service":
            apart.append(child)


class Demands:
    """Demands of edges, with a vocabulary and with what a graph shows where axioms are silent."""

    def __init__(self, vocabulary: Vocabulary, evidence: Evidence | None = None) -> None:
        self._vocabulary = vocabulary
        self._evidence = evidence
        self._read: dict[int, tuple[Edge, tuple[Demand, Demand] | None]] = {}

    def of(self, edge: Edge, context: Context) -> tuple[Demand, Demand] | None:
        """Return what an edge demands of its ends; None where nothing is known."""
        read = self._read.get(id(edge))
        if read is None:  # the edge is held, so that no other gets its number
            read = self._read[id(edge)] = (edge, self._of(edge, context))
        return read[1]

    def _of(self, edge: Edge, context: Context) -> tuple[Demand, Demand] | None:
        if not edge.steps:
            return None
        ends = [self._of_step(step, edge, context) for step in edge.steps]
        subject = Demand(edge, 0, *_either([first[0] for first in ends]))
        value = Demand(edge, 1, *_either([first[1] for first in ends]))
        if edge.is_loose:  # it may be of length zero; one that can never begin is of no use
            value.bits = self._reached(value, edge, context)
            value.is_thing, value.datatypes = None, frozenset()
        elif self._evidence is not None and len(edge.steps) == 1:
            for demand in (subject, value):
                self._observe(demand, self._evidence)
        return subject, value

    def _reached(self, value: Demand, edge: Edge, context: Context) -> int | None:
        """Return the classes of what a path may reach: those of its values, or of where it begins.

        None where others say nothing of where it begins.
        """
        if value.bits is None or edge.subject.kind != "variable":
            return None
        start: int | None = None
        for other in context.having(edge.subject.value):
            if other is edge or other.is_loose:
                continue
            for demand in self.of(other, context) or ():
                if demand.node.value == edge.subject.value and demand.bits is not None:
                    if demand.is_observed:
                        return None
                    start = demand.bits if start is None else start & demand.bits
        return value.bits | start if start is not None else None

    def _observe(self, demand: Demand, evidence: Evidence) -> None:
        """Fill in the classes of an end about which the ontology says nothing."""
        (step,) = demand.edge.steps
        at = 1 - demand.at if step.is_inverse else demand.at
        if demand.is_thing is None and at == 1:
            demand.is_thing = evidence.has_things(step.node.value)
            demand.is_seen = demand.is_thing is not None
        if demand.bits is None and demand.is_thing and step.node.value != TYPE:
            demand.bits = evidence.ends_of(step.node.value, at, self._vocabulary)
            demand.is_observed = demand.bits is not None

    def _of_step(self, step: Step, edge: Edge, context: Context) -> tuple[_Ends, ...]:
        nothing: _Ends = (None, None, frozenset())
        ends: tuple[_Ends, _Ends]
        if step.node.value == TYPE:
            value = edge.ends[0 if step.is_inverse else 1]
            bits = self._members(value, context)
            classes = self._vocabulary.below[CLASS]
            ends = ((bits, True, frozenset[str]()), (classes, True, frozenset[str]()))
        else:
            axioms = self._vocabulary.properties.get(step.node.value)
            if axioms is None:  # nothing is ever said of a literal
                ends = ((None, True, frozenset()), nothing)
                return ends[::-1] if step.is_inverse else ends
            datatypes = frozenset(axioms.datatypes)
            ends = (
                (axioms.domain, True, frozenset()),
                (axioms.range, axioms.relates_things, datatypes),
            )
        return ends[::-1] if step.is_inverse else ends

    def _members(self, node: Node, context: Context) -> int | None:
        """Return the bits of the classes that a pattern with rdf:type names."""
        nodes = [node] if node.kind == "iri" else context.columns.get(node.value, [])
        if not nodes and node.kind == "variable":  # ?thing a/rdfs:subClassOf* rt:Container
            nodes = [
                edge.object for edge in context.having(node.value)
                if [step.node.value for step in edge.steps] == [_SUB_CLASS]
                and not edge.steps[0].is_inverse
                and edge.subject.value == node.value and edge.object.kind == "iri"
            ][:1]  # fmt: skip
        bits = 0
        for first in nodes:
            below = self._vocabulary.below.get(first.value)
            if below is None:
                return None
            bits |= below
        return bits or None

    def conflicts(self, context: Context) -> list[Conflict]:
        """Return the pairs of demands in a context that nothing meets, its own in one of them."""
        own = {id(edge) for edge in context.own}
        names = dict.fromkeys(
            end.value for edge in context.own for end in edge.ends if end.kind == "variable"
        )
        found: list[Conflict] = []
        for name in names:
            given = [
                demand
                for edge in context.having(name)
                for demand in self.of(edge, context) or ()
                if demand.node.kind == "variable" and demand.node.value == name
            ]
            if len(given) < 2 or _is_met(given):
                continue
            for at, first in enumerate(given):
                for other in given[at + 1 :]:
                    if id(first.edge) not in own and id(other.edge) not in own:
                        continue
                    made = self.between(first, other)
                    if made is not None:
                        found.append(made)
        return found

    def between(self, first: Demand, other: Demand) -> Conflict | None:
        """Return the conflict of two demands, if there is one."""
        if first.edge is other.edge and first.at == other.at:
            return None
        if None not in (first.is_thing, other.is_thing) and first.is_thing != other.is_thing:
            return Conflict(first, other, not (first.is_seen or other.is_seen))
        if first.datatypes and other.datatypes and not overlap(first.datatypes, other.datatypes):
            return Conflict(first, other, False)
        if first.bits is None or other.bits is None or first.bits & other.bits:
            return None
        if first.is_observed or other.is_observed:
            return Conflict(first, other, False) if self._is_foreign(first, other) else None
        return Conflict(first, other, self._is_impossible(first.bits, other.bits))

    def _is_foreign(self, first: Demand, other: Demand) -> bool:
        """Return whether the classes that one end demands share no superclass with what is seen.

        Those of the upper ontologies do not count for our own properties, which say one thing.
        """
        seen, given = (first, other) if first.is_observed else (other, first)
        if given.is_observed or seen.bits is None or given.bits is None:
            return False
        if seen.edge.steps[0].node.value.startswith(ontology.NS):
            if self._vocabulary.sorts_of_any(seen.bits) & self._vocabulary.sorts(given.bits):
                return False  # what carries things here may itself be grasped elsewhere
            return self._vocabulary.are_unlike(seen.bits, given.bits)
        return self._vocabulary.are_foreign(seen.bits, given.bits)

    def _is_impossible(self, first: int, other: int) -> bool:
        """Return whether axioms of disjointness, not only the lack of a class, part two sets."""
        vocabulary = self._vocabulary
        tops = [vocabulary.most_general(bits) for bits in (first, other)]
        return all(vocabulary.are_disjoint(a, b) for a in tops[0] for b in tops[1])


def _is_met(demands: list[Demand]) -> bool:
    """Return whether some class has all that is demanded of a variable, so that nothing parts it.

    A quick look, after which most variables need no other.
    """
    bits, natures = -1, set()
    for demand in demands:
        if demand.datatypes:
            return False
        if demand.bits is not None:
            bits &= demand.bits
        if demand.is_thing is not None:
            natures.add(demand.is_thing)
    return bits != 0 and len(natures) < 2


def _either(
    alternatives: Iterable[tuple[int | None, bool | None, frozenset[str]]],
) -> tuple[int | None, bool | None, frozenset[str]]:
    """Return what an end must be if one of several demands is met."""
    rows = list(alternatives)
    if len(rows) == 1:
        return rows[0]
    bits = 0
    for first, _, _ in rows:
        if first is None:
            bits = 0
            break
        bits |= first
    kinds = {kind for _, kind, _ in rows}
    datatypes = frozenset().union(*(types for _, _, types in rows))
    if not all(types for _, _, types in rows):
        datatypes = frozenset()
    return bits or None, kinds.pop() if len(kinds) == 1 else None, datatypes


_TEXTS = {"string", "langString", "PlainLiteral", "Literal", "normalizedString", "token", "anyURI"}
_NUMBERS = {"double", "float", "decimal", "integer", "int", "long", "short", "nonNegativeInteger",
            "positiveInteger", "unsignedInt", "unsignedLong", "byte"}  # fmt: skip


def family(datatype: str) -> str:
    """Return the kind of a datatype whose values can be compared with each other.

    >>> family("http://www.w3.org/2001/XMLSchema#int")
    'number'
    """
    name = datatype.rpartition("#")[2]
    if name == "Literal":
        return ""
    return "number" if name in _NUMBERS else "text" if name in _TEXTS else name


def overlap(first: frozenset[str], other: frozenset[str]) -> bool:
    """Return whether values of two sets of datatypes can be compared."""
    families = [{family(kind) for kind in kinds} for kinds in (first, other)]
    return "" in families[0] | families[1] or bool(families[0] & families[1])


def range_of(axioms: Property) -> str:
    """Return the single datatype of a property's values; empty if it has none or several."""
    return next(iter(axioms.datatypes)) if len(axioms.datatypes) == 1 else ""
