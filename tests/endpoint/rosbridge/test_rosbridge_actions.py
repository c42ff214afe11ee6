"""Actions: goals for robots, feedback, results and cancelling, without a socket."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from endpoint.rosbridge.actions import Action, Goal, Progress
from endpoint.rosbridge.session import Bridge, Session
from rtask.errors import UsageError
from rtask.kb.commit.access import Access

Connect = Callable[..., Any]
ADVERTISE = {"op": "advertise_action", "action": "/walk", "type": "nao/Walk"}
GOAL = {
    "op": "send_action_goal",
    "id": "g1",
    "action": "/walk",
    "action_type": "nao/Walk",
    "args": {"x": 1.0},
    "feedback": True,
}


def wait_for(robot: Any, count: int) -> list[dict[str, Any]]:
    deadline = time.monotonic() + 60
    while len(robot.heard) < count:
        assert time.monotonic() < deadline, robot.heard
        time.sleep(0.001)
    return list(robot.heard)


@pytest.fixture
def pair(connect: Connect) -> tuple[Any, Any]:
    """A robot that walks and one that asks it to, the goal being on its way."""
    provider, caller = connect(Access("nao-1", "robot")), connect(Access("nao-2", "robot"))
    provider.say(ADVERTISE)
    caller.say(GOAL)
    return provider, caller


def test_a_goal_its_feedback_and_its_result_travel(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    (goal,) = provider.heard
    assert (goal["op"], goal["args"], goal["feedback"]) == ("send_action_goal", {"x": 1.0}, True)
    about = {"id": goal["id"], "action": "/walk"}
    provider.say({"op": "action_feedback", **about, "values": {"walked": 0.5}})
    provider.say(
        {"op": "action_result", **about, "values": {"done": 1}, "status": 4, "result": True}
    )
    provider.say({"op": "action_feedback", **about, "values": {"walked": 0.9}})  # too late
    assert caller.heard == [
        {"op": "action_feedback", "id": "g1", "action": "/walk", "values": {"walked": 0.5}},
        {
            "op": "action_result",
            "id": "g1",
            "action": "/walk",
            "values": {"done": 1},
            "status": 4,
            "result": True,
        },
    ]


def test_a_failed_result_without_values_has_an_empty_text(pair: tuple[Any, Any]) -> None:
    """The message of roslib's ``setFailed``."""
    provider, caller = pair
    id_ = provider.heard[0]["id"]
    provider.say(
        {"op": "action_result", "id": id_, "action": "/walk", "status": 6, "result": False}
    )
    (result,) = caller.heard
    assert (result["values"], result["status"], result["result"]) == ("", 6, False)


def test_cancelling_reaches_the_provider_and_its_result_the_caller(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    id_ = provider.heard[0]["id"]
    caller.say({"op": "cancel_action_goal", "id": "g1", "action": "/walk"})
    assert provider.heard[1] == {"op": "cancel_action_goal", "id": id_, "action": "/walk"}
    provider.say(
        {"op": "action_result", "id": id_, "action": "/walk", "values": {}, "status": 5,
         "result": False}
    )  # fmt: skip
    assert caller.heard[0]["status"] == 5


def test_all_goals_are_cancelled_without_an_answer(pair: tuple[Any, Any]) -> None:
    """The message of roslib's ``cancelAllGoals`` has no id, and it logs an error for an answer."""
    provider, caller = pair
    caller.say({"op": "call_service", "service": "/walk/_action/cancel_goal", "args": {}})
    assert provider.heard[1]["op"] == "cancel_action_goal"
    assert caller.heard == []


def test_a_provider_that_leaves_fails_its_goals(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    provider.session.close()
    (result,) = caller.heard
    assert result["status"] == 6
    assert result["values"] == "nao-1 left before it was done"


def test_an_action_that_is_withdrawn_ends_its_goals(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    id_ = provider.heard[0]["id"]
    provider.say({"op": "unadvertise_action", "action": "/walk"})
    assert provider.heard[1] == {"op": "cancel_action_goal", "id": id_, "action": "/walk"}
    provider.say({"op": "action_result", "id": id_, "action": "/walk", "status": 4, "values": {}})
    (result,) = caller.heard
    assert (result["status"], result["result"]) == (6, False)
    assert result["values"] == "nao-1 withdrew /walk before it was done"


def test_a_caller_that_leaves_cancels_its_goals(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    caller.session.close()
    assert provider.heard[1]["op"] == "cancel_action_goal"


def test_a_result_of_another_robot_is_refused(pair: tuple[Any, Any], connect: Connect) -> None:
    provider, caller = pair
    id_ = provider.heard[0]["id"]
    forged = {"op": "action_result", "id": id_, "action": "/walk", "status": 4, "result": True}
    assert "another robot" in connect(Access("nao-3", "robot")).ask(forged)["msg"]
    assert caller.heard == []


def test_an_unknown_action_fails_its_goal(connect: Connect) -> None:
    result = connect().ask({**GOAL, "action": "/fly"})
    assert (result["op"], result["status"], result["result"]) == ("action_result", 6, False)
    assert "/fly does not exist" in result["values"]


def test_goals_of_one_session_are_bounded(pair: tuple[Any, Any]) -> None:
    _, caller = pair
    for number in range(15):
        caller.say({**GOAL, "id": f"more-{number}"})
    refused = caller.ask({**GOAL, "id": "one too many"})
    assert refused["values"] == "busy: 16 goals in progress"


@pytest.fixture
def planner(bridge: Bridge) -> list[Progress]:
    """Give the server an action that works until it is told to stop or to succeed."""
    seen: list[Progress] = []

    def work(args: dict[str, Any], access: Access, progress: Progress) -> dict[str, Any]:
        seen.append(progress)
        if "wrong" in args:
            raise UsageError("wrong: no")
        progress.report(0.5, "scoring")
        progress.report(0.4, "scoring")
        deadline = time.monotonic() + 60
        while "wait" in args and not progress.is_cancelled and time.monotonic() < deadline:
            time.sleep(0.001)
        return {"grasps": []}

    action = Action("/rtask/work", "rtask/Work", "read", work)
    bridge.actions._offered[action.name] = action
    return seen


def test_an_action_of_the_server_tells_progress_then_the_result(
    connect: Connect, planner: list[Progress]
) -> None:
    robot = connect()
    robot.say({**GOAL, "action": "/rtask/work"})
    feedback, _, result = wait_for(robot, 3)
    assert feedback["values"] == {"progress": 0.5, "phase": "scoring"}
    assert (result["status"], result["result"], result["values"]) == (4, True, {"grasps": []})


def test_an_action_of_the_server_is_cancelled_and_hears_of_it(
    connect: Connect, planner: list[Progress]
) -> None:
    robot = connect()
    robot.say({**GOAL, "action": "/rtask/work", "args": {"wait": 1}})
    wait_for(robot, 1)
    robot.say({"op": "cancel_action_goal", "id": "g1", "action": "/rtask/work"})
    result = wait_for(robot, 2)[1]
    assert (result["status"], result["result"], result["values"]) == (5, True, {})
    assert planner[0].is_cancelled


def test_a_failing_action_of_the_server_has_a_result_of_one_line(
    connect: Connect, planner: list[Progress]
) -> None:
    robot = connect()
    result = robot.ask({**GOAL, "action": "/rtask/work", "args": {"wrong": 1}})
    assert (result["status"], result["result"], result["values"]) == (6, False, "wrong: no")


def test_progress_never_goes_back() -> None:
    told: list[float] = []
    progress = Progress(lambda values: told.append(values["progress"]))
    for value in (0.2, 0.6, 0.4, 2.0):
        progress.report(value, "scoring")
    assert told == [0.2, 0.6, 0.6, 1.0]


def test_feedback_that_comes_too_fast_is_replaced_by_the_newest(pair: tuple[Any, Any]) -> None:
    provider, caller = pair
    about = {"id": provider.heard[0]["id"], "action": "/walk"}
    for number in range(5):
        provider.say({"op": "action_feedback", **about, "values": {"n": number}})
    provider.say({"op": "action_result", **about, "values": {}, "status": 4, "result": True})
    told = [message["values"] for message in caller.heard]
    assert told == [{"n": 0}, {"n": 4}, {}]  # the last before the result, none between


def test_a_result_is_sent_once(bridge: Bridge) -> None:
    heard: list[Any] = []
    session = Session(bridge, lambda text, topic="": heard.append(text), Access(None, "anonymous"))
    goal = Goal("g", "/walk", session, True, bridge.deadlines)
    goal.end(4, {})
    goal.end(6, "late")
    assert len(heard) == 1
