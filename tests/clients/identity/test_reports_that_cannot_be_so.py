"""Wrong clocks, contradictions and what cannot be: answered alike whichever way a report comes."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import count
from typing import Any

import httpx
import pytest
from websockets.sync.client import connect

import rtask
from rtask.errors import RtaskError
from tests.rtask.engine import conftest as bench
from tests.servers import RunningServer

pytestmark = pytest.mark.slow

HAND = {"name": "right_hand", "gripper_type": "nao", "max_opening": 0.05, "max_payload": 0.3}
IN_2099, IN_1970 = 4_070_908_800.0, 1_000.0
GRASP = {
    "id": "", "width": 0.03, "opening": 0.05, "quality": 0.6,
    "in_object": {"x": 0.0, "y": 0.0, "z": 0.02, "theta": 1.57},
}  # fmt: skip

_TASKS = count(1)

Call = Callable[..., tuple[int, str]]
"""Of an operation with its arguments; returns the status (200 = done), and the answer as text."""
_UNSAID = 0
"""Status of a refusal over a websocket, where rosbridge has but its words."""


def over_http(server: RunningServer, operation: str, args: dict[str, Any]) -> tuple[int, str]:
    answer = httpx.post(f"{server.url}/engine/{operation}", json=args, timeout=120)
    return answer.status_code, answer.text


def with_the_client_over_a_websocket(
    server: RunningServer, operation: str, args: dict[str, Any]
) -> tuple[int, str]:
    address = server.url.replace("http", "ws") + "/rosbridge"
    with rtask.connect(address, timeout_s=120) as robot:
        try:
            return 200, json.dumps(robot.call(operation, **args))
        except RtaskError as error:
            return _UNSAID, str(error)


def over_rosbridge(server: RunningServer, operation: str, args: dict[str, Any]) -> tuple[int, str]:
    asked = {"op": "call_service", "id": "1", "service": f"/rtask/{operation}", "args": args}
    with connect(server.url.replace("http", "ws") + "/rosbridge", max_size=None) as robot:
        robot.send(json.dumps(asked))
        while (answer := json.loads(robot.recv(120)))["op"] != "service_response":
            pass
    return 200 if answer["result"] else _UNSAID, json.dumps(answer["values"])


@pytest.fixture(
    scope="module", params=[over_http, with_the_client_over_a_websocket, over_rosbridge]
)
def call(server: RunningServer, request: pytest.FixtureRequest) -> Call:
    """Call an operation of the server in one of three ways."""

    def ask(name: str, /, **args: Any) -> tuple[int, str]:
        done: tuple[int, str] = request.param(server, name, args)
        return done

    status, text = ask("register_robot", name="nao-1", model="nao", end_effectors=[HAND])
    assert status == 200, text
    return ask


@pytest.fixture(scope="module")
def thing(call: Call) -> str:
    """An object that is stored."""
    return _stored(call, bench.BOX)


def _stored(call: Call, seen: bench.Thing) -> str:
    item = {**bench.sight(seen), "gripper_id": "right_hand"}
    status, text = call("insert_object", objects=[item])
    assert status == 200, text
    return str(json.loads(text)["objects"][0]["object"])


def _report(call: Call, thing: str, **given: Any) -> tuple[int, str]:
    outcome = given.pop("outcome", bench.held())
    asked = {"object": thing, "gripper_id": "right_hand", "grasp": GRASP, "outcome": outcome}
    return call("report_outcome", **{**asked, **given})


def test_a_report_dated_2099_is_kept_with_the_time_of_receipt_and_says_so(
    call: Call, thing: str
) -> None:
    status, text = _report(call, thing, outcome=bench.held(ended=IN_2099))
    assert status == 200, text
    assert json.loads(text)["stored"] == 1
    assert "the clock of the robot said 2099-01-01" in json.loads(text)["message"]


def test_a_report_dated_1970_is_the_robots_own_time(call: Call, thing: str) -> None:
    status, text = _report(call, thing, outcome=bench.held(ended=IN_1970))
    assert (status, json.loads(text)["stored"]) == (200, 1), text
    assert not json.loads(text).get("message")


def test_a_second_outcome_that_disagrees_is_a_conflict_and_one_that_agrees_is_not(
    call: Call, thing: str
) -> None:
    task = f"twice-{next(_TASKS)}"
    assert _report(call, thing, task_id=task)[0] == 200
    again, text = _report(call, thing, task_id=task)
    assert (again, json.loads(text)["stored"]) == (200, 0), "the same once more is stored once"
    status, text = _report(call, thing, task_id=task, outcome=bench.missed())
    assert status in (409, _UNSAID), text
    assert "stored as succeeded, and this report says that it failed" in text


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"width": 3.0}, "grasp.width: 3"),
        ({"opening": -0.1}, "grasp.opening: -0.1"),
        ({"in_object": {**GRASP["in_object"], "x": 5.0}}, "m from the object"),
    ],
)
def test_a_grasp_that_cannot_be_is_refused_with_its_field(
    call: Call, thing: str, changed: dict[str, Any], words: str
) -> None:
    status, text = _report(call, thing, grasp={**GRASP, **changed})
    assert status in (400, _UNSAID), text
    assert words in text


def test_a_success_that_missed_is_refused_with_its_field(call: Call, thing: str) -> None:
    status, text = _report(call, thing, outcome={**bench.held(), "reason": "missed"})
    assert status in (400, _UNSAID), text
    assert "outcome.reason" in text


def test_a_forgotten_object_does_not_come_back(call: Call) -> None:
    thing = _stored(call, bench.CAN)
    status, text = call("curate_object", operation="forget", object=thing)
    assert status == 200, text
    item = {**bench.sight(bench.CAN), "gripper_id": "right_hand", "object": thing}
    for status, text in (
        call("insert_object", objects=[item]),
        call("recall_grasps", object=thing, gripper_id="right_hand"),
        _report(call, thing),
    ):
        assert status in (404, _UNSAID), text
        assert "was forgotten" in text
