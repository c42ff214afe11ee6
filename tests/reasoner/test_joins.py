"""What too much follows from, or too much work, is refused: by counting and not by the clock."""

from __future__ import annotations

import pytest

import rtask
from reasoner import ChangeBudget, Closure, ClosureTooLargeError, Config, LabelledRule
from reasoner.facts import arrays
from rtask.errors import TooLargeError
from rtask.rdf.terms import Literal, NamedNode
from tests.reasoner.ttl import triples

HEAD = "PREFIX ex: <urn:ex:> CONSTRUCT { ?a ex:bad ?c } WHERE "
NEVER = "FILTER(?x = ?y && ?y = ?z && ?x != ?z)"
WORKLIST = HEAD + (
    "{ ?a ex:r ?c . ?a ex:p ?h . ?x ex:p ?h . ?y ex:p ?h . ?z ex:p ?h " + NEVER + " }"
)
NEGATED = HEAD + (
    "{ ?a ex:p ?h . ?c ex:r ?a "
    "FILTER NOT EXISTS { ?x ex:p ?h . ?y ex:p ?h . ?z ex:p ?h " + NEVER + " } }"
)
COLUMNS = (
    "PREFIX ex: <urn:ex:> CONSTRUCT { ?a ex:p ?h } "
    "WHERE { ?a ex:p ?h . ?b ex:p ?h . ?c ex:p ?h . ?d ex:p ?h }"
)


def node(name: str) -> NamedNode:
    return NamedNode(f"urn:ex:{name}")


def hub(count: int) -> list[tuple[NamedNode, NamedNode, NamedNode]]:
    """Return facts that all lead to one thing, so that joins through it are large."""
    return [(node(f"a{k}"), node("p"), node("hub")) for k in range(count)]


def tiny(rule: str, name: str = "wide") -> Closure:
    return Closure.build((), (), rules=[LabelledRule(rule, name)], config=Config(max_joins=50_000))


LINKS = [(node("a1"), node("r"), node("a0"))]


@pytest.mark.parametrize("rule", [WORKLIST, NEGATED], ids=["filter", "not exists"])
def test_joins_fact_by_fact_are_bounded_and_the_error_names_the_rule(rule: str) -> None:
    closure = tiny(rule)
    before = len(list(closure.inferred()))
    with pytest.raises(ClosureTooLargeError, match=r"the rule wide tries more than \d+ comb"):
        closure.stage(add=[*hub(300), *LINKS])
    assert len(list(closure.inferred())) == before
    closure.stage(add=[*hub(20), *LINKS]).apply()


def test_joins_of_whole_relations_are_bounded() -> None:
    closure = tiny(COLUMNS)
    with pytest.raises(ClosureTooLargeError, match="the rule wide"):
        closure.stage(add=hub(3000))


def test_a_rule_of_many_facts_and_few_combinations_is_not_refused() -> None:
    narrow = HEAD + "{ ?a ex:p ?h . ?c ex:q ?a FILTER(?a != ?c) }"
    closure = Closure.build((), (), rules=[narrow], config=Config(max_joins=1_000))
    facts = [(node(f"a{k}"), node("p"), node(f"h{k}")) for k in range(3000)]
    facts += [(node(f"c{k}"), node("q"), node(f"a{k}")) for k in range(3000)]
    closure.stage(add=facts).apply()


def test_a_new_fact_is_joined_with_what_it_names_before_a_common_value() -> None:
    """Else each grasp that is stored goes through all attempts that ever succeeded."""
    lifted = (
        "PREFIX ex: <urn:ex:> CONSTRUCT { ?thing ex:liftedBy ?a } WHERE "
        "{ ?o ex:success true . ?a ex:outcome ?o ; ex:executes ?g . ?g ex:of ?thing }"
    )
    facts = []
    for k in range(3000):
        facts.append((node(f"o{k}"), node("success"), Literal(True)))
        facts.append((node(f"a{k}"), node("outcome"), node(f"o{k}")))
        facts.append((node(f"a{k}"), node("executes"), node(f"g{k}")))
    closure = Closure.build((), facts, rules=[lifted], config=Config(max_joins=0))
    closure.stage(add=[(node(f"g{k}"), node("of"), node("mug")) for k in range(100)]).apply()
    assert len(closure.match(node("mug"), node("liftedBy"))) == 100


def test_what_was_accepted_in_parts_is_accepted_again_as_a_whole() -> None:
    """As on opening, when a saved closure follows all commits since as one change."""
    pairs = HEAD + "{ ?a ex:p ?h . ?c ex:p ?h FILTER(?a = ?c && ?a != ?c) }"
    closure = tiny(pairs)
    with pytest.raises(ClosureTooLargeError):
        closure.stage(add=hub(400))
    closure.stage(add=hub(400), accepted=True).apply()
    assert closure.size == 400


def store(kb, facts) -> None:
    with kb.transaction() as tx:
        for subject, predicate, value in facts:
            tx.add(subject, predicate, value)


def test_a_commit_that_a_rule_makes_too_much_of_is_refused_whole() -> None:
    with rtask.open(":memory:", rules=[rtask.Rule("every trio", WORKLIST)]) as kb:
        before = kb.seq
        with pytest.raises(TooLargeError, match="the rule every trio"):
            store(kb, [*hub(300), *LINKS])
        assert kb.seq == before
        assert not kb.match(None, node("p"))
        store(kb, hub(10))
        assert kb.seq == before + 1


SMALL = ChangeBudget(derived=2_000, firings=100_000)
CLASSES = " ".join(f":c{i} a owl:Class ; rdfs:subClassOf :c{i // 2} ." for i in range(1, 200))
MEMBERS = " ".join(f":c{i}" for i in range(2_000))
CASES = {
    "prp-symp": "rdfs:subClassOf a owl:SymmetricProperty .",
    "prp-trp": ":p a owl:TransitiveProperty . "
    + " ".join(f":x{i} :p :x{i + 1} ." for i in range(150)),
    "prp-spo2": ":q owl:propertyChainAxiom (:p :p) . "
    + " ".join(f":x{i} :p :h . :h :p :y{i} ." for i in range(60)),
    "prp-key": ":K owl:hasKey (:k) . " + " ".join(f":x{i} a :K ; :k 1 ." for i in range(300)),
    "cax-adc": f"[] a owl:AllDisjointClasses ; owl:members ({MEMBERS}) .",
    "scm-uni": f":U owl:unionOf ({MEMBERS}) .",
    "many ranges": " ".join(f":p rdfs:range :r{i} ." for i in range(1_600)),
}


@pytest.fixture(scope="module")
def closure() -> Closure:
    return Closure.build(triples(CLASSES), triples(":x a :c150 . :x :p :y ."))


@pytest.mark.parametrize("name", CASES)
def test_a_change_from_which_too_much_follows_is_refused_and_changes_nothing(
    closure: Closure, name: str
) -> None:
    before, added = closure.digest(), triples(CASES[name])
    with pytest.raises(ClosureTooLargeError) as refused:
        closure.stage(add=added, budget=SMALL)
    assert str(refused.value.limit) in str(refused.value)
    if not name.startswith("many"):
        assert refused.value.rule == name
        assert refused.value.statement in added
    assert closure.digest() == before
    closure.stage(add=triples(":z a :c150 ."), budget=SMALL).discard()


def test_whole_relations_are_bounded_as_single_facts_are(closure: Closure) -> None:
    """From two thousand statements on, and one in eight, everything is derived again."""
    ring = " ".join(f":x{i} :p :x{(i + 1) % 2_500} ." for i in range(2_500))
    with pytest.raises(ClosureTooLargeError) as refused:
        closure.stage(add=triples(":p a owl:TransitiveProperty . " + ring), budget=SMALL)
    assert (refused.value.rule, refused.value.limit) == ("prp-trp", SMALL.derived)


def test_the_count_is_of_what_the_change_causes_however_much_was_derived_before() -> None:
    text = ":p a owl:TransitiveProperty . " + " ".join(f":x{i} :p :x{i + 1} ." for i in range(80))
    closure = Closure.build(triples(text), [])
    assert len(list(closure.inferred())) > SMALL.derived
    closure.stage(add=triples(":x80 :p :x81 ."), budget=SMALL).apply()
    with pytest.raises(ClosureTooLargeError):
        closure.stage(add=triples(":x81 :p :x0 ."), budget=SMALL)


@pytest.mark.parametrize("name", ["prp-trp", "scm-uni"])
def test_the_watch_can_end_the_work_at_any_time(closure: Closure, name: str) -> None:
    class StopError(Exception):
        pass

    calls = 0

    def watch() -> None:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise StopError

    before = closure.digest()
    with pytest.raises(StopError):
        closure.stage(add=triples(CASES[name]), budget=ChangeBudget(10**6, 10**9, watch))
    assert calls == 3
    assert closure.digest() == before


def test_a_body_of_more_atoms_than_a_rule_may_have_is_a_problem_of_its_axiom(
    closure: Closure,
) -> None:
    links = " ".join(f":l{i}" for i in range(300))
    staged = closure.stage(add=triples(f":p owl:propertyChainAxiom ({links}) ."))
    staged.apply()
    assert any("300 members, more than 256" in str(p) for p in closure.stats()["problems"])


def test_joins_done_in_parts_give_what_one_join_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    facts = triples(
        ":q owl:propertyChainAxiom (:p :p) . :q rdfs:subPropertyOf :r . "
        + " ".join(f":x{i} :p :x{i * 7 % 300} ." for i in range(300))
    )
    whole = Closure.build(facts, []).digest()
    monkeypatch.setattr(arrays, "MAX_ROWS", 50)
    assert Closure.build(facts, []).digest() == whole


def test_what_is_retracted_is_looked_for_from_the_thing_and_not_from_a_common_value() -> None:
    """Else each attempt that is withdrawn goes through those of all hands of one payload."""
    bound = (
        "PREFIX ex: <urn:ex:> CONSTRUCT { ?thing ex:bound ?load } WHERE "
        "{ ?a ex:executes ?g ; ex:activates ?e . ?e ex:payload ?load . ?g ex:of ?thing }"
    )
    facts = []
    for k in range(3000):
        facts.append((node(f"h{k}"), node("payload"), Literal(0.3)))
        facts.append((node(f"a{k}"), node("activates"), node(f"h{k}")))
        facts.append((node(f"a{k}"), node("executes"), node(f"g{k // 2}")))
        facts.append((node(f"g{k // 2}"), node("of"), node(f"t{k // 2}")))
    closure = Closure.build((), facts, rules=[bound])
    before, few = set(closure.inferred()), ChangeBudget(derived=10, firings=1_000)
    closure.stage(remove=[(node("a0"), node("executes"), node("g0"))], budget=few).apply()
    assert set(closure.inferred()) == before
    closure.stage(remove=[(node("a1"), node("executes"), node("g0"))], budget=few).apply()
    assert len(before - set(closure.inferred())) == 1
