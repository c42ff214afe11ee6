"""Proofs: each step is checked alone by the naive engine, heights are least, output is stable."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings

from reasoner import Closure
from tests.reasoner.naive import Graph as NaiveGraph
from tests.reasoner.naive import consequences, rules
from tests.reasoner.ttl import triple, triples
from tests.reasoner.worlds import FIRST, NARROW

KITCHEN = """
:Vessel rdfs:subClassOf :Thing . :Mug rdfs:subClassOf :Vessel .
:Handled owl:intersectionOf (:Vessel [ owl:onProperty :has ; owl:someValuesFrom :Handle ]) .
:has rdfs:subPropertyOf :near .
"""
FACTS = ":mug a :Mug ; :has :h . :h a :Handle ."


def test_an_asserted_triple_is_its_own_proof_with_its_graphs():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    proof = closure.explain(triple(":mug a :Mug"), graphs_of=lambda t: ["urn:g:nao"])
    assert proof.is_asserted
    assert proof.height == 0
    assert proof.graphs == ("urn:g:nao",)


def test_a_derived_triple_is_explained_down_to_what_is_asserted():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    proof = closure.explain(triple(":mug a :Handled"))
    assert proof.rule == "cls-int1"
    assert proof.height == 2
    assert set(proof.leaves()) == set(triples(FACTS))
    assert proof.render().splitlines()[0].split() == ["mug", "a", "Handled", "cls-int1"]
    plain = json.loads(json.dumps(proof.to_dict()))
    assert plain["height"] == 2
    assert plain["premises"][0]["premises"][0]["rule"] == "asserted"


def test_anonymous_classes_are_shown_by_what_they_mean():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    text = closure.explain(triple(":mug a :Handled")).render()
    assert "mug a (has some Handle)" in text


def test_what_does_not_hold_is_refuted_by_what_it_lacks():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    assert "would have to be asserted" in closure.explain(triple(":h a :Mug")).render()
    unknown = closure.explain(triple(":nobody a :Mug"))
    assert (unknown.holds, bool(unknown), unknown.unknown) == (False, False, ("nobody",))
    gone = triple(":nobody a :Nothing")
    closure.stage(add=[gone]).apply()
    assert closure.explain(triple(":nobody a :Mug")).unknown == ()
    closure.stage(remove=[gone]).apply()
    assert closure.explain(triple(":nobody a :Mug")) == unknown
    near = closure.explain(triple(":h a :Thing"))
    assert [need.missing for need in near.needs] == [("h a Vessel",)]
    handled = Closure.build(triples(KITCHEN), triples(":cup a :Mug .")).explain(
        triple(":cup a :Handled")
    )
    assert handled.needs[0].missing == ("cup a (has some Handle)",)
    assert handled.needs[0].present == ("cup a Vessel",)


def test_a_rule_whose_filter_alone_fails_is_named():
    rule = (
        "CONSTRUCT { ?r <urn:t:lifts> ?x } WHERE { ?r <urn:t:payload> ?p . ?x <urn:t:mass> ?m "
        "FILTER(?m < ?p) }"
    )
    closure = Closure.build([], triples(":r :payload 1 . :x :mass 2 ."), [rule])
    (need,) = closure.explain(triple(":r :lifts :x")).needs
    assert "FILTER" in need.condition
    assert need.present == ('r payload "1"', 'x mass "2"')


def test_a_part_that_is_no_term_is_an_error():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    with pytest.raises(TypeError, match="expected a term, got str: 'urn:t:mug'"):
        closure.explain(("urn:t:mug", *triple(":mug a :Mug")[1:]))


def test_what_is_true_of_everything_is_explained_by_its_rule_alone():
    closure = Closure.build(triples(":C a owl:Class ."), [])
    proof = closure.explain(triple(":C rdfs:subClassOf owl:Thing"))
    assert (proof.rule, proof.premises) == ("scm-cls", ())


def test_equality_is_a_step_of_its_own():
    closure = Closure.build(
        triples(":p a owl:FunctionalProperty ."), triples(":a :p :b, :c . :b :q :d .")
    )
    proof = closure.explain(triple(":c :q :d"))
    assert proof.rule == "eq-rep-s"
    assert {p.rule for p in proof.premises} == {"prp-fp", "asserted"}


def test_an_absent_pattern_is_part_of_the_proof():
    rule = (
        "CONSTRUCT { ?thing <urn:t:free> true } WHERE { ?thing a <urn:t:C> "
        "FILTER NOT EXISTS { ?thing <urn:t:heldBy> ?hand } }"
    )
    closure = Closure.build([], triples(":a a :C ."), [rule])
    proof = closure.explain(triple(":a :free true"))
    assert proof.rule == "rule:free"
    assert proof.absent == ("a heldBy ?hand",)


def test_a_schema_triple_has_a_proof_too():
    closure = Closure.build(triples(":C rdfs:subClassOf :D . :D owl:equivalentClass :E ."), [])
    proof = closure.explain(triple(":C rdfs:subClassOf :E"))
    assert proof.rule == "scm-sco"
    assert proof.premises[1].rule == "scm-eqc1"


def test_circles_are_not_proofs():
    closure = Closure.build(
        triples(":p owl:inverseOf :q . :p owl:equivalentProperty :q ."), triples(":a :p :b .")
    )
    proof = closure.explain(triple(":a :q :b"))
    assert list(proof.leaves()) == [triple(":a :p :b")]


def test_a_budget_that_does_not_suffice_decides_nothing():
    closure = Closure.build(triples(KITCHEN), triples(FACTS))
    found = closure.explain(triple(":mug a :Handled"), budget=2)
    assert (found.holds, found.budget) == (None, 2)
    assert "not decided within a budget of 2 steps" in found.render()
    with pytest.raises(TypeError, match="not decided"):
        bool(found)
    assert closure.explain(triple(":mug a :Handled"), budget=found.more).holds


def test_of_two_proofs_the_lower_one_is_given():
    closure = Closure.build(
        triples(":A rdfs:subClassOf :B . :B rdfs:subClassOf :C . :p rdfs:domain :C ."),
        triples(":x a :A ; :p :y ."),
    )
    proof = closure.explain(triple(":x a :C"))
    assert (proof.rule, proof.height) == ("prp-dom", 1)


def check_step(proof, schema) -> None:
    """A step is sound if the naive engine makes it from the premises and the schema alone."""
    if proof.is_asserted:
        return
    if proof.rule != "eq-ref":
        # The naive engine reads one member of a cell; equal ones make several.
        cells = {(s, p) for s, p, _ in proof.schema if p == FIRST}
        others = [t for t in schema if t[:2] not in cells]
        graph = NaiveGraph([*(p.triple for p in proof.premises), *others, *proof.schema])
        assert proof.triple in set(rules(graph, set())), proof.render()
    for premise in proof.premises:
        assert premise.height < proof.height
        check_step(premise, schema)


def is_schema(t) -> bool:
    names = [x.value for x in t[1:] if hasattr(x, "value")]
    return any("rdf-schema#" in n or "owl#" in n or "#first" in n or "#rest" in n for n in names)


@pytest.mark.slow
@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(NARROW.worlds(10))
def test_every_consequence_has_a_proof_whose_steps_hold(world):
    schema, data = world
    closure = Closure.build(schema, data)
    expected, _ = consequences([*schema, *data])
    known = [t for t in expected if is_schema(t) and "sameAs" not in t[1].value]
    for consequence in sorted(expected - {*schema, *data}, key=str):
        proof = closure.explain(consequence, budget=10_000_000)
        assert proof.holds
        assert set(proof.leaves()) <= {*schema, *data}
        check_step(proof, known)
