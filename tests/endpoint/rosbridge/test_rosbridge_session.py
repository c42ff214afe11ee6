"""rosbridge v2 as roslibpy and roslib speak it, without a socket."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import pytest

from rtask.kb.commit.access import Access

Connect = Callable[..., Any]


def call(service: str, **fields: Any) -> dict[str, Any]:
    return {"op": "call_service", "service": service, **fields}


def test_a_call_is_answered_with_values_result_and_its_own_id(connect: Connect) -> None:
    answer = connect().ask(call("/rtask/search_object", id="call:7", args={"data": "x"}))
    assert answer["op"] == "service_response"
    assert answer["id"] == "call:7"
    assert answer["service"] == "/rtask/search_object"
    assert answer["result"] is True
    assert answer["values"]["similar_objects"][0]["class"] == "1"


@pytest.mark.parametrize("args", [{"data": "x"}, [{"data": "x"}]])
def test_arguments_come_as_an_object_or_as_a_list_holding_one(
    connect: Connect, engine: Any, args: Any
) -> None:
    connect().ask(call("rtask/search_object", args=args))
    assert engine.asked[-1][1] == {"data": "x"}


@pytest.mark.parametrize("fields", [{}, {"args": None}, {"args": []}])
def test_missing_arguments_are_an_empty_object(
    connect: Connect, engine: Any, fields: dict[str, Any]
) -> None:
    connect().ask(call("/rtask/search_object", **fields))
    assert engine.asked[-1][1] == {}


def test_the_service_is_echoed_as_the_caller_spelled_it_and_no_id_is_invented(
    connect: Connect,
) -> None:
    answer = connect().ask(call("rosapi/get_time"))
    assert answer["service"] == "rosapi/get_time"
    assert "id" not in answer


def test_rosapi_takes_its_arguments_in_order(connect: Connect) -> None:
    robot = connect(Access("nao-1", "robot"))
    stored = robot.ask(call("/rosapi/set_param", args=["speed", "0.5"]))
    assert stored["values"] == {"successful": True, "reason": ""}
    assert robot.ask(call("/rosapi/get_param", args=["speed"]))["values"]["value"] == "0.5"
    node = robot.ask(call("/rosapi/service_node", args=["/rosapi/get_time"]))
    assert node["values"] == {"node": "/rtask"}
    refused = robot.ask(call("/rosapi/service_node", args=["/rosapi/get_time", "more"]))
    assert refused["result"] is False


def test_an_unknown_service_fails_with_the_nearest_name(connect: Connect) -> None:
    answer = connect().ask(call("/rtask/serch_object", id=3))
    assert answer["result"] is False
    assert answer["id"] == 3
    assert answer["values"] == (
        "Service /rtask/serch_object does not exist; did you mean /rtask/search_object?"
    )


def test_a_failing_handler_says_nothing_of_the_inside(connect: Connect) -> None:
    answer = connect().ask(call("/rtask/fail"))
    assert answer["result"] is False
    assert isinstance(answer["values"], str)
    assert "secret" not in answer["values"]


def test_an_answer_that_is_no_json_number_fails_the_call(connect: Connect) -> None:
    answer = connect().ask(call("/rtask/not_a_number"))
    assert answer["result"] is False


def test_a_reader_may_search_but_not_write(connect: Connect, engine: Any) -> None:
    robot = connect(Access(None, "reader"))
    assert robot.ask(call("/rtask/search_object"))["result"] is True
    refused = robot.ask(call("/rtask/insert_object", args={"objects": []}))
    assert refused["result"] is False
    assert "needs scope write" in refused["values"]
    assert [name for name, _, _ in engine.asked] == ["search_object"]


def test_a_slow_call_does_not_hold_up_a_fast_one_of_the_same_robot(
    connect: Connect, engine: Any
) -> None:
    robot = connect()
    robot.say(call("/rtask/wait", id="slow"))
    fast = robot.ask(call("/rtask/search_object", id="fast"))
    assert fast["id"] == "fast"
    engine.gate.set()
    deadline = time.monotonic() + 60
    while len(robot.heard) < 2 and time.monotonic() < deadline:
        time.sleep(0.001)
    assert robot.heard[1]["id"] == "slow"


def test_calls_beyond_the_queue_are_refused_and_say_so(connect: Connect, engine: Any) -> None:
    robot = connect()
    for number in range(8 + 32):
        robot.say(call("/rtask/wait", id=number))
    answer = robot.ask(call("/rtask/wait", id="one too many"))
    assert answer == {
        "op": "service_response",
        "service": "/rtask/wait",
        "values": "busy: 8 calls running, 32 waiting",
        "result": False,
        "status": 503,
        "transient": True,
        "id": "one too many",
    }


def test_one_robots_queue_is_not_anothers(connect: Connect) -> None:
    greedy, other = connect(), connect()
    for number in range(8 + 32):
        greedy.say(call("/rtask/wait", id=number))
    assert other.ask(call("/rtask/search_object"))["result"] is True


def test_rosapi_answers_even_when_the_queue_is_full(connect: Connect) -> None:
    robot = connect()
    for number in range(8 + 32):
        robot.say(call("/rtask/wait", id=number))
    moment = robot.ask(call("/rosapi/get_time"))["values"]["time"]
    assert set(moment) == {"secs", "nsecs", "sec", "nanosec"}
    assert abs(moment["secs"] - time.time()) < 60  # both clocks are this machine's


def test_rosapi_lists_services_and_topics_with_their_types(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "advertise", "topic": "/battery", "type": "std_msgs/Float32"})
    services = robot.ask(call("/rosapi/services"))["values"]["services"]
    assert {"/rtask/search_object", "/rosapi/topics"} <= set(services)
    listed = robot.ask(call("/rosapi/topics"))["values"]
    assert dict(zip(listed["topics"], listed["types"], strict=True))["/battery"] == (
        "std_msgs/Float32"
    )
    type_ = robot.ask(call("/rosapi/service_type", args={"service": "/rtask/search_object"}))
    assert type_["values"] == {"type": "rtask/SearchObject"}
    unknown = robot.ask(call("/rosapi/topic_type", args={"topic": "/nope"}))
    assert unknown["values"] == {"type": ""}
    assert unknown["result"] is True


def test_rosapi_describes_messages_and_answers_with_the_types_in_them(connect: Connect) -> None:
    robot = connect()
    change = robot.ask(call("/rosapi/message_details", args={"type": "rtask/Change"}))
    (typedef,) = change["values"]["typedefs"]
    assert dict(zip(typedef["fieldnames"], typedef["fieldtypes"], strict=True))["graphs"] == (
        "string"
    )
    pose = robot.ask(call("/rosapi/message_details", args={"type": "geometry_msgs/Pose"}))
    held = [one["type"] for one in pose["values"]["typedefs"]]
    assert held == ["geometry_msgs/Pose", "geometry_msgs/Point", "geometry_msgs/Quaternion"]
    details = call("/rosapi/service_response_details", args={"type": "rtask/SearchObject"})
    answer, similar = robot.ask(details)["values"]["typedefs"]
    assert answer["type"] == "rtask/SearchObjectResponse"
    assert answer["fieldarraylen"][answer["fieldtypes"].index(similar["type"])] == 0
    assert "confidence" in similar["fieldnames"]
    unknown = robot.ask(call("/rosapi/message_details", args={"type": "nao/Walk"}))
    assert unknown["values"]["typedefs"][0]["fieldnames"] == []


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('{"op": "call_service",}', "line 1, column 23"),
        ("", "not JSON"),
        ("[1, 2]", "a message is a JSON object"),
        ('{"service": "/x"}', "unknown op None"),
        ('{"op": ["call_service"]}', "unknown op"),
        ('{"op": "fly"}', "unknown op 'fly'"),
        ("[" * 9_000 + "]" * 9_000, "invalid JSON"),
        ('{"op": "publish", "topic": "/t", "msg": ' + "[" * 70 + "]" * 70 + "}", "deeper than 64"),
        ('{"op": "publish", "n": ' + "9" * 5_000 + "}", "invalid JSON"),
        ('{"op": "publish", "topic": "/t", "msg": NaN}', "NaN"),
        ('{"op": "subscribe"}', "topic: expected a name"),
        ('{"op": "subscribe", "topic": "/t", "id": {}}', "id: expected a string or a number"),
        ('{"op": "advertise", "topic": "/rtask/x", "type": "a/B"}', "belong to the server"),
        ('{"op": "publish", "topic": "/rosapi/x", "msg": {}}', "belong to the server"),
    ],
)
def test_a_faulty_message_becomes_one_status_and_the_session_lives(
    connect: Connect, text: str, part: str
) -> None:
    robot = connect()
    status = robot.ask(text)
    assert status["op"] == "status"
    assert status["level"] == "error"
    assert part in status["msg"]
    assert robot.ask(call("/rosapi/get_time"))["result"] is True


def test_set_level_none_silences_statuses(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "set_level", "level": "none"})
    robot.say({"op": "fly"})
    assert robot.heard == []


def test_a_warning_is_only_told_to_those_who_want_it(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "unadvertise", "topic": "/never"})
    assert robot.heard == []
    robot.say({"op": "set_level", "level": "warning"})
    assert robot.ask({"op": "unadvertise", "topic": "/never"})["level"] == "warning"


def test_the_old_auth_op_is_taken_and_ignored(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "auth", "mac": "x", "client": "y"})
    assert robot.heard == []


def test_a_closed_session_hears_nothing_any_more(connect: Connect, engine: Any) -> None:
    robot, other = connect(), connect()
    robot.say({"op": "subscribe", "topic": "/t"})
    robot.say(call("/rtask/wait"))
    robot.session.close()
    engine.gate.set()
    other.say({"op": "publish", "topic": "/t", "msg": {}})
    time.sleep(0.05)  # the call's answer would have come by now
    assert robot.heard == []


def test_messages_keep_their_unicode(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "subscribe", "topic": "/t"})
    heard = robot.ask(json.dumps({"op": "publish", "topic": "/t", "msg": {"data": "Tässchen 🤖"}}))
    assert heard["msg"] == {"data": "Tässchen 🤖"}
