"""Check of an ontology against the OWL 2 RL profile (OWL 2 Profiles 4.2).

Outside the profile the rules are still sound, but no longer complete.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner.terms.datatypes import BITS
from reasoner.terms.dictionary import Term, Triple
from reasoner.terms.vocabulary import OWL, RDF, RDFS, XSD


def _owl(name: str) -> NamedNode:
    return NamedNode(OWL + name)


_TYPE, _FIRST, _REST, _NIL = (NamedNode(RDF + n) for n in ("type", "first", "rest", "nil"))
_SUB_CLASS, _SUB_PROPERTY, _DOMAIN, _RANGE, _LITERAL = (
    NamedNode(RDFS + n) for n in ("subClassOf", "subPropertyOf", "domain", "range", "Literal")
)
_THING = _owl("Thing")
_CONSTRUCTS = (
    "intersectionOf", "unionOf", "complementOf", "oneOf", "someValuesFrom", "allValuesFrom",
    "hasValue", "hasSelf", "maxCardinality", "maxQualifiedCardinality", "minCardinality",
    "minQualifiedCardinality", "cardinality", "qualifiedCardinality",
)  # fmt: skip
_DEFINING: frozenset[Term] = frozenset(map(_owl, _CONSTRUCTS[:4]))
"""Constructs by which a named class may be defined directly."""
_SIMPLE_ONLY: frozenset[Term] = frozenset(
    _owl(f"{trait}Property")
    for trait in ("Functional", "InverseFunctional", "Irreflexive", "Asymmetric")
)
_KINDS = ("Class", "ObjectProperty", "DatatypeProperty", "AnnotationProperty")


@dataclass(frozen=True)
class ProfileViolation:
    """A construct that OWL 2 RL does not allow.

    Attributes
    ----------
    axiom : str
        The axiom's subject, relation and object, in N-Triples.
    position : str
        "subclass", "superclass", "equivalent class", or "axiom".
    construct : str
        The name of the offending construct, such as `unionOf`.
    why : str
    suggestion : str
    """

    axiom: str
    position: str
    construct: str
    why: str
    suggestion: str


def check_profile(triples: Iterable[Triple]) -> list[ProfileViolation]:
    """Return every place where triples leave the OWL 2 RL profile.

    Examples
    --------
    >>> some = BlankNode()
    >>> vessel = [(NamedNode("urn:Vessel"), _SUB_CLASS, some),
    ...           (some, _owl("onProperty"), NamedNode("urn:has")),
    ...           (some, _owl("someValuesFrom"), NamedNode("urn:Handle"))]
    >>> [(v.position, v.construct) for v in check_profile(vessel)]
    [('superclass', 'someValuesFrom')]
    """
    return list(_Checker(triples).violations())


class _Checker:
    def __init__(self, triples: Iterable[Triple]) -> None:
        self.triples = sorted(set(triples), key=str)
        self.index: dict[tuple[Term, Term], list[Term]] = defaultdict(list)
        for s, p, o in self.triples:
            self.index[s, p].append(o)

    def values(self, s: Term, name: str) -> list[Term]:
        return self.index.get((s, _owl(name)), [])

    def is_a(self, s: Term, name: str) -> bool:
        return _owl(name) in self.index.get((s, _TYPE), [])

    def members(self, head: Term) -> list[Term]:
        out: list[Term] = []
        while head != _NIL and len(out) < len(self.triples):
            out += self.index.get((head, _FIRST), [])
            head = next(iter(self.index.get((head, _REST), [])), _NIL)
        return out

    def violations(self) -> Iterator[ProfileViolation]:
        for s, p, o in self.triples:
            yield from self.axiom(s, p, o)
        yield from self.non_simple()
        yield from self.irregular()
        yield from self.declarations()

    # Axioms and the positions of their class expressions.

    def axiom(self, s: Term, p: Term, o: Term) -> Iterator[ProfileViolation]:
        where = f"{s} {p} {o}"
        if p == _SUB_CLASS:
            yield from self.sub(s, where)
            yield from self.super(o, where)
        elif p == _owl("equivalentClass"):
            if self.is_datatype(s):
                yield self.outright(where, "datatype definition", "use the datatype itself")
            else:
                yield from self.equivalent(s, where)
                yield from self.equivalent(o, where)
        elif p == _owl("disjointWith"):
            yield from self.sub(s, where)
            yield from self.sub(o, where)
        elif p in (_DOMAIN, _RANGE):
            data_range = p == _RANGE and (self.is_a(s, "DatatypeProperty") or self.is_datatype(o))
            yield from (self.data_range if data_range else self.super)(o, where)
        elif p == _owl("hasKey"):
            yield from self.sub(s, where)
        elif p == _owl("disjointUnionOf"):
            hint = "write each part as a subclass and the parts as AllDisjointClasses"
            yield self.outright(where, "disjointUnionOf", hint)
        elif p == _TYPE:
            yield from self.typed(s, o, where)
        elif isinstance(s, NamedNode) and p in _DEFINING:
            yield from self.equivalent(s, where, defines=True)

    def typed(self, s: Term, o: Term, where: str) -> Iterator[ProfileViolation]:
        if o == _owl("ReflexiveProperty"):
            yield self.outright(where, "ReflexiveProperty", "state the loops that are needed")
        elif o == _owl("AllDisjointClasses"):
            for head in self.values(s, "members"):
                for c in self.members(head):
                    yield from self.sub(c, where)
        elif isinstance(o, BlankNode):
            yield from self.super(o, where)

    def outright(self, where: str, construct: str, suggestion: str) -> ProfileViolation:
        why = f"{construct} is not in OWL 2 RL"
        return ProfileViolation(where, "axiom", construct, why, suggestion)

    # Class expressions by position (OWL 2 Profiles 4.2.3).

    def sub(self, c: Term, where: str) -> Iterator[ProfileViolation]:
        yield from self.expression(c, where, "subclass", self.allowed_below)

    def super(self, c: Term, where: str) -> Iterator[ProfileViolation]:
        yield from self.expression(c, where, "superclass", self.allowed_above)

    def equivalent(self, c: Term, where: str, defines: bool = False) -> Iterator[ProfileViolation]:
        yield from self.expression(c, where, "equivalent class", self.allowed_both, defines)

    def expression(
        self,
        c: Term,
        where: str,
        position: str,
        allowed: Callable[[str, Term, str], Iterator[ProfileViolation] | None],
        defines: bool = False,
    ) -> Iterator[ProfileViolation]:
        if isinstance(c, NamedNode) and not defines:
            if c == _THING:
                why = f"owl:Thing cannot be a {position}"
                yield ProfileViolation(where, position, "Thing", why, "leave the axiom out")
            return
        for construct in _CONSTRUCTS:
            for value in self.values(c, construct):
                inner = allowed(construct, value, where)
                if inner is None:
                    why = f"{construct} cannot stand in a {position}"
                    hint = "turn the axiom round or weaken it to a subclass axiom"
                    yield ProfileViolation(where, position, construct, why, hint)
                else:
                    yield from inner

    def allowed_below(
        self, construct: str, value: Term, where: str
    ) -> Iterator[ProfileViolation] | None:
        if construct in ("intersectionOf", "unionOf"):
            return (v for c in self.members(value) for v in self.sub(c, where))
        if construct == "someValuesFrom":
            if value == _THING:
                return iter(())
            return (
                self.data_range(value, where) if self.is_datatype(value) else self.sub(value, where)
            )
        return iter(()) if construct in ("oneOf", "hasValue") else None

    def allowed_above(
        self, construct: str, value: Term, where: str
    ) -> Iterator[ProfileViolation] | None:
        if construct == "intersectionOf":
            return (v for c in self.members(value) for v in self.super(c, where))
        if construct == "complementOf":
            return self.sub(value, where)
        if construct == "allValuesFrom":
            if self.is_datatype(value):
                return self.data_range(value, where)
            return self.super(value, where)
        if construct in ("maxCardinality", "maxQualifiedCardinality"):
            # The filler of a qualified one is checked when its own node is visited.
            small = isinstance(value, Literal) and value.value.strip("+0") in ("", "1")
            return iter(()) if small else None
        return iter(()) if construct == "hasValue" else None

    def allowed_both(
        self, construct: str, value: Term, where: str
    ) -> Iterator[ProfileViolation] | None:
        if construct == "intersectionOf":
            return (v for c in self.members(value) for v in self.equivalent(c, where))
        return iter(()) if construct == "hasValue" else None

    def is_datatype(self, c: Term) -> bool:
        declared = NamedNode(RDFS + "Datatype") in self.index.get((c, _TYPE), [])
        return declared or c == _LITERAL or (isinstance(c, NamedNode) and c.value.startswith(XSD))

    def data_range(self, c: Term, where: str) -> Iterator[ProfileViolation]:
        if self.values(c, "intersectionOf"):
            for head in self.values(c, "intersectionOf"):
                for part in self.members(head):
                    yield from self.data_range(part, where)
            return
        name = c.value if isinstance(c, NamedNode) else ""
        supported = name in BITS or name in (
            RDFS + "Literal",
            RDF + "PlainLiteral",
            RDF + "XMLLiteral",
        )
        if not supported and name != RDF + "langString":
            why = f"{c} is not a datatype of OWL 2 RL"
            hint = "use a plain datatype and check the values with SHACL"
            yield ProfileViolation(where, "data range", "datatype", why, hint)

    # Global restrictions (OWL 2 Syntax 11).

    def non_simple(self) -> Iterator[ProfileViolation]:
        """Characteristics that require simple properties, on composite ones (11.2)."""
        complex_ones = {s for s, p, o in self.triples if o == _owl("TransitiveProperty")}
        complex_ones |= {s for s, p, o in self.triples if p == _owl("propertyChainAxiom")}
        edges = [(s, o) for s, p, o in self.triples if p == _SUB_PROPERTY]
        for s, p, o in self.triples:
            if p in (_owl("inverseOf"), _owl("equivalentProperty")):
                edges += [(s, o), (o, s)]
        grown = True
        while grown:
            fed = {above for below, above in edges if below in complex_ones}
            grown = not fed <= complex_ones
            complex_ones |= fed
        for s, p, o in self.triples:
            restricted = p == _TYPE and o in _SIMPLE_ONLY
            if s in complex_ones and (restricted or p == _owl("propertyDisjointWith")):
                why = "the property is composite: transitive, or fed by a chain"
                hint = "state it of a sub-property that is not"
                yield ProfileViolation(f"{s} {p} {o}", "axiom", "non-simple property", why, hint)

    def irregular(self) -> Iterator[ProfileViolation]:
        """Chains that define properties by each other (11.2, regular hierarchy)."""
        below: dict[Term, set[Term]] = defaultdict(set)
        for s, p, o in self.triples:
            if p == _SUB_PROPERTY and s != o:
                below[o].add(s)
        chains = [
            (s, self.members(o), f"{s} {p} {o}")
            for s, p, o in self.triples
            if p == _owl("propertyChainAxiom")
        ]
        for p, links, _ in chains:
            inner = links[1:] if links[:1] == [p] else links[:-1] if links[-1:] == [p] else links
            below[p].update(q for q in inner if links != [p, p])
        for p, links, where in chains:
            if any(p in _reachable(below, q) for q in links if q != p):
                why = "the property is defined by a chain that depends on the property itself"
                hint = "break the circle of chains"
                yield ProfileViolation(where, "axiom", "irregular chain", why, hint)

    def declarations(self) -> Iterator[ProfileViolation]:
        """One kind per property (5.8.1); a class may also be an individual."""
        properties = sorted({s for s, p, o in self.triples if p == _TYPE}, key=str)
        for s in properties:
            kinds = [kind for kind in _KINDS[1:] if self.is_a(s, kind)]
            if len(kinds) > 1:
                why = f"declared as {' and '.join(kinds)}"
                yield ProfileViolation(str(s), "axiom", "declaration", why, "keep one of them")


def _reachable(below: dict[Term, set[Term]], start: Term) -> set[Term]:
    seen: set[Term] = set()
    queue = [start]
    while queue:
        for q in below.get(queue.pop(), ()):
            if q not in seen:
                seen.add(q)
                queue.append(q)
    return seen
