"""Questions for a total are answered with one number of the whole graph."""

from __future__ import annotations

from urllib.parse import unquote

import pytest

import ontology
import rtask
from rtask.asking.questions import answer
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import prologue
from rtask.sparql.syntax import check_query

_LAB = f"""PREFIX rt: <{ontology.NS}>
INSERT DATA {{
  <urn:5> a rt:ManipulableObject ; rt:name "carton-5" .
  <urn:6> a rt:ManipulableObject ; rt:name "carton-6" .
  <urn:5/a> a rt:ManipulableObject, rt:Exemplar ; rt:exemplarOf <urn:5> .
  <urn:a1> a rt:GraspAttempt ; rt:hasOutcome <urn:o1> . <urn:o1> rt:success true .
  <urn:a2> a rt:GraspAttempt ; rt:hasOutcome <urn:o2> . <urn:o2> rt:success false .
  <urn:a3> a rt:GraspAttempt ; rt:hasOutcome <urn:o3> . <urn:o3> rt:success false .
  <urn:a4> a rt:GraspAttempt .
  <urn:t> rt:handles <urn:5> ; rt:through <urn:a1> .
}}"""


@pytest.mark.parametrize(
    ("text", "cls"),
    [
        ("How many attempts were there?", "rt:GraspAttempt"),
        ("how many grasp attempts have been made in total", "rt:GraspAttempt"),
        ("number of attempts", "rt:GraspAttempt"),
        ("How many objects are there?", "rt:ManipulableObject"),
        ("How many objects do you know?", "rt:ManipulableObject"),
        ("how many robots are there?", "cora:Robot"),
        ("What is the number of robots?", "cora:Robot"),
        ("How many grasps are there in the graph?", "rt:GraspConfiguration"),
        ("How many tasks are known so far?", "rt:Task"),
    ],
)
def test_a_total_counts_all_of_a_sort(kb: KnowledgeBase, text: str, cls: str) -> None:
    found = answer(kb, text)
    query = f"SELECT DISTINCT ?s {{ ?s a {cls} FILTER NOT EXISTS {{ ?s a rt:Exemplar }} }}"
    all_of_it = len(kb.select(prologue(ontology.PREFIXES) + query))
    assert all_of_it > 1
    assert found.count == all_of_it
    assert found.sentence.startswith(f"{all_of_it} ")
    assert found.is_understood
    check_query(found.sparql)


def test_attempts_without_a_task_or_an_outcome_are_attempts() -> None:
    with rtask.open(":memory:", reason=False) as kb:
        kb.update(_LAB)
        tried = answer(kb, "How many attempts were there?")
        objects = answer(kb, "How many objects are there?")
        grasps = answer(kb, "How many grasps are there?")
    assert tried.sentence == (
        "4 attempts to grasp are known: 1 held, 2 failed, of 1 the outcome is not known."
    )
    assert objects.count == 2
    assert objects.sentence.startswith("2 objects are known, and 1 exemplar of them")
    assert grasps.sentence == "No grasp is known, which does not mean that there is none."
    assert grasps.count == 0


@pytest.mark.parametrize(
    "text",
    [
        "How many attempts did nao need?", "How many attempts were needed for the mug?",
        "How many robots can hold the mug?", "How many attempts of each robot held?",
        "How many objects have never been held?", "how many grasps does the mug have?",
        "how many mugs are there?", "How many attempts failed?",
    ],
)  # fmt: skip
def test_a_part_is_not_answered_with_the_total(kb: KnowledgeBase, text: str) -> None:
    found = answer(kb, text)
    assert found.key != "total"
    assert " known: " not in found.sentence


@pytest.mark.parametrize(
    ("text", "count", "words"),
    [
        ("How many attempts for carton-5?", 1, "1 attempt to grasp at carton-5 is known: 1 held"),
        ("How many attempts for carton-6?", 0, "which does not mean that there is none"),
    ],
)
def test_attempts_at_a_thing_are_counted_not_those_until_it_held(
    text: str, count: int, words: str
) -> None:
    with rtask.open(":memory:") as lab:
        lab.update(_LAB)
        found = answer(lab, text)
    assert (found.key, found.count) == ("total", count)
    assert words in found.sentence


def test_attempts_by_a_robot_at_a_thing_are_counted_together(kb: KnowledgeBase) -> None:
    found = answer(kb, "how many attempts at the pen by nao?")
    assert (found.count, set(found.filled)) == (3, {"object", "robot"})
    assert answer(kb, "How many attempts did nao need for the pen?").key == "eq11"


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("how many attempts at the pen by nao?", "/feedback?object={}pen&robot={}nao"),
        ("How often did pr2 try the mug, and did it hold?", "/feedback?object={}mug&robot={}pr2"),
        ("how many tasks are there", "/sparql?query="),
        ("What is the mug?", "/resource?iri={}mug"),
        ("What can I ask?", "/sparql?query="),
    ],
)
def test_a_number_in_words_leads_to_just_what_it_counts(
    kb: KnowledgeBase, text: str, address: str
) -> None:
    found = answer(kb, text)
    sample = f"{ontology.BASE}sample/"
    assert len(found.why) == len(found.rows)
    led = {unquote(one) for one in found.why if one}
    assert any(one.startswith(address.format(sample, sample)) for one in led), (found.key, led)
