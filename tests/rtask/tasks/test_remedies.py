"""What an impossible goal says would mend it, carried out in the graph and planned again."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

import rtask
from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.tasks.queue.claiming import claim_step
from tests.rtask.tasks.conftest import BASE, LAB, LEFT, NAO, PANDA, PEN, RIGHT, TABLE, placed, robot

_THINGS = f"""
  <{BASE}object/4> a rt:Box ; rt:objectId "lab/4" ; rt:name "crate" ; rt:graspWidth 0.12e0 ;
    rt:mass 1.0e0 . {placed(4, TABLE)}
  <{BASE}object/5> a rt:Box ; rt:objectId "lab/5" ; rt:name "anvil" ; rt:graspWidth 0.06e0 ;
    rt:mass 9.0e0 . {placed(5, TABLE)}
  <{BASE}object/6> a rt:Bottle ; rt:objectId "lab/6" ; rt:name "vase" . {placed(6, TABLE)}
  <{BASE}robot/bare> a cora:Robot ; rt:name "bare" ."""


def insert(kb: KnowledgeBase, statements: str) -> None:
    kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {statements} }} }}")


@pytest.fixture
def lab() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(LAB)
        insert(graph, _THINGS)
        yield graph


@pytest.mark.parametrize(
    ("thing", "said", "opening", "payload"),
    [("crate", "a hand that opens beyond 120 mm", 0.13, 3.0),
     ("anvil", "a hand that lifts 9.00 kg", 0.08, 9.5)],
)  # fmt: skip
def test_a_robot_with_the_hand_that_is_asked_for_reaches_the_goal(
    lab: KnowledgeBase, thing: str, said: str, opening: float, payload: float
) -> None:
    goal = f"{thing} to the right box"
    (refusal,) = lab.tasks.plan(goal).refusals
    assert said in refusal.text
    strong = f"{BASE}robot/strong"
    insert(lab, robot(strong, "strong", "ParallelJawGripper", opening, payload)
           + f" <{strong}> rt:reaches <{TABLE}>, <{RIGHT}> .")  # fmt: skip
    assert lab.tasks.plan(goal).is_complete


def test_measures_that_nobody_knows_are_named_together(lab: KnowledgeBase) -> None:
    (refusal,) = lab.tasks.plan("vase to the right box").refusals
    assert "state rt:graspWidth and rt:mass of its product" in refusal.text
    insert(lab, f"<{BASE}object/6> rt:graspWidth 0.05e0 ; rt:mass 0.3e0 .")
    assert lab.tasks.plan("vase to the right box").is_complete


def test_whoever_described_a_place_is_the_first_of_whom_it_is_asked_whether_it_reaches_it(
    lab: KnowledgeBase,
) -> None:
    shelf = f"{BASE}place/shelf"
    text = f'<{shelf}> a rt:SupportSurface ; rt:name "shelf" .'
    lab.update(f"{PREFIXES} INSERT DATA {{ {text} }}", agent="panda-1")
    (refusal,) = lab.tasks.plan("pen to the shelf").refusals
    assert refusal.missing == ((PANDA, RT.reaches.value, shelf),)
    assumed = lab.tasks.plan("pen to the shelf", assume_reach=True)
    assert assumed.assumptions == ("panda-1 reaches shelf",)


def test_no_robot_is_said_to_reach_the_hand_of_another(lab: KnowledgeBase) -> None:
    (refusal,) = lab.tasks.plan("jug to nao-1").refusals
    assert "70 mm wide, and no hand of nao-1 opens beyond 50 mm" in refusal.text
    assert "reaches nao-1 hand" not in refusal.text
    assert "a robot there" not in refusal.text, "the goal is about this hand"


def test_of_a_robot_without_a_stated_hand_that_is_the_reason(lab: KnowledgeBase) -> None:
    (refusal,) = lab.tasks.plan("jug to the left box").refusals
    assert refusal.by_robot[f"{BASE}robot/bare"].startswith("no hand of it is stated")
    (update,) = re.findall(r"rtask update '([^']*)'", refusal.text)
    lab.update(update)
    assert lab.tasks.plan("jug to the left box").is_complete
    assert LEFT in update


def test_a_deadline_that_is_too_soon_is_said_before_anything_is_stored(lab: KnowledgeBase) -> None:
    assert "too soon" in lab.tasks.plan("pen to the right box within 1 second").text
    assert "too soon" not in lab.tasks.plan("pen to the right box within 2 hours").text


def test_a_duration_that_nobody_stated_is_said_to_be_assumed(lab: KnowledgeBase) -> None:
    steps = lab.tasks.plan("pen to the right box").steps
    assert "s is what is stated of such tasks" in steps[0].why


def test_of_what_no_action_brings_about_that_is_the_reason(lab: KnowledgeBase) -> None:
    goal = '?t <urn:weighedBy> ?r WHERE { ?t rt:exemplarOf/rt:name "pen" . ?r rt:name "nao-1" }'
    (refusal,) = lab.tasks.plan(goal).refusals
    assert refusal.text.startswith("no action that the graph knows of brings this about")


@pytest.mark.parametrize(
    ("lost", "given", "said"),
    [
        ("maxPayload", "rt:maxPayload 0.2e0", "state rt:maxPayload of that hand"),
        ("maxOpening", "rt:maxOpening 0.05e0", "state rt:maxOpening of that hand"),
        ("minOpening", "rt:minOpening 0.0e0", "state rt:minOpening of that hand"),
    ],
)
def test_a_measure_of_a_hand_that_nobody_has_stated_is_asked_for(
    lab: KnowledgeBase, lost: str, given: str, said: str
) -> None:
    lab.update(f"{PREFIXES} DELETE WHERE {{ GRAPH ?g {{ <{NAO}/hand> rt:{lost} ?x }} }}")
    (refusal,) = lab.tasks.plan("nao-1 should put the pen into the left box").refusals
    assert said in refusal.text
    insert(lab, f"<{NAO}/hand> {given} .")
    assert lab.tasks.plan("nao-1 should put the pen into the left box").is_complete


def test_of_what_is_too_thin_or_needs_both_hands_of_a_robot_that_is_said(
    lab: KnowledgeBase,
) -> None:
    insert(
        lab,
        f"""<{BASE}object/7> a rt:Pen ; rt:objectId "lab/7" ; rt:name "needle" ;
        rt:graspWidth 0.001e0 ; rt:mass 0.001e0 . {placed(7, TABLE)}
        <{NAO}> rt:hasEndEffector <{NAO}/wide> . <{NAO}/wide> a rt:Hand ; rt:name "wide hand" ;
        rt:gripperType "wide" ; rt:minOpening 5.0e-3 ; rt:maxOpening 0.09e0 ; rt:maxPayload 0.5e0 .
        <{NAO}/strong> a rt:Hand ; rt:name "strong hand" ; rt:gripperType "strong" ;
        rt:minOpening 5.0e-3 ; rt:maxOpening 0.05e0 ; rt:maxPayload 2.0e0 .
        <{NAO}> rt:hasEndEffector <{NAO}/strong> .""",
    )
    (refusal,) = lab.tasks.plan("nao-1 should put the jug into the left box").refusals
    assert (
        "no one hand of nao-1 is known to grasp what is 70 mm wide and weighs 1.00 kg"
        in refusal.text
    )
    lab.update(
        f"{PREFIXES} DELETE WHERE {{ GRAPH ?g {{ <{NAO}> rt:hasEndEffector <{NAO}/hand> }} }}"
    )
    (refusal,) = lab.tasks.plan("nao-1 should put the needle into the left box").refusals
    assert "needle is 1.0 mm wide, and no hand of nao-1 closes below 5.0 mm" in refusal.text


def test_what_is_over_is_withdrawn_from_all_graphs_that_say_it(lab: KnowledgeBase) -> None:
    insert(lab, f"<{LEFT}> a rt:Shut .")
    lab.update(
        f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/own> {{ <{NAO}/hand> a rt:OutOfOrder }} }}"
    )
    (refusal,) = lab.tasks.plan("pen to the left box").refusals
    assert "nao-1 hand is out of order and left box is shut" in refusal.text
    (update,) = re.findall(r"rtask update '([^']*)'", refusal.text)
    lab.update(update)
    assert lab.tasks.plan("pen to the left box").is_complete


def test_what_another_robot_holds_is_said_to_be_in_its_hand(lab: KnowledgeBase) -> None:
    at = f"<{BASE}placement/3b>"
    insert(
        lab,
        f"""{at} a rt:Placement ; rt:placementOf <{PEN}> ; rt:placedIn <{NAO}/hand> ;
        time:hasBeginning {at[:-1]}/begin> . {at[:-1]}/begin> time:inXSDDateTimeStamp
        "2026-02-01T10:00:00Z"^^xsd:dateTimeStamp .""",
    )
    (refusal,) = lab.tasks.plan("panda-1 should put the pen into the right box").refusals
    assert refusal.text.startswith("it is in nao-1 hand, which would have to put it down first")
    assert lab.tasks.plan("the pen into the right box").is_complete, "once it is left out who"


def test_what_another_plan_has_claimed_is_said_and_waited_for(lab: KnowledgeBase) -> None:
    lab.tasks.store(lab.tasks.plan("pen to the left box"))
    assert len(lab.tasks.plan("pen to the right box").understood) == 1, "nobody is at it yet"
    claim_step(lab, NAO, Access("nao-1", "robot"))
    plan = lab.tasks.plan("pen to the right box")
    assert plan.understood[1].startswith("nao-1 has pen for another step now: steps with it begin")
    lab.tasks.store(plan)
    waits = claim_step(lab, PANDA, Access("panda-1", "robot")).waits
    assert waits[0].why == "nao-1 has the thing"


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ("the pen into the attic", r"'attic' means nothing.*places are left box, right box, table"),
        ("the pen into the right bax", r"places are right box, left box, table"),
        ("red cup to bare", r"^no hand of bare is stated \(rt:hasEndEffector\)"),
        ("the pen from the right box to the left box", r"no pen from right box, only at table;"),
        ("the pen into the left box of panda-1", r"^that panda-1 reaches left box is not known"),
        ("the pen on the table and the pen in the left box", r": pen would have to be at two"),
        ("nao-1's pens on the table", r'"nao-1\'s" at the beginning is not.*whose a thing is'),
    ],
)
def test_what_is_wrong_with_a_goal_is_said_by_names(
    lab: KnowledgeBase, goal: str, said: str
) -> None:
    with pytest.raises(RtaskError, match=said) as caught:
        lab.tasks.plan(goal)
    assert not re.search(r"SELECT|https?:|''", str(caught.value)), "in words, for people"
