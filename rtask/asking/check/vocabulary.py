"""What a check needs to know of the classes and properties of a graph, as sets of bits.

A class is a bit. ``below`` of a class has the bits of its subclasses, so that two classes can have
a common member only if these sets meet; where they do not, an individual would need a type that no
class provides for.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations
from typing import TypeAlias

from pyoxigraph import BlankNode, Literal, NamedNode

import ontology
from rtask.asking.check import metamodel
from rtask.kb.core import GraphCore
from rtask.rdf.terms import RDF_TYPE, XSD, Term

__all__ = ["TOP", "Property", "Vocabulary", "local"]

_RDFS, _OWL = ontology.PREFIXES["rdfs"], ontology.PREFIXES["owl"]
_RDF = ontology.PREFIXES["rdf"]
_UPPER = tuple(ontology.PREFIXES[name] for name in ("sumo", "prov", "sosa"))
_SORTS = tuple(ontology.PREFIXES["sumo"] + name for name in ("Object", "Process", "Abstract"))
_Axioms: TypeAlias = tuple[int | None, int | None, bool | None, frozenset[str]]
"""Classes of subjects and of values, whether these are things, and their datatypes."""
TOP = {_OWL + "Thing", _RDFS + "Resource", _RDFS + "Literal"}
_OF_TERMS = ("subClassOf", "subPropertyOf", "domain", "range", "isDefinedBy", "seeAlso")
_CLASSES = tuple(NamedNode(iri) for iri in (_OWL + "Class", _RDFS + "Class"))
_PROPERTIES = tuple(
    NamedNode(iri)
    for iri in (
        _OWL + "ObjectProperty",
        _OWL + "DatatypeProperty",
        _OWL + "AnnotationProperty",
        _RDF + "Property",
    )
)


@lru_cache(maxsize=16_384)
def local(iri: str) -> str:
    """Return the part of an IRI behind the last ``#``, ``/`` or ``:``."""
    return iri[max(iri.rfind(mark) for mark in "#/:") + 1 :]


def _meet(axioms: list[int]) -> int | None:
    bits: int | None = None
    for axiom in axioms:
        # Several domains of one property hold together (RDF Schema 1.1, 3.2): their intersection,
        # not their union.
        bits = axiom if bits is None else bits & axiom
    return bits or None


@dataclass
class Property:
    """A property as a check sees it.

    Attributes
    ----------
    domains, ranges
        For each axiom the bits of the classes whose members it allows.
    datatypes
        IRIs of the datatypes that its values may have; empty for an object property.
    relates_things
        True for an object property, False for one with literals, None where that is not known.
    classes
        Most specific classes of subject and object, for words.
    """

    iri: str
    domains: list[int] = field(default_factory=list)
    ranges: list[int] = field(default_factory=list)
    datatypes: set[str] = field(default_factory=set)
    relates_things: bool | None = None
    classes: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))

    @cached_property
    def types(self) -> frozenset[str]:
        """Datatypes of its values."""
        return frozenset(self.datatypes)

    @cached_property
    def domain(self) -> int | None:
        """Classes that meet all axioms about its subjects; None where nothing is known."""
        return _meet(self.domains)

    @cached_property
    def range(self) -> int | None:
        """Classes that meet all axioms about its values; None where nothing is known."""
        return _meet(self.ranges)


class Vocabulary:
    """Classes and properties of one state of a graph.

    Attributes
    ----------
    bit
        Number of each class.
    below
        Bits of the subclasses of a class, with itself.
    above
        Superclasses of a class, with itself.
    properties
        By IRI.
    labels
        Words of each class and property, in lower case.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self.bit: dict[str, int] = {}
        self.below: dict[str, int] = {}
        self.above: dict[str, set[str]] = defaultdict(set)
        self.properties: dict[str, Property] = {}
        self.labels: dict[str, set[str]] = defaultdict(set)
        self._disjoint: set[frozenset[str]] = set()
        self._unions: dict[Term, list[str]] = {}
        self._general: dict[int, list[str]] = {}
        self._named: dict[int, list[str]] = {}
        self._specific: dict[frozenset[str], list[str]] = {}
        self._read()

    def _quads(self, predicate: str) -> Iterator[tuple[Term, Term]]:
        for quad in self._kb.match(None, NamedNode(predicate)):
            yield quad.subject, quad.object

    def _read(self) -> None:
        self._read_classes()
        # What follows reads ranges as sets of all subclasses, so the hierarchy has to be whole by
        # then.
        self._close()
        self._read_disjoint()
        for node, head in self._quads(_OWL + "unionOf"):
            self._unions[node] = self._list(head)
        self._read_properties()
        self._add_standards()
        self._read_labels()

    def _read_classes(self) -> None:
        for kind in _CLASSES:
            for quad in self._kb.match(None, RDF_TYPE, kind):
                self._class(quad.subject)
        for part, whole in self._quads(_RDFS + "subClassOf"):
            if isinstance(part, NamedNode) and isinstance(whole, NamedNode):
                self._class(part)
                self._class(whole)
                self.above[part.value].add(whole.value)
        for iri, root in metamodel.KINDS.items():
            self._class(NamedNode(iri))
            self.above[iri].update({root} - {""})

    def _read_disjoint(self) -> None:
        for a, b in self._quads(_OWL + "disjointWith"):
            if isinstance(a, NamedNode) and isinstance(b, NamedNode):
                self._disjoint.add(frozenset((a.value, b.value)))
        for _, head in self._quads(_OWL + "members"):
            named = [iri for iri in self._list(head) if iri in self.bit]
            self._disjoint.update(map(frozenset, combinations(named, 2)))

    def _add_standards(self) -> None:
        """Add what RDF, OWL and the rules say of their own properties, and no graph states."""
        for name in _OF_TERMS:
            self._property(_RDFS + name).relates_things = True
        for name in ("label", "comment"):
            self._property(_RDFS + name).relates_things = False
        for iri, ends in metamodel.PROPERTIES.items():
            self._property(iri).relates_things = True
            self._complete(iri, ends)
        for iri, ends in (*metamodel.OF_STANDARDS.items(), *metamodel.OF_RULES.items()):
            if iri in self.properties:
                self._complete(iri, ends)

    def _read_labels(self) -> None:
        for label in (_RDFS + "label", "http://www.w3.org/2004/02/skos/core#altLabel"):
            for term, text in self._quads(label):
                if not isinstance(term, NamedNode) or not isinstance(text, Literal):
                    continue
                if term.value in self.bit or term.value in self.properties:
                    self.labels[term.value].add(text.value.lower())

    def _class(self, term: Term) -> None:
        if isinstance(term, NamedNode) and term.value not in self.bit:
            # One bit a class: sets of some hundred classes are integers, quick to intersect and to
            # use as keys.
            self.bit[term.value] = 1 << len(self.bit)
            self.above[term.value].add(term.value)

    def _close(self) -> None:
        """Add what is above the classes above, for graphs opened without reasoning too."""
        for start in self.bit:
            todo, seen = list(self.above[start]), {start}
            while todo:
                name = todo.pop()
                if name not in seen:
                    seen.add(name)
                    todo += self.above.get(name, ())
            # Everything is a Thing: kept, it would be a superclass in common of any two classes.
            self.above[start] = seen - (TOP - {start})
        self.below = dict.fromkeys(self.bit, 0)
        for part, wholes in self.above.items():
            for whole in wholes:
                self.below[whole] |= self.bit[part]
        for iri, root in metamodel.KINDS.items():  # a property may be of several kinds
            self.below[iri] = self.below[root or iri]

    def _list(self, head: Term) -> list[str]:
        values: list[str] = []
        seen: set[Term] = set()
        # A robot can state a list that contains itself.
        while isinstance(head, BlankNode | NamedNode) and head not in seen:
            seen.add(head)
            rows = self._kb.match(head, NamedNode(_RDF + "first"))
            values += [q.object.value for q in rows if isinstance(q.object, NamedNode)]
            rest = self._kb.match(head, NamedNode(_RDF + "rest"))
            if not rest:
                break
            head = rest[0].object
        return values

    def _read_properties(self) -> None:
        for kind in _PROPERTIES:
            for quad in self._kb.match(None, RDF_TYPE, kind):
                if isinstance(quad.subject, NamedNode):
                    made = self._property(quad.subject.value)
                    if kind == _PROPERTIES[0]:
                        made.relates_things = True
                    elif kind == _PROPERTIES[1]:
                        made.relates_things = False
        for name, at in (("domain", 0), ("range", 1)):
            axioms: dict[str, list[Term]] = defaultdict(list)
            for term, value in self._quads(_RDFS + name):
                if isinstance(term, NamedNode):
                    axioms[term.value].append(value)
            for iri, given in axioms.items():
                self._constrain(self._property(iri), at, given)

    def _complete(self, iri: str, ends: Iterable[str]) -> None:
        """Add what is demanded of the ends of a property, where the graph says nothing of it."""
        made = self._property(iri)
        for at, end in enumerate(ends):
            # What the graph states wins: these are what the standards say of their own terms.
            if end in self.below and not (made.ranges if at else made.domains):
                self._constrain(made, at, [NamedNode(end)])

    def _property(self, iri: str) -> Property:
        return self.properties.setdefault(iri, Property(iri))

    def _constrain(self, made: Property, at: int, given: Iterable[Term]) -> None:
        """Add what domain or range axioms demand; the most specific of nested classes suffices."""
        for value in given:
            names = self._unions.get(value) or (
                [value.value] if isinstance(value, NamedNode) else []
            )
            if at == 1 and names and all(_is_datatype(name) for name in names):
                made.datatypes.update(names)
                # What the graph declares of a property goes before what its range suggests.
                if made.relates_things is None:
                    made.relates_things = False
                continue
            listed = [name for name in names if name in self.below and name not in TOP]
            # A union with a part that is not a class here demands nothing that could be checked.
            if listed and len(listed) == len(names):
                bits = 0
                for name in listed:
                    bits |= self.below[name]
                (made.ranges if at else made.domains).append(bits)
                made.classes[at].extend(listed)
        made.classes[at][:] = self.most_specific(made.classes[at])

    def most_specific(self, names: Iterable[str]) -> list[str]:
        """Return the classes that have none of the others below them."""
        classes = frozenset(names)
        listed = self._specific.get(classes)
        if listed is None:
            listed = self._specific[classes] = [
                iri
                for iri in sorted(classes)
                if not any(iri in self.above[other] for other in classes if other != iri)
            ]
        return listed

    def are_disjoint(self, name: str, other: str) -> bool:
        """Return whether the ontology says that two classes have no common member."""
        if not self._disjoint:
            return False
        return any(
            frozenset((a, b)) in self._disjoint for a in self.above[name] for b in self.above[other]
        )

    def are_foreign(self, mine: int, other: int) -> bool:
        """Return whether the classes of two sets have no superclass in common."""
        return not self._shared(mine, other)

    def are_unlike(self, mine: int, other: int) -> bool:
        """Return whether the superclasses that two sets have in common are of upper ontologies.

        A box and a robot are both physical, which does not make them alike.
        """
        return all(kind.startswith(_UPPER) for kind in self._shared(mine, other))

    def sorts(self, bits: int) -> set[str]:
        """Return which of objects, processes and information some classes are."""
        tops = self.most_general(bits)
        return {local(sort) for sort in _SORTS for top in tops if sort in self.above[top]}

    def sorts_of_any(self, bits: int) -> set[str]:
        """Return the same for what is seen of members: the classes below count, not those above."""
        return {local(sort) for sort in _SORTS for name in self.names(bits)
                if sort in self.above[name]}  # fmt: skip

    def below_all(self, names: Iterable[str]) -> int | None:
        """Return the bits of the subclasses of what is above all of some classes.

        None if that is a class of an upper ontology only.
        """
        common = set.intersection(*(self.above[name] for name in names))
        named = [kind for kind in common if not kind.startswith(_UPPER) and kind in self.below]
        bits = -1
        for kind in named:
            bits &= self.below[kind]
        return bits if named else None

    def _shared(self, mine: int, other: int) -> set[str]:
        above = [
            {kind for top in self.most_general(bits) for kind in self.above[top]}
            for bits in (mine, other)
        ]
        return above[0] & above[1]

    def most_general(self, bits: int) -> list[str]:
        """Return the classes of bits that have none of the others above them."""
        listed = self._general.get(bits)
        if listed is None:
            names = set(self.names(bits))
            listed = [name for name in sorted(names) if not (self.above[name] - {name}) & names]
            self._general[bits] = listed
        return listed

    def names(self, bits: int) -> list[str]:
        """Return the classes of bits."""
        listed = self._named.get(bits)
        if listed is None:
            listed = self._named[bits] = [name for name, bit in self.bit.items() if bit & bits]
        return listed

    @cached_property
    def alike(self) -> dict[_Axioms, list[str]]:
        """The properties that have the same axioms, by these."""
        groups: dict[_Axioms, list[str]] = defaultdict(list)
        for iri, made in self.properties.items():
            axioms = made.domain, made.range, made.relates_things, made.types
            groups[axioms].append(iri)
        return groups

    @cached_property
    def lowered(self) -> dict[str, str]:
        """The local name of each term, in lower case."""
        return {iri: local(iri).lower() for iri in (*self.bit, *self.properties)}

    @cached_property
    def namespaces(self) -> frozenset[str]:
        """Namespaces in which terms are defined."""
        return frozenset(iri[: len(iri) - len(local(iri))] for iri in (*self.bit, *self.properties))


def _is_datatype(iri: str) -> bool:
    return iri.startswith(XSD) or iri in (
        _RDFS + "Literal",
        _RDF + "langString",
        _RDF + "PlainLiteral",
    )
