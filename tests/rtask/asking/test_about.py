"""What something is: the card of what a question names, and of the graph, before any question."""

from __future__ import annotations

import subprocess
import sys

import pytest

import ontology
import rtask
from rtask.asking.cards import Use, card_of
from rtask.asking.questions import answer
from rtask.asking.questions.about import asks_about
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import RDF_TYPE, prologue


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("What is nao?", "Nao is a"),
        ("tell me about the mug", "Mug is a drinking vessel"),
        ("Show me nao", "has end effector"),
        ("What is a mug?", "(rt:Mug, a class)"),
        ("What is a carton?", "(rt:Box, a class)"),
        ("What does grasp width mean?", "Grasp width (rt:graspWidth, a property): "),
        ("what does rt:graspWidth mean", "Grasp width (rt:graspWidth, a property): "),
        ("define hidden cause", "(rt:HiddenCause, a class): A property of an object"),
    ],
)
def test_what_something_is_is_told_by_its_name(kb: KnowledgeBase, text: str, said: str) -> None:
    found = answer(kb, text)
    assert found.key == "about"
    assert said in found.sentence
    assert len(kb.select(found.sparql)) == len(found.rows) > 0


@pytest.mark.parametrize("text", ["What can I ask?", "help", "What is this?", "what do you know"])
def test_who_asks_what_can_be_asked_is_told_what_there_is(kb: KnowledgeBase, text: str) -> None:
    found = answer(kb, text)
    assert found.key == "overview"
    counted = {row.value("what"): row.value("count") for row in found.rows}
    cora = "PREFIX cora: <http://purl.org/ieee1872-owl/cora-bare#> "
    robots = kb.select(cora + "SELECT DISTINCT ?r { ?r a cora:Robot }")
    assert counted["robots"] == len(robots)
    assert f"{len(robots)} robots" in found.sentence
    for example in ("Which robots are there?", "What can each robot grasp?",
                    "Where is each object?"):  # fmt: skip
        assert example in found.sentence
        assert answer(kb, example).is_understood


@pytest.mark.parametrize("module", ["rtask.asking.cards", "rtask.asking.questions"])
def test_cards_and_questions_are_imported_in_either_order(module: str) -> None:
    subprocess.run([sys.executable, "-c", f"import {module}"], check=True, timeout=120)


def test_several_things_of_one_name_are_listed(kb: KnowledgeBase) -> None:
    prefix = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
    facts = (
        '{ <urn:x/1> a rt:Tray ; rt:name "blue tray" . <urn:x/2> a rt:Box ; rt:name "blue tray" }'
    )
    kb.update(f"{prefix} INSERT DATA {facts}")
    try:
        found = answer(kb, "What is the blue tray?")
    finally:  # the graph is that of other tests, too
        kb.update(f"{prefix} DELETE DATA {facts}")
    assert found.sentence.startswith("2 things are called 'blue tray': ")
    assert "<urn:x/1> is tray" in found.sentence
    assert "<urn:x/2> is" in found.sentence


def test_what_nothing_is_called_gets_no_other_answer(kb: KnowledgeBase) -> None:
    found = answer(kb, "What is a flux capacitor?")
    assert not found.is_understood
    assert "Nothing in the graph is called 'flux capacitor'" in found.sentence


@pytest.mark.parametrize(
    "text",
    ["What is there to drink from?", "Where is the mug?", "What is the mug's latest pose?",
     "What are the proven grasps of the mug, and who held it?"],
)  # fmt: skip
def test_other_questions_are_not_about_one_thing(kb: KnowledgeBase, text: str) -> None:
    noun = asks_about(text)
    assert noun is None or answer(kb, text).key != "about"


def test_uses_on_reifiers_are_uses_of_a_property() -> None:
    """A confidence is stated of a statement: no thing in the graph has one."""
    with rtask.open(":memory:", base="urn:lab/") as kb:
        with kb.transaction(agent="nao") as change:
            for number in (1, 2):
                thing = f"urn:mug/{number}"
                change.add(thing, RDF_TYPE, RT.Mug, confidence=0.5)
            change.add("urn:mug/1", RT.name, "red", confidence=0.9)
            change.add("urn:mug/2", RT.name, "blue")
        card = card_of(kb.select, RT.confidence)
        rows = kb.select(prologue(ontology.PREFIXES) + card.example)
        found = answer(kb, "What does confidence mean?")
        named = card_of(kb.select, RT.name)
    assert (card.count, card.on_statements, card.uses) == (3, 3, ())
    assert card.annotates == (Use("rdf:type", 2), Use("rt:name", 1))
    assert "3 statements, 3 of them about other statements" in card.lines()
    assert sorted(float(str(row.value("what"))) for row in rows) == [0.5, 0.5, 0.9]
    assert "3 statements, 3 of them about statements with rdf:type, rt:name" in found.sentence
    assert (named.on_statements, named.annotates) == (0, ())
