"""A naive OWL 2 RL engine: the rules of OWL 2 Profiles 4.3 as printed, over plain triples.

Slow and obvious on purpose; the tests hold the real engine against it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import combinations, permutations, product

from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner.terms.datatypes import value_of
from reasoner.terms.vocabulary import OWL, RDF, RDFS, XSD

Term = NamedNode | BlankNode | Literal
Triple = tuple[Term, Term, Term]


def owl(name: str) -> NamedNode:
    return NamedNode(OWL + name)


def rdfs(name: str) -> NamedNode:
    return NamedNode(RDFS + name)


TYPE, FIRST, REST, NIL = (NamedNode(RDF + n) for n in ("type", "first", "rest", "nil"))
SUB, SPO = rdfs("subClassOf"), rdfs("subPropertyOf")
DOM, RNG = rdfs("domain"), rdfs("range")
SAME, DIFF = owl("sameAs"), owl("differentFrom")
THING, NOTHING, CLASS = owl("Thing"), owl("Nothing"), owl("Class")
EQC, EQP = owl("equivalentClass"), owl("equivalentProperty")
SCHEMA = {SUB, SPO, DOM, RNG, EQC, EQP}
REFLEXIVE = {SUB, SPO, EQC, EQP, SAME}


class Graph:
    def __init__(self, triples: Iterable[Triple]) -> None:
        self.triples: set[Triple] = set()
        self.by_p: dict[Term, set[tuple[Term, Term]]] = defaultdict(set)
        for t in triples:
            self.add(t)
        # Lists are read as they are asserted: equal members do not make a list branch.
        self.lists = {(s, p): o for s, p, o in self.triples if p in (FIRST, REST)}

    def add(self, t: Triple) -> bool:
        if t in self.triples or isinstance(t[0], Literal):
            return False
        self.triples.add(t)
        self.by_p[t[1]].add((t[0], t[2]))
        return True

    def pairs(self, p: Term) -> list[tuple[Term, Term]]:
        return list(self.by_p.get(p, ()))

    def o(self, s: Term, p: Term) -> list[Term]:
        return [o for x, o in self.pairs(p) if x == s]

    def members(self, c: Term) -> set[Term]:
        return {x for x, o in self.pairs(TYPE) if o == c}

    def list(self, head: Term) -> list[Term]:
        out = []
        while head != NIL:
            out.append(self.lists[head, FIRST])
            head = self.lists[head, REST]
        return out


def clash(a: Term, b: Term) -> bool:
    """Whether two things cannot be the same."""
    literals = [x for x in (a, b) if isinstance(x, Literal)]
    if key(a) == key(b) or not literals:
        return False
    return len(literals) == 1 or all(map(is_recognized, literals))


def is_recognized(x: Literal) -> bool:
    return x.datatype.value.startswith((XSD, str(TYPE.value).rpartition("#")[0]))


def key(x: Term) -> object:
    if isinstance(x, Literal):
        return value_of(x.value, x.datatype.value, x.language).key
    return x


def in_datatype(x: Term, datatype: Term) -> bool | None:
    from reasoner.terms.datatypes import BITS

    assert isinstance(x, Literal)
    value = value_of(x.value, x.datatype.value, x.language)
    return bool(value.mask & BITS[datatype.value]) if is_recognized(x) else None


def is_datatype(c: Term) -> bool:
    return isinstance(c, NamedNode) and c.value.startswith(XSD)


Finding = tuple[str, object]


def rules(g: Graph, bad: set[Finding]) -> Iterator[Triple]:
    """Yield what follows in one step; collect the names of violated checks."""
    yield from equality(g, bad)
    yield from properties(g, bad)
    yield from classes(g, bad)
    yield from schema(g)


def equality(g: Graph, bad: set[Finding]) -> Iterator[Triple]:
    for a, b in g.pairs(SAME):
        yield b, SAME, a
        for c in g.o(b, SAME):
            yield a, SAME, c
        if (a, b) in g.by_p[DIFF]:
            bad.add(("eq-diff1", frozenset((a, b))))
        for s, p, o in list(g.triples):
            if a in (s, p, o):
                yield from product(*({x, b} if x == a else {x} for x in (s, p, o)))
    for a, b in g.pairs(DIFF):
        if a == b:
            bad.add(("eq-diff1", frozenset((a,))))
    for axiom in g.members(owl("AllDifferent")):
        for name, p in (("eq-diff2", "members"), ("eq-diff3", "distinctMembers")):
            for head in g.o(axiom, owl(p)):
                for a, b in combinations(g.list(head), 2):
                    if a == b or (a, b) in g.by_p[SAME]:
                        bad.add((name, frozenset((a, b))))


def properties(g: Graph, bad: set[Finding]) -> Iterator[Triple]:
    for p, c in g.pairs(DOM):
        for x, _ in g.pairs(p):
            yield x, TYPE, c
    for p, c in g.pairs(RNG):
        for _, y in g.pairs(p):
            if not is_datatype(c):
                yield y, TYPE, c
            elif not isinstance(y, Literal) or in_datatype(y, c) is False:
                bad.add(("dt-not-type", y))
    for p in g.members(owl("FunctionalProperty")):
        for (x, y), (z, w) in product(g.pairs(p), repeat=2):
            if x == z and clash(y, w):
                bad.add(("prp-fp", frozenset((y, w))))
            elif x == z and y != w and not isinstance(y, Literal):
                yield y, SAME, w
    for p in g.members(owl("InverseFunctionalProperty")):
        for (x, y), (z, w) in product(g.pairs(p), repeat=2):
            if key(y) == key(w) and x != z:
                yield x, SAME, z
    for p in g.members(owl("IrreflexiveProperty")):
        bad.update(("prp-irp", x) for x, y in g.pairs(p) if x == y)
    for p in g.members(owl("SymmetricProperty")):
        yield from ((y, p, x) for x, y in g.pairs(p))
    for p in g.members(owl("AsymmetricProperty")):
        bad.update(("prp-asyp", frozenset((x, y))) for x, y in g.pairs(p) if (y, x) in g.by_p[p])
    for p in g.members(owl("TransitiveProperty")):
        for x, y in g.pairs(p):
            yield from ((x, p, z) for z in g.o(y, p))
    for p, q in g.pairs(SPO):
        yield from ((x, q, y) for x, y in g.pairs(p))
    for p, q in g.pairs(EQP):
        yield from ((x, q, y) for x, y in g.pairs(p))
        yield from ((x, p, y) for x, y in g.pairs(q))
    for p, q in g.pairs(owl("inverseOf")):
        yield from ((y, q, x) for x, y in g.pairs(p))
        yield from ((y, p, x) for x, y in g.pairs(q))
    for p, head in g.pairs(owl("propertyChainAxiom")):
        ends = None
        for q in g.list(head):
            step = g.pairs(q)
            ends = (
                set(step) if ends is None else {(x, z) for x, y in ends for w, z in step if y == w}
            )
        yield from ((x, p, y) for x, y in ends or ())
    yield from disjoint_properties(g, bad)
    for c, head in g.pairs(owl("hasKey")):
        keys = g.list(head)
        for x, y in permutations(g.members(c), 2):
            if keys and all(
                {key(v) for v in g.o(x, k)} & {key(v) for v in g.o(y, k)} for k in keys
            ):
                yield x, SAME, y


def disjoint_properties(g: Graph, bad: set[Finding]) -> Iterator[Triple]:
    for p, q in g.pairs(owl("propertyDisjointWith")):
        bad.update(("prp-pdw", pair) for pair in g.by_p[p] & g.by_p[q])
    for axiom in g.members(owl("AllDisjointProperties")):
        for head in g.o(axiom, owl("members")):
            for p, q in combinations(g.list(head), 2):
                bad.update(("prp-adp", pair) for pair in g.by_p[p] & g.by_p[q])
    for name, target in (("prp-npa1", "targetIndividual"), ("prp-npa2", "targetValue")):
        for axiom, value in g.pairs(owl(target)):
            for s in g.o(axiom, owl("sourceIndividual")):
                for p in g.o(axiom, owl("assertionProperty")):
                    if any(x == s and key(y) == key(value) for x, y in g.pairs(p)):
                        bad.add((name, axiom))
    return iter(())


def classes(g: Graph, bad: set[Finding]) -> Iterator[Triple]:
    bad.update(("cls-nothing2", x) for x in g.members(NOTHING))
    for c, head in g.pairs(owl("intersectionOf")):
        parts = [x for x in g.list(head) if x != THING]
        if parts:
            for x in set.intersection(*(g.members(d) for d in parts)):
                yield x, TYPE, c
        yield from ((x, TYPE, d) for x in g.members(c) for d in parts)
    for c, head in g.pairs(owl("unionOf")):
        yield from ((x, TYPE, c) for d in g.list(head) for x in g.members(d))
    for c, d in g.pairs(owl("complementOf")):
        bad.update(("cls-com", x) for x in g.members(c) & g.members(d))
    for c, head in g.pairs(owl("oneOf")):
        yield from ((x, TYPE, c) for x in g.list(head))
    for r, p in g.pairs(owl("onProperty")):
        yield from restriction(g, r, p, bad)
    for c, d in g.pairs(SUB):
        yield from ((x, TYPE, d) for x in g.members(c))
    for c, d in g.pairs(EQC):
        yield from ((x, TYPE, d) for x in g.members(c))
        yield from ((x, TYPE, c) for x in g.members(d))
    for c, d in g.pairs(owl("disjointWith")):
        bad.update(("cax-dw", x) for x in g.members(c) & g.members(d))
    for axiom in g.members(owl("AllDisjointClasses")):
        for head in g.o(axiom, owl("members")):
            for c, d in combinations(g.list(head), 2):
                bad.update(("cax-adc", x) for x in g.members(c) & g.members(d))


def restriction(g: Graph, r: Term, p: Term, bad: set[Finding]) -> Iterator[Triple]:
    pairs, members = g.pairs(p), g.members(r)
    for c in g.o(r, owl("someValuesFrom")):
        yield from ((x, TYPE, r) for x, y in pairs if c == THING or y in g.members(c))
    for c in g.o(r, owl("allValuesFrom")):
        yield from ((y, TYPE, c) for x, y in pairs if x in members)
    for value in g.o(r, owl("hasValue")):
        yield from ((x, p, value) for x in members)
        yield from ((x, TYPE, r) for x, y in pairs if key(y) == key(value))
    for kind, name in (("maxCardinality", "maxc"), ("maxQualifiedCardinality", "maxqc")):
        for limit in g.o(r, owl(kind)):
            for c in g.o(r, owl("onClass")) if name == "maxqc" else [THING]:
                values = [
                    (x, y) for x, y in pairs if x in members and (c == THING or y in g.members(c))
                ]
                if limit.value == "0":
                    bad.update((name, pair) for pair in values)
                elif limit.value == "1":
                    for (x, y), (z, w) in product(values, repeat=2):
                        if x == z and clash(y, w):
                            bad.add((name, frozenset((y, w))))
                        elif x == z and y != w and not isinstance(y, Literal):
                            yield y, SAME, w


def schema(g: Graph) -> Iterator[Triple]:
    # scm-cls, as far as the rules below need it
    yield from ((c, SUB, THING) for c in g.members(CLASS))
    for c, head in g.pairs(owl("intersectionOf")):
        yield from ((c, SUB, d) for d in g.list(head))
    for c, head in g.pairs(owl("unionOf")):
        yield from ((d, SUB, c) for d in g.list(head))
    for below, equal in ((SUB, EQC), (SPO, EQP)):
        for a, b in g.pairs(below):
            yield from ((a, below, c) for c in g.o(b, below))
            if (b, a) in g.by_p[below]:
                yield a, equal, b
        for a, b in g.pairs(equal):
            yield a, below, b
            yield b, below, a
    for side in (DOM, RNG):
        for p, c in g.pairs(side):
            yield from ((p, side, d) for d in g.o(c, SUB))
            yield from ((q, side, c) for q, above in g.pairs(SPO) if above == p)
    on = g.pairs(owl("onProperty"))
    below_class, below_property = g.by_p[SUB], g.by_p[SPO]
    for (c1, p1), (c2, p2) in product(on, repeat=2):
        for kind in ("hasValue", "someValuesFrom", "allValuesFrom"):
            for y1, y2 in product(g.o(c1, owl(kind)), g.o(c2, owl(kind))):
                # Every class and property is below itself, declared or not (scm-cls, scm-op).
                if p1 == p2 and kind != "hasValue" and (y1, y2) in below_class:
                    yield c1, SUB, c2
                if key(y1) == key(y2) and (p1 == p2 or (p1, p2) in below_property):
                    yield (c2, SUB, c1) if kind == "allValuesFrom" else (c1, SUB, c2)


def closure(triples: Iterable[Triple]) -> tuple[set[Triple], set[str]]:
    """Return all that follows, and the names of the checks that fail."""
    g = Graph(triples)
    bad: set[Finding] = set()
    while True:
        if not sum(g.add(t) for t in list(rules(g, bad))):
            return g.triples, {name for name, _ in bad}


def is_virtual(t: Triple, found: set[Triple]) -> bool:
    """Whether a triple is true of everything and left out of comparisons."""
    s, p, o = t
    if s == o and p in REFLEXIVE:
        return True
    if (s, SAME, o) in found and p in REFLEXIVE - {SAME}:
        return True
    if p == TYPE and o in (THING, rdfs("Resource")):
        return True
    if p in (DOM, RNG) and o == THING:
        return True
    return p == SUB and (o == THING or s == NOTHING)


def consequences(triples: Iterable[Triple]) -> tuple[set[Triple], set[str]]:
    """Return the closure without virtual triples."""
    found, bad = closure(triples)
    return {t for t in found if not is_virtual(t, found)}, bad
