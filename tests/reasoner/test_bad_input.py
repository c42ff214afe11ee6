"""Ontologies and rules that nobody should write: quick, clear answers and never a hang."""

from __future__ import annotations

import itertools
import time

import pytest

from reasoner import Closure, ClosureTooLargeError, RuleError, StratificationError
from tests.reasoner.ttl import triple, triples
from tests.reasoner.worlds import TYPE, names, owl, rdfs

DEADLINE_S = 60
"""Each takes below 3 s of processor time; a busy machine may be many times slower."""


@pytest.fixture(autouse=True)
def _in_time():
    start = time.process_time()
    yield
    assert time.process_time() - start < DEADLINE_S


def chain(p, letter: str, count: int) -> list:
    nodes = names(letter, count + 1)
    return [(a, p, b) for a, b in itertools.pairwise(nodes)]


# Too much follows.


@pytest.mark.slow
def test_a_chain_of_a_hundred_thousand_subclasses_is_refused_with_the_bound_and_the_property():
    with pytest.raises(ClosureTooLargeError, match=r"more than \d+ facts follow.*subClassOf"):
        Closure.build(chain(rdfs("subClassOf"), "C", 100_000), [])


def test_a_transitive_property_over_a_long_chain_is_refused_in_the_same_way():
    p = names("p", 1)[0]
    with pytest.raises(ClosureTooLargeError, match="urn:t:p0"):
        Closure.build([(p, TYPE, owl("TransitiveProperty"))], chain(p, "i", 2_000))


def test_a_shorter_chain_is_closed_whole():
    p = names("p", 1)[0]
    closure = Closure.build([(p, TYPE, owl("TransitiveProperty"))], chain(p, "i", 600))
    assert sum(1 for _ in closure.inferred()) == 600 * 601 // 2 - 600


@pytest.mark.slow
def test_a_chain_that_comes_as_a_small_change_is_closed_as_quickly():
    p = names("p", 1)[0]
    closure = Closure.build([(p, TYPE, owl("TransitiveProperty"))], chain(p, "j", 2))
    closure.stage(add=chain(p, "i", 600)).apply()
    assert sum(1 for _ in closure.inferred()) == 600 * 601 // 2 - 600 + 1


@pytest.mark.slow
def test_a_ring_with_a_tail_is_closed_whole():
    p = names("p", 1)[0]
    ring = [*chain(p, "i", 99), (names("i", 100)[-1], p, names("i", 1)[0])]
    tail = [(names("i", 1)[0], p, names("t", 1)[0]), *chain(p, "t", 50)]
    closure = Closure.build([(p, TYPE, owl("TransitiveProperty"))], [*ring, *tail])
    assert sum(1 for t in closure.match(None, p, None)) == 100 * 100 + 100 * 51 + 51 * 50 // 2


def test_a_change_that_derives_too_much_is_refused_and_leaves_nothing_behind():
    p = names("p", 1)[0]
    closure = Closure.build([(p, TYPE, owl("TransitiveProperty"))], chain(p, "i", 100))
    before = closure.digest()
    with pytest.raises(ClosureTooLargeError):
        closure.stage(add=chain(p, "j", 3_000))
    assert closure.digest() == before


# Everything is the same, or wrong.


def test_ten_thousand_names_in_a_ring_of_same_as_are_one_thing():
    ring = [
        *chain(owl("sameAs"), "i", 9_999),
        (names("i", 10_000)[-1], owl("sameAs"), names("i", 1)[0]),
    ]
    closure = Closure.build([], [*ring, *triples(":i7 :says :this .")])
    assert closure.contains(triple(":i9000 :says :this"))
    assert len(closure.same_as(names("i", 1)[0])) == 10_000


@pytest.mark.slow
def test_such_a_ring_can_be_cut_open_again():
    members = names("i", 10_000)
    ring = [*chain(owl("sameAs"), "i", 9_999), (members[-1], owl("sameAs"), members[0])]
    closure = Closure.build([], ring)
    closure.stage(remove=ring[5:6]).apply()
    assert len(closure.same_as(members[0])) == 10_000
    closure.stage(remove=ring[9_000:9_001]).apply()
    assert len(closure.same_as(members[0])) == 10_000 - 8_995


def test_an_ontology_that_allows_nothing_contradicts_each_fact_and_lists_a_hundred():
    schema = triples(":C owl:disjointWith :C .")
    closure = Closure.build(schema, [(i, TYPE, names("C", 1)[0]) for i in names("i", 5_000)])
    assert closure.contradictions() == []
    closure = Closure.build(
        triples(":C0 owl:disjointWith :C0 ."),
        [(i, TYPE, names("C", 1)[0]) for i in names("i", 5_000)],
    )
    assert len(closure.contradictions()) == 100
    assert closure.stats()["contradictions"] == 5_000


def test_everything_below_nothing_is_reported_and_nothing_is_made_up():
    closure = Closure.build(
        triples(":C rdfs:subClassOf owl:Nothing ."), triples(":a a :C . :b :p :c .")
    )
    assert {c.rule for c in closure.contradictions()} == {"cls-nothing2"}
    assert not closure.contains(triple(":b a :C"))


def test_a_class_may_be_an_individual_too():
    closure = Closure.build(
        triples(":Mug rdfs:subClassOf :Vessel . :Kind rdfs:subClassOf :Idea ."),
        triples(":Mug a :Kind ; owl:sameAs :Cup . :m a :Cup ."),
    )
    for said in (":m a :Vessel", ":Cup a :Idea", ":Cup rdfs:subClassOf :Vessel"):
        assert closure.contains(triple(said))


# Rules.

COUNT = "PREFIX : <urn:t:>\nCONSTRUCT { ?x :next ?n }\nWHERE { ?x :count ?c . BIND (?c + 1 AS ?n) }"
BACK = "PREFIX : <urn:t:> CONSTRUCT { ?x :count ?n } WHERE { ?x :next ?n }"


def test_a_rule_that_counts_on_is_refused_with_its_line():
    reason = r"line \d, column \d+: the rule makes new values .* would not end"
    with pytest.raises(RuleError, match=reason):
        Closure.build([], [], rules=[COUNT.replace(":next", ":count")])


def test_rules_that_count_on_together_are_refused_with_the_circle():
    assert Closure.build([], triples(":a :count 1 ."), rules=[COUNT]).contains(triple(":a :next 2"))
    with pytest.raises(StratificationError, match=r"would not end: .*next <- .*count <- .*next"):
        Closure.build([], triples(":a :count 1 ."), rules=[COUNT, BACK])


def test_a_rule_that_an_axiom_feeds_with_its_own_results_is_refused_too():
    closure = Closure.build([], triples(":a :count 1 ."), rules=[COUNT])
    with pytest.raises(StratificationError, match="would not end"):
        closure.stage(add=triples(":next rdfs:subPropertyOf :count ."))
    assert not closure.contains(triple(":a :count 2"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "PREFIX : <urn:t:>\nCONSTRUCT { ?x :p ?y }\nWHERE { ?x :q ?y ",
            "line 3, column 18: not a SPARQL query",
        ),
        ("SELECT * WHERE { ?s ?p ?o }", "line 1: a rule is a CONSTRUCT query"),
        ("", "line 1, column 1: not a SPARQL query"),
        ("PREFIX : <urn:t:>\nCONSTRUCT { ?x :p ?y }\nWHERE { ?x ?q ?y }", r"line 3, column \d+: "),
    ],
)
def test_a_malformed_rule_is_refused_with_line_and_reason(text, message):
    with pytest.raises(RuleError, match=message):
        Closure.build([], [], rules=[text])
