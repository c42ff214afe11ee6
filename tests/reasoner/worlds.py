"""Random schemas and facts for property tests: every construct, with a liking for recursion."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode

from reasoner.terms.vocabulary import OWL, RDF, RDFS, XSD

NS = "urn:t:"
TYPE, FIRST, REST, NIL = (NamedNode(RDF + n) for n in ("type", "first", "rest", "nil"))
VALUES = [Literal("a"), Literal("b"), Literal(1), Literal(300), Literal(1.5)]
DATATYPES = [NamedNode(XSD + n) for n in ("integer", "byte", "string")]

Triple = tuple[NamedNode, NamedNode, NamedNode | Literal]


def owl(name: str) -> NamedNode:
    return NamedNode(OWL + name)


def rdfs(name: str) -> NamedNode:
    return NamedNode(RDFS + name)


def names(letter: str, count: int) -> list[NamedNode]:
    return [NamedNode(f"{NS}{letter}{i}") for i in range(count)]


@dataclass(frozen=True)
class World:
    """Numbers of things of each kind; fewer things meet more often."""

    n_classes: int = 5
    n_properties: int = 4
    n_data: int = 2
    n_people: int = 6

    @property
    def classes(self):
        return st.sampled_from(names("C", self.n_classes))

    @property
    def properties(self):
        return st.sampled_from(names("p", self.n_properties))

    @property
    def data(self):
        return st.sampled_from(names("d", self.n_data))

    @property
    def people(self):
        return st.sampled_from(names("i", self.n_people))

    # Facts.

    def facts(self):
        """One triple about individuals."""
        return st.one_of(
            st.tuples(self.people, st.just(TYPE), self.classes),
            st.tuples(self.people, self.properties, self.people),
            st.tuples(self.people, self.properties, self.people),
            st.tuples(self.people, self.data, st.sampled_from(VALUES)),
            st.tuples(self.people, st.just(owl("differentFrom")), self.people),
        )

    def merges(self):
        """Two individuals, now and then two classes or properties, are the same."""
        same = st.just(owl("sameAs"))
        return st.one_of(
            st.tuples(self.people, same, self.people),
            st.tuples(self.people, same, self.people),
            st.tuples(self.classes, same, self.classes),
            st.tuples(self.properties, same, self.properties),
        )

    # Axioms, each as the triples that state it.

    def axioms(self):
        c, p, d, i = self.classes, self.properties, self.data, self.people
        return st.one_of(
            self.equating(),
            _between("subClassOf", c, c, rdfs),
            _between("subPropertyOf", p, p, rdfs),
            _between("domain", p | d, c, rdfs),
            _between("range", p, c, rdfs),
            _between("range", d, st.sampled_from(DATATYPES), rdfs),
            _between("equivalentClass", c, c),
            _between("equivalentProperty", p, p),
            _between("inverseOf", p, p),
            _between("disjointWith", c, c),
            _between("propertyDisjointWith", p, p),
            _between("complementOf", c, c),
            _typed("TransitiveProperty", p),
            _typed("SymmetricProperty", p),
            _typed("AsymmetricProperty", p),
            _typed("IrreflexiveProperty", p),
            _typed("Class", c),
            _listed(p, "propertyChainAxiom", p),
            _listed(c, "intersectionOf", c),
            _listed(c, "unionOf", c),
            _listed(c, "oneOf", i),
            _grouped("AllDifferent", "members", i),
            _grouped("AllDifferent", "distinctMembers", i),
            _grouped("AllDisjointClasses", "members", c),
            _grouped("AllDisjointProperties", "members", p),
            self.restrictions(("someValuesFrom", "allValuesFrom", "hasValue")),
            self.denials(),
        )

    def equating(self):
        """Axioms that make individuals the same."""
        p, d = self.properties, self.data
        return st.one_of(
            _typed("FunctionalProperty", p | d),
            _typed("InverseFunctionalProperty", p | d),
            _listed(self.classes, "hasKey", p | d, (1, 2)),
            self.restrictions(("maxCardinality", "maxQualifiedCardinality")),
        )

    @st.composite
    def restrictions(draw, self, kinds) -> list[Triple]:
        c, p, kind = draw(self.classes), draw(self.properties), draw(st.sampled_from(kinds))
        top = st.just(owl("Thing"))
        filler = {
            "someValuesFrom": self.classes | top,
            "allValuesFrom": self.classes,
            "hasValue": self.people,
        }.get(kind, st.sampled_from([Literal(0), Literal(1), Literal(1)]))
        triples = [(c, owl("onProperty"), p), (c, owl(kind), draw(filler))]
        if kind == "maxQualifiedCardinality":
            triples.append((c, owl("onClass"), draw(self.classes | top)))
        return triples

    @st.composite
    def denials(draw, self) -> list[Triple]:
        node = NamedNode(f"{NS}denial{draw(st.integers(0, 9))}")
        triples = [(node, owl("sourceIndividual"), draw(self.people))]
        if draw(st.booleans()):
            p, target, value = draw(self.properties), "targetIndividual", draw(self.people)
        else:
            p, target, value = draw(self.data), "targetValue", draw(st.sampled_from(VALUES))
        return [*triples, (node, owl("assertionProperty"), p), (node, owl(target), value)]

    def schemas(self, max_size: int = 12):
        """Some axioms."""
        return st.lists(self.axioms(), min_size=2, max_size=max_size).map(_flat)

    def worlds(self, max_facts: int = 25):
        """A schema with facts, now and then with sameAs."""
        merges = st.lists(self.merges(), max_size=2)
        facts = st.lists(self.facts(), min_size=3, max_size=max_facts)
        return st.tuples(self.schemas(), facts, merges).map(lambda w: (w[0], [*w[1], *w[2]]))

    def edits(self):
        """A script of commits: what to add, and which of what is there to take away."""
        one = self.facts().map(lambda t: [t])
        part = st.one_of(one, one, self.merges().map(lambda t: [t]), self.axioms())
        batch = st.lists(part, max_size=4).map(_flat)
        picks = st.lists(st.integers(0, 200), max_size=3)
        return st.lists(st.tuples(batch, picks), min_size=1, max_size=4)


def _flat(parts: list[list[Triple]]) -> list[Triple]:
    return [t for part in parts for t in part]


def _between(p: str, left, right, namespace=owl):
    return st.tuples(left, st.just(namespace(p)), right).map(lambda t: [t])


def _typed(p: str, subject):
    return subject.map(lambda s: [(s, TYPE, owl(p))])


@st.composite
def _lists(draw, members, size=(1, 3)) -> tuple[NamedNode, list[Triple]]:
    items = draw(st.lists(members, min_size=size[0], max_size=size[1], unique=True))
    name = "-".join(item.value.removeprefix(NS) for item in items)
    nodes = [NamedNode(f"{NS}list-{name}-{i}") for i in range(len(items))]
    triples = []
    for node, item, after in zip(nodes, items, [*nodes[1:], NIL], strict=True):
        triples += [(node, FIRST, item), (node, REST, after)]
    return nodes[0], triples


@st.composite
def _listed(draw, subject, p: str, members, size=(1, 3)) -> list[Triple]:
    head, triples = draw(_lists(members, size))
    return [(draw(subject), owl(p), head), *triples]


@st.composite
def _grouped(draw, kind: str, p: str, members) -> list[Triple]:
    head, triples = draw(_lists(members, (2, 2)))
    node = NamedNode(f"{NS}{kind}-{p}-{head.value.removeprefix(NS)}")
    return [(node, TYPE, owl(kind)), (node, owl(p), head), *triples]


WIDE = World()
NARROW = World(n_classes=3, n_properties=2, n_data=1, n_people=4)
