"""The smallest sets of statements behind a contradiction: enough, and none of them to spare."""

from __future__ import annotations

from itertools import combinations

import pytest
from hypothesis import HealthCheck, assume, given, settings

from reasoner import Closure, LabelledRule
from reasoner.causes import Cause, quickxplain
from tests.reasoner.ttl import triples
from tests.reasoner.worlds import NARROW, WIDE

LONG_MS = 60_000
BASE = """
:code rdfs:range xsd:string . :angle rdfs:range xsd:double .
:c1 :code "ok" . :c2 :code "bad" . :s1 :angle 0.5e0 . :s2 :angle 1.5e0 .
"""
VARIANT = """
:Variant a rdfs:Datatype ; rdfs:label "variant" ;
  owl:equivalentClass xsd:boolean, xsd:double, xsd:int, xsd:string .
:angle rdfs:comment "in rad" . :Sector a owl:Class ; rdfs:subClassOf :Region .
"""


def is_inconsistent(statements) -> bool:
    return bool(Closure.build(statements, []).contradictions())


def named(cause: Cause) -> set[str]:
    return {triple[2].value.rpartition("#")[2] for triple in cause.statements}


def check_smallest(cause: Cause) -> None:
    whole = [*cause.statements, *cause.known]
    assert cause.is_smallest
    assert is_inconsistent(whole)
    for rest in combinations(whole, len(whole) - 1):
        assert not is_inconsistent(rest)


def test_two_lines_that_make_datatypes_equal_are_named_for_all_that_they_break():
    closure = Closure.build(triples(BASE), [])
    staged = closure.stage(add=triples(VARIANT))
    assert len(staged.contradictions) >= 4
    causes = staged.causes(LONG_MS)
    assert {"double", "int"} in map(named, causes)
    assert sorted(map(sorted, map(named, causes))) == [
        ["boolean", "double"],
        ["boolean", "string"],
        ["double", "int"],
        ["double", "string"],
        ["int", "string"],
    ]
    for cause in causes:
        check_smallest(cause)
        assert len(cause.statements) == 2
        assert {t[1].value[-5:] for t in cause.known} <= {"range", ":code", "angle"}


def test_a_cause_lies_in_what_is_added_and_names_what_it_clashes_with():
    closure = Closure.build(
        triples(":A rdfs:subClassOf :B . :B owl:disjointWith :C . :D rdfs:subClassOf :C ."),
        triples(":x a :A . :y a :A ."),
    )
    staged = closure.stage(add=triples(":x a :D ; :p 1 . :z a :D ."))
    (cause,) = staged.causes(LONG_MS)
    assert cause.statements == tuple(triples(":x a :D ."))
    assert len(cause.known) == 4
    check_smallest(cause)


def test_two_independent_causes_are_both_found():
    closure = Closure.build(triples(":A owl:disjointWith :B . :p a owl:FunctionalProperty ."), [])
    staged = closure.stage(add=triples(":x a :A, :B . :y :p 1, 2 . :z a :A ."))
    causes = staged.causes(LONG_MS)
    assert sorted(len(cause.statements) for cause in causes) == [2, 2]
    assert {t[0].value[-1] for cause in causes for t in cause.statements} == {"x", "y"}


def test_what_contradicts_itself_in_force_is_told_too():
    data = triples(":A owl:disjointWith :B . :x a :A, :B . :y a :A .")
    (cause,) = Closure.build(data, []).causes(LONG_MS)
    assert set(cause.statements) == set(data) - set(triples(":y a :A ."))
    assert cause.known == ()


def test_a_rule_behind_a_contradiction_is_named():
    rule = LabelledRule("CONSTRUCT { ?x a <urn:t:B> } WHERE { ?x <urn:t:p> ?y }", "p makes B")
    closure = Closure.build(triples(":A owl:disjointWith :B ."), [], [rule])
    staged = closure.stage(add=triples(":x a :A ; :p :y ."))
    (cause,) = staged.causes(LONG_MS)
    assert cause.rules == ("rule:p makes B",)
    assert len(cause.statements) == 2


def test_equal_names_are_followed_to_what_makes_them_equal():
    closure = Closure.build(triples(":id a owl:InverseFunctionalProperty ."), [])
    staged = closure.stage(add=triples(":a :id :n . :b :id :n . :a owl:differentFrom :b ."))
    (cause,) = staged.causes(LONG_MS)
    assert len(cause.statements) == 3
    check_smallest(cause)


@pytest.mark.slow
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_causes_of_random_worlds_are_smallest(size):
    @settings(
        max_examples=60,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(size.worlds())
    def check(world):
        schema, data = world
        closure = Closure.build(schema, data)
        assume(closure.contradictions())
        causes = closure.causes(LONG_MS)
        assert causes
        for cause in causes[:2]:
            check_smallest(cause)

    check()


def test_without_time_the_answer_is_marked_as_not_shrunk():
    closure = Closure.build(triples(BASE), [])
    causes = closure.stage(add=triples(VARIANT)).causes(budget_ms=0)
    assert not any(cause.is_smallest for cause in causes)


def test_quickxplain_asks_few_questions():
    asked = []

    def has_both(facts):
        asked.append(1)
        return {(3, 3, 3), (900, 900, 900)} <= set(facts)

    found = quickxplain([], [(n, n, n) for n in range(1000)], has_both)
    assert found == [(3, 3, 3), (900, 900, 900)]
    assert len(asked) < 50


def test_a_part_whose_rules_run_in_a_circle_shows_no_clash():
    """Only the declaration that values are literals keeps owl:sameAs out of the circle."""
    rule = LabelledRule(
        "CONSTRUCT { ?o <urn:t:held> true } "
        "WHERE { ?o <urn:t:won> true FILTER NOT EXISTS { ?o <urn:t:void> ?why } }",
        "won and not void is held",
    )
    stored = triples(":held a owl:FunctionalProperty, owl:DatatypeProperty . :o :held false .")
    staged = Closure.build(stored, [], [rule]).stage(add=triples(":o :won true ."))
    assert staged.contradictions
    (cause,) = staged.causes(LONG_MS)
    assert cause.statements == tuple(triples(":o :won true ."))
    assert set(cause.known) == set(stored)
