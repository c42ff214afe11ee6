"""Services that robots provide, without a socket."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from rtask.kb.commit.access import Access

Connect = Callable[..., Any]
ADVERTISE = {"op": "advertise_service", "service": "/add", "type": "demo/Add"}
CALL = {"op": "call_service", "id": "c1", "service": "/add", "args": {"a": 2, "b": 40}}


def nao(number: int) -> Access:
    return Access(f"nao-{number}", "robot")


def wait_for(robot: Any, count: int = 1) -> list[dict[str, Any]]:
    deadline = time.monotonic() + 60
    while len(robot.heard) < count:
        assert time.monotonic() < deadline, robot.heard
        time.sleep(0.001)
    return list(robot.heard)


def test_a_call_travels_to_the_provider_and_back_under_the_callers_id(connect: Connect) -> None:
    provider, caller = connect(nao(1)), connect(nao(2))
    provider.say(ADVERTISE)
    caller.say(CALL)
    (request,) = wait_for(provider)
    assert request["op"] == "call_service"
    assert request["args"] == {"a": 2, "b": 40}
    assert request["id"] != "c1"
    provider.say(
        {
            "op": "service_response",
            "service": "/add",
            "id": request["id"],
            "values": {"sum": 42},
            "result": True,
        }
    )
    assert wait_for(caller) == [
        {
            "op": "service_response",
            "service": "/add",
            "values": {"sum": 42},
            "result": True,
            "id": "c1",
        }
    ]


@pytest.mark.parametrize(
    ("said", "result", "values"),
    [
        ({"values": {"x": 1}}, True, {"x": 1}),
        ({"values": {"x": 1}, "result": 1}, True, {"x": 1}),
        ({"result": True}, True, {}),
        ({"values": "out of reach", "result": False}, False, "out of reach"),
        ({"values": None, "result": None}, False, "the provider refused"),
        ({}, False, "the provider refused"),
        (
            {"values": {"message": "busy"}, "result": False},
            False,
            'the provider refused: {"message": "busy"}',
        ),
    ],
)
def test_what_counts_as_success(
    connect: Connect, said: dict[str, Any], result: bool, values: Any
) -> None:
    provider, caller = connect(nao(1)), connect(nao(2))
    provider.say(ADVERTISE)
    caller.say(CALL)
    (request,) = wait_for(provider)
    provider.say({"op": "service_response", "service": "/add", "id": request["id"], **said})
    (answer,) = wait_for(caller)
    assert (answer["result"], answer["values"]) == (result, values)


def test_nobody_answers_in_time_and_the_late_answer_is_dropped(connect: Connect) -> None:
    provider, caller = connect(nao(1)), connect(nao(2))
    provider.say(ADVERTISE)
    caller.say({**CALL, "timeout": 0.05})
    (answer,) = wait_for(caller)
    assert answer["values"] == "no answer from nao-1 after 0.05 s"
    request = provider.heard[0]
    provider.say({"op": "service_response", "id": request["id"], "values": {}, "result": True})
    assert provider.heard == [request]  # no status: it is nobody's fault
    assert len(caller.heard) == 1


def test_a_provider_that_leaves_in_the_middle_of_a_call_is_told_at_once(connect: Connect) -> None:
    provider, caller = connect(nao(1)), connect(nao(2))
    provider.say(ADVERTISE)
    caller.say(CALL)
    provider.session.close()
    (answer,) = wait_for(caller)
    assert answer["values"] == "nao-1 left before it answered"
    gone = caller.ask({**CALL, "id": "c2"})
    assert "does not exist" in gone["values"]


def test_an_answer_of_another_robot_is_refused(connect: Connect) -> None:
    provider, caller, stranger = connect(nao(1)), connect(nao(2)), connect(nao(3))
    provider.say(ADVERTISE)
    caller.say(CALL)
    (request,) = wait_for(provider)
    forged = {"op": "service_response", "id": request["id"], "values": {}, "result": True}
    assert "another robot" in stranger.ask(forged)["msg"]
    assert caller.heard == []


def test_a_name_belongs_to_the_robot_that_has_it_and_its_newest_session_wins(
    connect: Connect,
) -> None:
    old, new, other, caller = connect(nao(1)), connect(nao(1)), connect(nao(2)), connect()
    old.say(ADVERTISE)
    assert "provided by nao-1" in other.ask(ADVERTISE)["msg"]
    new.say(ADVERTISE)
    old.session.close()  # must not take the newer announcement along
    caller.say(CALL)
    wait_for(new)
    assert old.heard == []


@pytest.mark.parametrize("name", ["/rtask/x", "rosapi/y", "/services/z"])
def test_names_of_the_server_cannot_be_provided(connect: Connect, name: str) -> None:
    status = connect().ask({**ADVERTISE, "service": name})
    assert "belong to the server" in status["msg"]


def test_a_reader_provides_and_calls_nothing(connect: Connect) -> None:
    reader = connect(Access(None, "reader"))
    assert "needs scope call" in reader.ask(ADVERTISE)["msg"]
    provider = connect(nao(1))
    provider.say(ADVERTISE)
    assert "needs scope call" in reader.ask(CALL)["values"]
    assert provider.heard == []


def test_a_service_cannot_have_the_name_of_a_topic_of_the_same_robot(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "advertise", "topic": "/add", "type": "a/B"})
    assert "is a topic" in robot.ask(ADVERTISE)["msg"]
    other = connect()
    other.say(ADVERTISE)
    assert "is a service" in other.ask({"op": "advertise", "topic": "/add", "type": "a/B"})["msg"]


def test_provided_services_are_listed_and_guessed(connect: Connect) -> None:
    provider, caller = connect(nao(1)), connect()
    provider.say(ADVERTISE)
    ask = {"op": "call_service", "service": "/rosapi/services"}
    assert "/add" in caller.ask(ask)["values"]["services"]
    node = caller.ask({**ask, "service": "/rosapi/service_node", "args": {"service": "add"}})
    assert node["values"] == {"node": "/nao-1"}
    near = caller.ask({**CALL, "service": "/ad"})
    assert near["values"] == "Service /ad does not exist; did you mean /add?"
    provider.say({"op": "unadvertise_service", "service": "/add"})
    assert "/add" not in caller.ask(ask)["values"]["services"]


def test_a_slow_engine_call_is_given_up_after_the_callers_time(
    connect: Connect, engine: Any
) -> None:
    robot = connect()
    answer = robot.ask({"op": "call_service", "id": 1, "service": "/rtask/wait", "timeout": 0.05})
    assert (answer["result"], answer["values"]) == (False, "no answer within 0.05 s")
    engine.gate.set()
    time.sleep(0.05)  # the thread's own answer would have come by now
    assert len(robot.heard) == 1


def test_a_service_that_is_withdrawn_fails_the_calls_that_wait_for_it(connect: Connect) -> None:
    provider, caller = connect(nao(1)), connect(nao(2))
    provider.say(ADVERTISE)
    caller.say(CALL)
    (request,) = wait_for(provider)
    provider.say({"op": "unadvertise_service", "service": "/add"})
    provider.say({"op": "service_response", "id": request["id"], "values": {}, "result": True})
    (answer,) = wait_for(caller)
    assert (answer["result"], answer["values"]) == (False, "nao-1 withdrew /add before it answered")
