"""Goals that say who is to do it: planned for that robot alone, or refused with what it lacks."""

from __future__ import annotations

import datetime as dt

import pytest

from rtask.errors import RtaskError, UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.tasks.goals import read_aims
from rtask.tasks.language.times import deadline_in
from rtask.tasks.limits import read_limits
from tests.rtask.tasks.conftest import LEFT, NAO, PANDA, PEN, TABLE


@pytest.mark.parametrize(
    ("goal", "robot", "name"),
    [
        ("nao-1 should put the pen into the left box", NAO, "nao-1"),
        ("have the panda put the pen into the right box", PANDA, "panda-1"),
        ("please ask nao-1 to take the pen and put it into the left box", NAO, "nao-1"),
        ("panda-1, please pick up the pen", PANDA, "panda-1"),
    ],
)
def test_the_robot_that_is_named_does_all_of_it(
    kb: KnowledgeBase, goal: str, robot: str, name: str
) -> None:
    plan = kb.tasks.plan(goal)
    assert plan.is_complete
    assert f"by {name} alone" in plan.understood
    assert {item for step in plan.steps for item in step.robots} == {robot}


def test_what_the_robot_cannot_do_alone_is_refused_though_others_could(kb: KnowledgeBase) -> None:
    assert kb.tasks.plan("the pen into the right box").is_complete
    (refusal,) = kb.tasks.plan("nao-1 should put the pen into the right box").refusals
    assert "it is not known that nao-1 reaches right box" in refusal.text
    assert refusal.text.endswith("let other robots help: leave out who is to do it")
    assert list(refusal.by_robot) == [NAO]
    (refusal,) = kb.tasks.plan("nao-1 should put the jug into the left box").refusals
    assert "leave out who" not in refusal.text, "nobody else reaches the left box"


def test_what_is_planned_again_later_is_for_the_same_robot(kb: KnowledgeBase) -> None:
    plan = kb.tasks.plan("panda-1 should put a pen from the table into the right box")
    assert read_limits(plan.settled).by == (PANDA,)
    again = kb.tasks.plan(plan.settled)
    assert (again.digest, again.goal) == (plan.digest, plan.goal)
    assert "by panda-1 alone" in again.understood


def test_a_goal_in_json_says_who_is_to_do_it(kb: KnowledgeBase) -> None:
    goal = {"achieve": f"<{PEN}> rt:locatedOn <{LEFT}>", "by": [PANDA]}
    assert read_aims(goal) is not None
    assert not kb.tasks.plan(goal).is_complete, "panda-1 does not reach the left box"
    assert kb.tasks.plan(goal | {"by": [NAO]}).is_complete
    with pytest.raises(UnknownTermError, match="the graph has no robot"):
        kb.tasks.plan(goal | {"by": [TABLE]})
    with pytest.raises(UsageError, match='"by" of a goal'):
        kb.tasks.plan(goal | {"by": NAO})


@pytest.mark.parametrize(
    "goal",
    [
        "nao-1 should not put the pen into the left box",
        "nao-1 should put the pen into the left box and panda-1 the cup onto the table",
        "nao-1 should put the pen into the left box. The cup goes onto the table",
        "nao-1 should put the pen into the left box and the cup should go onto the table",
        "nao-1 should put my pen into the left box",
        "use the panda for the pens",
    ],
)
def test_whose_each_part_is_has_to_be_clear(kb: KnowledgeBase, goal: str) -> None:
    with pytest.raises(RtaskError):
        kb.tasks.plan(goal)


def test_a_deadline_that_is_over_is_refused() -> None:
    now = dt.datetime(2026, 1, 1, 10, tzinfo=dt.UTC)
    with pytest.raises(UsageError, match="'by 2026-01-01 09:00 UTC' is over already"):
        deadline_in("the pen into the left box by 2026-01-01 09:00 UTC", now)
