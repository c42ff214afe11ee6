"""A full place takes nothing more, and a hand that is not gentle enough picks nothing up."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator

import pytest

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from tests.rtask.tasks.conftest import BASE, LAB, NAO, PANDA, TABLE


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(LAB)
        yield graph


def state(kb: KnowledgeBase, facts: str) -> None:
    kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {facts} }} }}")


def test_a_full_place_is_refused_with_what_would_do_and_still_gives(kb: KnowledgeBase) -> None:
    state(kb, f"<{TABLE}> a rt:Full")
    plan = kb.tasks.plan("the red cup onto the table")
    assert not plan.is_complete
    text = plan.refusals[0].text
    assert "were it not that table is full: 2 things are there" in text
    assert "take something out (jug, pen)" in text
    assert "say another place (left box, right box)" in text
    assert kb.tasks.plan("the jug into the right box").is_complete, "what is there can be taken"
    update = text.partition("rtask update '")[2].removesuffix("'")
    kb.update(PREFIXES + update)
    assert kb.tasks.plan("the red cup onto the table").is_complete


def test_a_hand_that_is_not_gentle_enough_leaves_it_to_another_one(kb: KnowledgeBase) -> None:
    pen, hand = f"{BASE}object/3", f"{NAO}/hand"
    assert kb.tasks.plan("nao-1 should pick up the pen").is_complete
    state(kb, f"<{pen}> rt:crushingForce 2.0e0")
    assert kb.tasks.plan("nao-1 should pick up the pen").is_complete, "not known never refuses"
    state(kb, f"<{hand}> rt:minForce 5.0e0 . <{PANDA}/hand> rt:minForce 2.0e0")
    plan = kb.tasks.plan("nao-1 should pick up the pen")
    assert "pen bears 2.0 N, and nao-1 hand closes with no less than 5.0 N" in plan.text
    assert "a robot there with a hand that closes with less than 2.0 N would" in plan.text
    assert "DELETE" not in plan.text, "what follows from measures is not withdrawn"
    other = kb.tasks.plan("pick up the pen")
    assert [step.robots for step in other.steps] == [(PANDA,)]


def test_that_a_hand_crushes_it_can_also_be_stated_of_a_product(kb: KnowledgeBase) -> None:
    state(kb, f"<{BASE}object/3> rt:crushedBy <{NAO}/hand>")
    plan = kb.tasks.plan("the pen into the left box")
    assert not plan.is_complete
    assert "nao-1 hand crushes pen" in plan.text


def test_the_proof_of_a_step_has_both_and_how_old_the_place_is(kb: KnowledgeBase) -> None:
    goal = "the pen into the left box"
    because = {support.text for step in kb.tasks.plan(goal).steps for support in step.supports}
    assert {"left box is not full", "pen is not crushed by nao-1 hand"} <= because
    assert "pen located on table (stated, not seen there)" in because
    three_days_ago = (dt.datetime.now(dt.UTC) - dt.timedelta(days=3, hours=1)).isoformat()
    state(kb, f'<{BASE}placement/3> rt:confirmedAt "{three_days_ago}"^^xsd:dateTimeStamp')
    because = {support.text for step in kb.tasks.plan(goal).steps for support in step.supports}
    assert "pen located on table (seen there 3 days ago)" in because
