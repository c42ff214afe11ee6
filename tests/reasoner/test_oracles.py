"""The closure beside other engines and known sizes, on kitchens with robots."""

from __future__ import annotations

import random

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner import Closure
from reasoner.facts import arrays, relations
from reasoner.terms.vocabulary import OWL, RDF, RDFS
from tests.benchmarks.reasoner.kitchens import CLOSURE_SIZES, facts, n, schema, size_of_closure
from tests.reasoner.naive import consequences
from tests.reasoner.ttl import triples


def test_the_size_of_the_closure_is_known():
    data = facts(10_000)
    closure = Closure.build(schema(), data)
    assert size_of_closure(data, list(closure.inferred())) == CLOSURE_SIZES[10_000]


def test_joins_in_parts_give_the_same(monkeypatch):
    data = facts(2_500)
    whole = set(Closure.build(schema(), data).inferred())
    monkeypatch.setattr(arrays, "MAX_ROWS", 100)
    assert set(Closure.build(schema(), data).inferred()) == whole


def test_large_relations_stay_in_arrays_with_the_same_answers(monkeypatch):
    data, more = facts(2_500), facts(2_600)[2_500:]
    monkeypatch.setattr(relations, "LARGE", 10)
    closure = Closure.build(schema(), data)
    fresh = Closure.build(schema(), [*data, *more])
    closure.stage(add=more, remove=data[:200]).apply()
    closure.stage(add=data[:200]).apply()
    assert set(closure.inferred()) == set(fresh.inferred())


def test_the_closure_of_kitchens_is_that_of_the_rules_as_printed():
    asserted = [*schema(), *facts(250)]
    expected, bad = consequences(asserted)
    closure = Closure.build(asserted, [])
    assert set(closure.inferred()) == expected - set(asserted)
    assert not bad
    assert not closure.contradictions()


def test_every_tenth_of_a_large_closure_has_a_proof():
    data = facts(10_000)
    closure = Closure.build(schema(), data)
    asserted = {*schema(), *data}
    for triple in random.Random(3).sample(list(closure.inferred()), 200):
        proof = closure.explain(triple, budget=10_000_000)
        assert proof.holds
        assert set(proof.leaves()) <= asserted


EQUALITIES = """
:p a owl:FunctionalProperty . :q a owl:InverseFunctionalProperty . :p rdfs:subPropertyOf :s .
:C rdfs:subClassOf :D . :C owl:oneOf (:a :e) .
:a :p :b, :c . :b a :C . :d :q :c . :x :q :b . :d a :E . :f owl:sameAs :a .
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kitchens", "equalities"])
def test_the_closure_is_that_of_owlrl(name):
    """Compared in the terms of the data: owlrl also says what is true of everything."""
    from owlrl import DeductiveClosure, OWLRL_Semantics
    from rdflib import Graph

    asserted = [*schema(), *facts(150)] if name == "kitchens" else triples(EQUALITIES)
    graph = Graph()
    for triple in asserted:
        graph.add(tuple(map(to_rdflib, triple)))
    DeductiveClosure(OWLRL_Semantics).expand(graph)
    theirs = {tuple(map(from_rdflib, t)) for t in graph if is_comparable(t)}
    closure = Closure.build(asserted, [])
    ours = {t for t in closure.match() if is_comparable(tuple(map(to_rdflib, t)))}
    assert ours == theirs


def is_comparable(t) -> bool:
    """Whether a triple is about the data: no literal as subject, nothing said of everything."""
    from rdflib import URIRef

    s, p, o = map(str, t)
    if not isinstance(t[0], URIRef) or s.startswith((OWL, RDF, RDFS, "http://www.w3.org/2001")):
        return False
    if p.startswith(RDFS) and o.startswith((OWL, RDFS)):
        return False
    if p == RDF + "type" and o.startswith((OWL, RDFS)):
        return False
    return not (s == o and p.startswith((OWL, RDFS)))


def to_rdflib(term):
    import rdflib

    if isinstance(term, NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, BlankNode):
        return rdflib.BNode(term.value)
    return rdflib.Literal(term.value, datatype=rdflib.URIRef(term.datatype.value))


def from_rdflib(node):
    import rdflib

    if isinstance(node, rdflib.URIRef):
        return NamedNode(str(node))
    if isinstance(node, rdflib.BNode):
        return BlankNode(str(node))
    return Literal(str(node), datatype=n(str(node.datatype), ""))
