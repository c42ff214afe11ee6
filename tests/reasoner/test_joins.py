"""A rule that tries too many combinations of facts is refused, by counting and not by the clock."""

from __future__ import annotations

import pytest

import rtask
from reasoner import Closure, ClosureTooLargeError, Config, LabelledRule
from rtask.errors import TooLargeError
from rtask.rdf.terms import Literal, NamedNode

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
