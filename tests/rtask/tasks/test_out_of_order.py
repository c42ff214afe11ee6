"""Hands out of order and shut places: avoided, explained, and used again once that is over."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator

import numpy as np
import pytest

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import iri
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor
from simulate.tasks.lab import read_lab
from tests.rtask.tasks.conftest import BASE, CUP, LAB, LEFT, NAO, PANDA, RIGHT

pytestmark = pytest.mark.slow


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(LAB)
        yield graph


def _state(kb: KnowledgeBase, subject: str, kind: str) -> None:
    kb.update(f"{PREFIXES} INSERT DATA {{ <{subject}> a rt:{kind} }}")


def _mend(kb: KnowledgeBase, text: str) -> None:
    """Run the command that a refusal names."""
    [command] = re.findall(r"rtask update '[^']*'", text)
    kb.update(shlex.split(command)[2])


def test_what_a_robot_out_of_order_would_do_another_one_does(kb: KnowledgeBase) -> None:
    kb.update(f"{PREFIXES} INSERT DATA {{ <{NAO}> rt:reaches <{RIGHT}> }}")
    goal = "every pen into the right box"
    [first] = {robot for step in kb.tasks.plan(goal).steps for robot in step.robots}
    other = NAO if first == PANDA else PANDA
    _state(kb, f"{first}/hand", "OutOfOrder")
    plan = kb.tasks.plan(goal)
    assert plan.is_complete
    assert {robot for step in plan.steps for robot in step.robots} == {other}
    _state(kb, other, "OutOfOrder")
    [refusal] = kb.tasks.plan(goal).refusals
    assert "is out of order" in refusal.text
    assert set(refusal.by_robot) == {NAO, PANDA}
    assert all("hand is out of order" in text for text in refusal.by_robot.values())
    _mend(kb, refusal.text)
    assert kb.tasks.plan(goal).is_complete


def test_a_hand_is_out_of_order_with_its_robot_and_the_proof_says_so(kb: KnowledgeBase) -> None:
    _state(kb, NAO, "OutOfOrder")
    hand = iri(f"{NAO}/hand")
    assert kb.query(f"{PREFIXES} ASK {{ {hand} a rt:OutOfOrder }}")
    proof = kb.explain(hand, iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type"),
                       RT.OutOfOrder)  # fmt: skip
    assert 'robot/nao-1 "nao-1" a rt:OutOfOrder' in str(proof)


def test_a_shut_place_is_named_as_the_reason_and_used_again_once_open(kb: KnowledgeBase) -> None:
    goal = "every pen into the left box"
    before = [step.text for step in kb.tasks.plan(goal).steps]
    assert before
    _state(kb, LEFT, "Shut")
    plan = kb.tasks.plan(goal)
    [refusal] = plan.refusals
    assert not plan.steps
    assert "were it not that left box is shut" in refusal.text
    _mend(kb, refusal.text)
    assert [step.text for step in kb.tasks.plan(goal).steps] == before


def test_a_robot_takes_the_hand_that_gets_to_a_place(kb: KnowledgeBase) -> None:
    """A place beyond reach of one hand is left to another, and named where there is none."""
    kb.update(f"""{PREFIXES} INSERT DATA {{ <{NAO}> rt:hasEndEffector <{NAO}/other> .
        <{NAO}/other> a rt:Hand ; rt:name 'other hand' ; rt:gripperType 'nao' ;
            rt:minOpening 0.0e0 ; rt:maxOpening 0.05e0 ; rt:maxPayload 0.5e0 .
        <{PANDA}/hand> a rt:OutOfOrder . <{LEFT}> rt:beyondReachOf <{NAO}/hand> }}""")
    goal = "every pen into the left box"
    steps = kb.tasks.plan(goal).steps
    assert steps
    assert {step.arguments["hand"] for step in steps} == {f"{NAO}/other"}
    kb.update(f"{PREFIXES} INSERT DATA {{ <{LEFT}> rt:beyondReachOf <{NAO}/other> }}")
    [refusal] = kb.tasks.plan(goal).refusals
    assert "left box is beyond reach of" in refusal.text
    _mend(kb, refusal.text)
    assert kb.tasks.plan(goal).is_complete


def test_robots_give_up_for_a_shut_place_and_reach_it_once_it_is_open(
    kb: KnowledgeBase,
) -> None:
    with Engine(kb) as engine:
        planner = rtask.connect(engine)
        lab = read_lab(planner.query, np.random.default_rng(3))
        goal = "every cup into the left box"
        planner.call("store_plan", goal=goal)
        _state(kb, LEFT, "Shut")
        lab.shut.add(LEFT)

        def work() -> str:
            robots = {
                robot: Executor(
                    rtask.connect(engine, agent=robot.rpartition("/")[2]), lab.robot(robot)
                )
                for robot in (NAO, PANDA)
            }
            return str(Crew(planner, robots).work()[0].result)

        assert work() == "given_up"
        assert lab.where[CUP] != LEFT
        said = planner.call("plan_goal", goal=goal)["refusals"][0]["text"]
        lab.shut.discard(LEFT)
        _mend(kb, said)
        planner.call("store_plan", goal=goal)
        assert work() == "reached"
        assert lab.where[CUP] == LEFT
