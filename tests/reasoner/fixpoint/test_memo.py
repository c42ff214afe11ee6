"""A closure that begins with what another one began with equals one that was derived itself."""

from __future__ import annotations

from dataclasses import replace

import pyoxigraph as ox
import pytest
from hypothesis import HealthCheck, given, settings

import ontology
import rtask
from reasoner import ChangeBudget, Closure, ClosureTooLargeError, Config
from reasoner.fixpoint import maintenance
from reasoner.fixpoint.memo import Memo
from rtask.kb.store.minters import Minters
from tests.reasoner.test_closure_properties import IN_BULK, RULES, clashes
from tests.reasoner.ttl import triple, triples
from tests.reasoner.worlds import WIDE

WORLD = """
:Mug rdfs:subClassOf :Vessel, [
    a owl:Restriction ; owl:onProperty :holds ; owl:allValuesFrom :Drink ] .
:holds rdfs:domain :Vessel . :m a :Mug ; :holds :tea, 3 .
"""
COUNTS = "CONSTRUCT { ?x <urn:t:much> ?n } WHERE { ?x <urn:t:holds> ?v BIND (?v * 2 AS ?n) }"


@pytest.fixture
def derived(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that grows with each derivation from nothing, from an empty memory on."""
    sizes: list[int] = []
    rebuild = maintenance.Maintainer.rebuild

    def counted(self, asserted, *rest, **more):
        sizes.append(len(asserted.added))
        return rebuild(self, asserted, *rest, **more)

    monkeypatch.setattr(maintenance, "_MEMO", Memo())
    monkeypatch.setattr(maintenance.Maintainer, "rebuild", counted)
    return sizes


def begun(facts, rules=(), config: Config = IN_BULK, budget: ChangeBudget | None = None) -> Closure:
    """A closure that was empty before it was given these facts."""
    closure = Closure(rules, config)
    closure.stage(add=facts, budget=budget).apply()
    return closure


def relabelled(facts, prefix: str) -> list:
    def other(term):
        return ox.BlankNode(prefix + term.value) if isinstance(term, ox.BlankNode) else term

    return [(other(s), p, other(o)) for s, p, o in facts]


def test_the_same_facts_under_other_labels_are_not_derived_again(derived):
    first = begun(triples(WORLD), [COUNTS])
    second = begun(relabelled(triples(WORLD), "x"), [COUNTS])
    assert len(derived) == 1
    assert set(second.inferred()) == set(relabelled(first.inferred(), "x"))
    assert {str(o) for _, p, o in second.inferred() if p.value == "urn:t:much"} == {
        '"6"^^<http://www.w3.org/2001/XMLSchema#integer>'
    }


@pytest.mark.parametrize(
    ("facts", "rules"),
    [
        (WORLD.replace("3", "4"), [COUNTS]),
        (WORLD.replace("3", "'3'"), [COUNTS]),
        (WORLD.replace(":Drink", ":Food"), [COUNTS]),
        (WORLD + ":m a :Gift .", [COUNTS]),
        (WORLD, [COUNTS, RULES[4]]),
        (WORLD, ()),
    ],
)
def test_what_differs_in_anything_is_derived(derived, facts, rules):
    begun(triples(WORLD), [COUNTS])
    here = begun(triples(facts), rules)
    assert set(here.inferred()) == set(Closure.build(triples(facts), [], rules).inferred())
    assert len(derived) == 3  # with that of `build`


def test_changes_of_one_closure_do_not_reach_those_that_began_alike(derived):
    step_by_step = Config(bulk_from=len(triples(WORLD)))
    begun(triples(WORLD), config=step_by_step)
    first, second = (begun(triples(WORLD), config=step_by_step) for _ in "12")
    assert len(derived) == 1
    before = set(second.inferred())
    more = triples(":Vessel rdfs:subClassOf :Ware . :m2 a :Mug .")
    first.stage(add=more).apply()
    assert set(second.inferred()) == before == set(begun(triples(WORLD)).inferred())
    assert set(begun(triples(WORLD), config=step_by_step).inferred()) == before
    assert set(first.inferred()) == set(Closure.build([*triples(WORLD), *more], []).inferred())


@pytest.mark.parametrize(
    "fault",
    [
        ":m owl:sameAs _:n .",
        ":Mug owl:disjointWith :Gift . :m a :Gift .",
        ":Mug owl:intersectionOf [ rdf:first :A ] .",
    ],
)
def test_equal_terms_and_faults_are_derived_each_time(derived, fault):
    here, there = begun(triples(WORLD + fault)), begun(triples(WORLD + fault))
    assert len(derived) == 2
    assert clashes(here) == clashes(there)


def test_a_rule_that_reads_labels_is_applied_to_those_that_are_there(derived):
    rule = (
        "CONSTRUCT { ?x <urn:t:first> ?y } WHERE { ?x a ?c . ?y a ?c FILTER (STR(?x) < STR(?y)) }"
    )
    facts = triples("_:a a :C . _:b a :C .")
    begun(facts, [rule])
    swapped = [(ox.BlankNode({"a": "z"}.get(s.value, s.value)), p, o) for s, p, o in facts]
    assert {(str(s), str(o)) for s, p, o in begun(swapped, [rule]).inferred()} == {("_:b", "_:z")}
    assert len(derived) == 2


def test_a_change_that_may_derive_less_is_refused_although_the_answer_is_there(derived):
    begun(triples(WORLD))
    with pytest.raises(ClosureTooLargeError):
        begun(triples(WORLD), budget=ChangeBudget(0, 10_000))


@settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(WIDE.worlds(), WIDE.edits())
def test_edits_after_a_remembered_beginning_give_what_a_rebuild_gives(world, script):
    asserted = {*world[0], *world[1]}
    begun(sorted(asserted, key=str), RULES)
    closure = begun(sorted(asserted, key=str), RULES)
    for add, picks in [([], []), *script]:
        ordered = sorted(asserted, key=str)
        remove = {ordered[i % len(ordered)] for i in picks if ordered} - set(add)
        closure.stage(add=add, remove=remove).apply()
        asserted = (asserted - remove) | set(add)
        fresh = Closure.build(asserted, [], RULES, IN_BULK)
        assert set(closure.inferred()) == set(fresh.inferred())
        assert clashes(closure) == clashes(fresh)


def test_the_ontology_is_derived_once_and_equals_a_rebuild(derived):
    rules = [path.read_text("utf-8") for path in ontology.rules()]

    def read() -> list:
        quads = [
            q for path in ontology.modules() for q in ox.parse(path=path, rename_blank_nodes=True)
        ]
        return [(q.subject, q.predicate, q.object) for q in quads]

    begun(read(), rules, Config())
    facts = read()
    second = begun(facts, rules, Config())
    assert len(derived) == 1
    missing, surplus = second.compare(Closure.build(facts, [], rules).inferred())
    assert not len(missing)
    assert not surplus


def test_knowledge_bases_with_other_bases_share_what_follows_from_the_ontology(derived):
    for base in ("https://one.example/kb/", "https://two.example/kb/", "https://two.example/kb/"):
        rtask.open(":memory:", base=base).close()
    nothing, ontology_size = derived
    assert nothing == 0
    assert ontology_size > 5_000


OWNED = """
:number a owl:InverseFunctionalProperty .
<urn:a/robot/ann/x> :number 1 .
<urn:a/robot/bob/y> :number 1 .
"""


def test_owners_of_names_are_asked_in_each_knowledge_base(derived):
    is_one = triple("<urn:a/robot/ann/x> owl:sameAs <urn:a/robot/bob/y>")
    for base, expected in (("urn:b/", True), ("urn:a/", False), ("urn:b/", True)):
        closure = begun(triples(OWNED), config=replace(IN_BULK, owner=Minters(base)))
        assert closure.contains(is_one) == expected, base
    assert len(derived) == 3


def test_what_a_rule_says_of_an_owned_name_is_derived_where_it_is_owned(derived):
    rule = "CONSTRUCT { <urn:a/robot/ann/x> <urn:t:sees> ?x } WHERE { ?x a <urn:t:Mug> }"
    for base in ("urn:b/", "urn:a/", "urn:b/"):
        begun(triples(WORLD), [rule], replace(IN_BULK, owner=Minters(base)))
    assert len(derived) == 2
