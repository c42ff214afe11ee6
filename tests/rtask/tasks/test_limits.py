"""Goals that say who is to do it, or may not, and what stays untouched: kept to, or refused."""

from __future__ import annotations

import datetime as dt
import json

import pytest

from rtask.errors import RtaskError, UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.tasks.goals import read_aims
from rtask.tasks.language.times import deadline_in
from rtask.tasks.limits import Limits, limited, read_limits
from tests.rtask.tasks.conftest import CUP, JUG, LEFT, NAO, PANDA, PEN, RIGHT, TABLE


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


@pytest.mark.parametrize(
    ("goal", "said", "limits"),
    [
        ("the pen into the left box without touching the jug", "not touched: jug",
         Limits(untouched=(JUG,))),
        ("do not touch the jug, the pen goes into the left box", "not touched: jug",
         Limits(untouched=(JUG,))),
        ("put the pen into the left box; nobody may move the jug", "not touched: jug",
         Limits(untouched=(JUG,))),
        ("the pen into the left box and keep everything else where it is",
         "nothing else is touched", Limits(only_touch=(PEN,))),
        ("put only the pen into the left box", "nothing else is touched",
         Limits(only_touch=(PEN,))),
        ("don't use panda-1: the pen into the left box", "nothing is done by panda-1",
         Limits(not_by=(PANDA,))),
        ("the pen into the left box, but not by panda-1", "nothing is done by panda-1",
         Limits(not_by=(PANDA,))),
        ("with nao-1 alone, put the pen into the left box", "by nao-1 alone", Limits(by=(NAO,))),
        ("use nao-1, not panda-1, to put the pen into the left box", "by nao-1 alone",
         Limits(by=(NAO,), not_by=(PANDA,))),
    ],
)  # fmt: skip
def test_what_may_not_be_done_is_kept_to_and_said(
    kb: KnowledgeBase, goal: str, said: str, limits: Limits
) -> None:
    plan = kb.tasks.plan(goal)
    assert plan.is_complete
    assert said in plan.understood
    assert {item for step in plan.steps for item in step.robots} == {NAO}
    if limits.of_help:
        assert read_limits(plan.settled) == limits, "a plan that is made again keeps to it, too"


def test_what_cannot_be_kept_to_is_refused_with_what_stands_in_the_way(kb: KnowledgeBase) -> None:
    (refusal,) = kb.tasks.plan("put the pen into the left box without touching the pen").refusals
    assert "pen is not to be touched, as the goal says itself" in refusal.text
    (refusal,) = kb.tasks.plan("don't use panda-1: the red cup onto the table").refusals
    assert refusal.text.endswith("or allow it: leave out who is not to do it")
    plan = kb.tasks.plan("do not let nao-1 or panda-1 do it: the pen into the left box")
    assert not plan.is_complete
    assert plan.steps == ()


@pytest.mark.parametrize(
    "goal",
    [
        "don't touch the jug",
        "the pen into the left box without touching the table",
        "the pen into the left box without touching the flask",
        "the pen into the left box without tilting the jug",
        "the pen into the left box without touching the jug twice",
        "put only one pen into the left box",
        "let nao-1 do it but not alone: the pen into the left box",
    ],
)
def test_what_is_not_understood_of_a_limit_is_never_dropped(kb: KnowledgeBase, goal: str) -> None:
    with pytest.raises((UsageError, UnknownTermError)):
        kb.tasks.plan(goal)


def test_everything_is_without_what_is_left_alone(kb: KnowledgeBase) -> None:
    plan = kb.tasks.plan("put everything on the table into the right box, leave the jug")
    assert {values["thing"] for step in plan.steps if (values := step.arguments)} == {PEN}


def test_no_step_is_about_what_is_in_the_way_if_that_is_not_to_be_touched(
    kb: KnowledgeBase,
) -> None:
    goal = f"<{JUG}> rt:locatedOn <{RIGHT}>"
    assert kb.tasks.plan(goal).is_complete
    untouched = json.dumps({"goals": [], "untouched": [JUG], "by": [NAO]})
    assert not kb.tasks.plan(limited(goal, untouched)).is_complete
    only = json.dumps({"goals": [], "only_touch": [PEN, CUP]})
    assert not kb.tasks.plan(limited(goal, only)).is_complete
    assert kb.tasks.plan(limited(goal, json.dumps({"by": [NAO]}))).is_complete, "others may help"
    assert limited(goal, "the pen into the left box") == goal


def test_limits_in_json_are_lists_of_iris(kb: KnowledgeBase) -> None:
    goal = {"achieve": f"<{PEN}> rt:locatedOn <{LEFT}>"}
    assert kb.tasks.plan(goal | {"not_by": [PANDA]}).is_complete
    assert not kb.tasks.plan(goal | {"not_by": [NAO]}).is_complete
    assert not kb.tasks.plan(goal | {"only_touch": []}).is_complete
    with pytest.raises(UsageError, match='"untouched" of a goal'):
        kb.tasks.plan(goal | {"untouched": PEN})
