"""Random schemas and facts for property tests: every construct, with a liking for recursion."""

from __future__ import annotations

from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode

from reasoner.vocabulary import OWL, RDF, RDFS, XSD

NS = "urn:t:"
CLASSES = [NamedNode(f"{NS}C{i}") for i in range(5)]
PROPERTIES = [NamedNode(f"{NS}p{i}") for i in range(4)]
DATA = [NamedNode(f"{NS}d{i}") for i in range(2)]
PEOPLE = [NamedNode(f"{NS}i{i}") for i in range(6)]
VALUES = [Literal("a"), Literal("b"), Literal(1), Literal(300), Literal(1.5)]
TYPE, FIRST, REST, NIL = (NamedNode(RDF + n) for n in ("type", "first", "rest", "nil"))

Triple = tuple[NamedNode, NamedNode, NamedNode | Literal]


def owl(name: str) -> NamedNode:
    return NamedNode(OWL + name)


def rdfs(name: str) -> NamedNode:
    return NamedNode(RDFS + name)


classes, properties, people = map(st.sampled_from, (CLASSES, PROPERTIES, PEOPLE))
data_properties, values = st.sampled_from(DATA), st.sampled_from(VALUES)


@st.composite
def lists(draw, members, size=(1, 3)) -> tuple[NamedNode, list[Triple]]:
    items = draw(st.lists(members, min_size=size[0], max_size=size[1], unique=True))
    name = "-".join(item.value.removeprefix(NS) for item in items)
    nodes = [NamedNode(f"{NS}list-{name}-{i}") for i in range(len(items))]
    triples = []
    for node, item, after in zip(nodes, items, [*nodes[1:], NIL], strict=True):
        triples += [(node, FIRST, item), (node, REST, after)]
    return nodes[0], triples


def between(p: str, left, right, namespace=owl):
    return st.tuples(left, st.just(namespace(p)), right).map(lambda t: [t])


def typed(p: str, subject):
    return subject.map(lambda s: [(s, TYPE, owl(p))])


@st.composite
def listed(draw, subject, p: str, members, size=(1, 3)) -> list[Triple]:
    head, triples = draw(lists(members, size))
    return [(draw(subject), owl(p), head), *triples]


@st.composite
def grouped(draw, kind: str, p: str, members) -> list[Triple]:
    head, triples = draw(lists(members, (2, 3)))
    node = NamedNode(f"{NS}{kind}-{p}-{head.value.removeprefix(NS)}")
    return [(node, TYPE, owl(kind)), (node, owl(p), head), *triples]


@st.composite
def restrictions(draw) -> list[Triple]:
    c, p = draw(classes), draw(properties)
    kind, filler = draw(
        st.one_of(
            st.tuples(st.just("someValuesFrom"), classes | st.just(owl("Thing"))),
            st.tuples(st.just("allValuesFrom"), classes),
            st.tuples(st.just("hasValue"), people),
            st.tuples(st.just("maxCardinality"), st.sampled_from([Literal(0), Literal(1)])),
            st.tuples(
                st.just("maxQualifiedCardinality"), st.sampled_from([Literal(0), Literal(1)])
            ),
        )
    )
    triples = [(c, owl("onProperty"), p), (c, owl(kind), filler)]
    if kind == "maxQualifiedCardinality":
        triples.append((c, owl("onClass"), draw(classes | st.just(owl("Thing")))))
    return triples


@st.composite
def denials(draw) -> list[Triple]:
    node = NamedNode(f"{NS}denial{draw(st.integers(0, 10**6))}")
    triples = [(node, owl("sourceIndividual"), draw(people))]
    if draw(st.booleans()):
        p, target, value = draw(properties), "targetIndividual", draw(people)
    else:
        p, target, value = draw(data_properties), "targetValue", draw(values)
    return [*triples, (node, owl("assertionProperty"), p), (node, owl(target), value)]


def axioms():
    """One axiom, as the triples that state it."""
    datatype = st.sampled_from([NamedNode(XSD + n) for n in ("integer", "byte", "string")])
    return st.one_of(
        between("subClassOf", classes, classes, rdfs),
        between("subPropertyOf", properties, properties, rdfs),
        between("domain", properties | data_properties, classes, rdfs),
        between("range", properties, classes, rdfs),
        between("range", data_properties, datatype, rdfs),
        between("equivalentClass", classes, classes),
        between("equivalentProperty", properties, properties),
        between("inverseOf", properties, properties),
        between("disjointWith", classes, classes),
        between("propertyDisjointWith", properties, properties),
        between("complementOf", classes, classes),
        typed("TransitiveProperty", properties),
        typed("SymmetricProperty", properties),
        typed("AsymmetricProperty", properties),
        typed("IrreflexiveProperty", properties),
        typed("FunctionalProperty", properties | data_properties),
        typed("InverseFunctionalProperty", properties | data_properties),
        typed("Class", classes),
        listed(properties, "propertyChainAxiom", properties),
        listed(classes, "intersectionOf", classes),
        listed(classes, "unionOf", classes),
        listed(classes, "oneOf", people),
        listed(classes, "hasKey", properties | data_properties, (1, 2)),
        grouped("AllDifferent", "members", people),
        grouped("AllDifferent", "distinctMembers", people),
        grouped("AllDisjointClasses", "members", classes),
        grouped("AllDisjointProperties", "members", properties),
        restrictions(),
        denials(),
    )


def schemas(max_size: int = 12):
    return st.lists(axioms(), min_size=2, max_size=max_size).map(
        lambda parts: [t for part in parts for t in part]
    )


def facts():
    """One triple about individuals."""
    return st.one_of(
        st.tuples(people, st.just(TYPE), classes),
        st.tuples(people, properties, people),
        st.tuples(people, properties, people),
        st.tuples(people, data_properties, values),
        st.tuples(people, st.just(owl("differentFrom")), people),
    )


def merges():
    return st.tuples(people, st.just(owl("sameAs")), people)


def worlds(max_facts: int = 25):
    """A schema with facts, now and then with sameAs."""
    return st.tuples(
        schemas(),
        st.lists(facts(), min_size=3, max_size=max_facts),
        st.lists(merges(), max_size=2),
    ).map(lambda parts: ([*parts[0]], [*parts[1], *parts[2]]))
