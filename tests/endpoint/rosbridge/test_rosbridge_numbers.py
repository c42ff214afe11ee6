"""Numbers and names that JSON can spell but nobody can use; without a socket."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

from endpoint.rosbridge.calls import Deadlines
from endpoint.rosbridge.session import Bridge
from rtask.kb.commit.access import Access

Connect = Callable[..., Any]
HUGE = "9" * 400


@pytest.mark.parametrize("field", ["timeout", "fragment_size"])
@pytest.mark.parametrize("number", [HUGE, "NaN", "-Infinity", "1e999"])
def test_a_call_with_an_unusable_number_is_answered_all_the_same(
    connect: Connect, field: str, number: str
) -> None:
    call = f'{{"op": "call_service", "id": "c", "service": "/rtask/search_object", "{field}": %s}}'
    answer = connect().ask(call % number)
    assert (answer["op"], answer["id"], answer["result"]) == ("service_response", "c", True)


@pytest.mark.parametrize("field", ["throttle_rate", "queue_length"])
@pytest.mark.parametrize("number", [HUGE, "NaN", "1e999"])
def test_a_subscription_needs_usable_numbers(connect: Connect, field: str, number: str) -> None:
    refused = connect().ask(f'{{"op": "subscribe", "topic": "/a", "{field}": {number}}}')
    assert refused["msg"] == f"{field}: expected a number"


@pytest.mark.parametrize("op", ["call_service", "send_action_goal"])
def test_what_cannot_be_passed_on_is_refused_as_the_answer_to_it(connect: Connect, op: str) -> None:
    provider, caller = connect(Access("nao-1", "robot")), connect(Access("nao-2", "robot"))
    provider.say({"op": "advertise_service", "service": "/go", "type": "a/Go"})
    provider.say({"op": "advertise_action", "action": "/go", "type": "a/Go"})
    message = f'{{"op": "{op}", "id": 1, "service": "/go", "action": "/go", "args": {{"x": NaN}}}}'
    answer = caller.ask(message)
    assert (answer["op"], answer["id"], answer["result"]) == (
        {"call_service": "service_response", "send_action_goal": "action_result"}[op], 1, False
    )  # fmt: skip
    assert "no NaN or infinity" in answer["values"]
    assert not provider.heard


def test_the_thesis_own_op_names_a_number_beyond_a_float(connect: Connect) -> None:
    refused = connect().ask(f'{{"op": "send_new_object", "new_object": [{{"X": {HUGE}}}]}}')
    assert "new_object[0].X" in refused["error"]


@pytest.mark.parametrize("op", ["call_service", "send_action_goal", "no_such_op"])
@pytest.mark.parametrize("id_", ["NaN", "-1e999", "[1e999]"])
def test_an_id_that_cannot_be_sent_back_does_not_end_the_session(
    connect: Connect, op: str, id_: str
) -> None:
    robot = connect()
    refused = robot.ask(f'{{"op": "{op}", "id": {id_}, "service": "/x", "action": "/x"}}')
    assert refused["op"] == "status"
    assert "id" not in refused
    assert robot.ask({"op": "call_service", "service": "/rosapi/get_time"})["result"] is True


def test_the_caller_of_a_robot_whose_answer_is_unusable_is_told_so(connect: Connect) -> None:
    provider, caller = connect(Access("nao-1", "robot")), connect(Access("nao-2", "robot"))
    provider.say({"op": "advertise_service", "service": "/add", "type": "a/Add"})
    caller.say({"op": "call_service", "id": "c", "service": "/add"})
    asked = provider.heard[-1]["id"]
    answer = (
        f'{{"op": "service_response", "id": "{asked}", "result": true, "values": {{"x": NaN}}}}'
    )
    assert provider.ask(answer)["op"] == "status"
    (told,) = caller.heard
    assert (told["id"], told["result"]) == ("c", False)
    assert told["values"] == "nao-1 answered with a number that is none in JSON"


def test_the_result_of_an_action_may_be_sent_again_without_the_unusable_number(
    connect: Connect,
) -> None:
    provider = connect(Access("nao-1", "robot"))
    caller = connect(Access("nao-2", "robot"))
    provider.say({"op": "advertise_action", "action": "/walk", "type": "nao/Walk"})
    caller.say({"op": "send_action_goal", "id": "g", "action": "/walk"})
    goal = provider.heard[-1]["id"]
    result = f'{{"op": "action_result", "id": "{goal}", "status": 4, "result": true, "values": %s}}'
    assert provider.ask(result % "NaN")["op"] == "status"
    provider.say(result % "1")
    assert [one["values"] for one in caller.heard] == [1]


def test_a_pause_of_centuries_does_not_stop_the_clock_of_the_others() -> None:
    deadlines, done = Deadlines(), threading.Event()
    deadlines.after(1e300, lambda: None)
    thread = deadlines._thread
    assert thread is not None
    thread.join(0.1)  # time enough to fail, if it is to
    deadlines.after(0.0, done.set)
    assert done.wait(60)
    deadlines.close()


def test_a_picture_is_known_by_its_topic_with_or_without_the_leading_slash(
    connect: Connect, bridge: Bridge
) -> None:
    robot = connect(Access("nao-1", "robot"))
    robot.say({"op": "advertise", "topic": "camera", "type": "sensor_msgs/CompressedImage"})
    robot.say({"op": "publish", "topic": "camera", "msg": {"data": "eA=="}})
    assert bridge.activity.last_picture("nao-1") == {
        "type": "sensor_msgs/CompressedImage",
        "data": "eA==",
    }


@pytest.mark.parametrize("op", ["advertise", "publish", "subscribe", "advertise_service"])
def test_a_name_that_no_page_could_show_is_refused(connect: Connect, op: str) -> None:
    answer = connect().ask(f'{{"op": "{op}", "topic": "/\\ud800", "service": "/\\ud800"}}')
    assert answer["op"] == "status"
    assert "expected a name" in answer["msg"]


def test_the_deadline_of_a_goal_goes_with_it(connect: Connect, bridge: Bridge) -> None:
    provider = connect(Access("nao-1", "robot"))
    caller = connect(Access("nao-2", "robot"))
    provider.say({"op": "advertise_action", "action": "/walk", "type": "nao/Walk"})
    caller.say({"op": "send_action_goal", "id": "g", "action": "/walk"})
    (goal,) = bridge.actions._goals.values()
    assert goal.late is not None
    provider.say(
        {"op": "action_result", "id": provider.heard[-1]["id"], "status": 4, "result": True}
    )
    assert goal.late.action is None
