"""Goals that say what may not be touched, and who may not or alone may do it: kept, or refused."""

from __future__ import annotations

import json

import pytest

from rtask.errors import UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.tasks.limits import Limits, limited, read_limits
from tests.rtask.tasks.conftest import CUP, JUG, LEFT, NAO, PANDA, PEN, RIGHT


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
