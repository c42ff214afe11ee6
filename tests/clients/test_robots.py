"""Robots connect: roslibpy unmodified, and bare websockets for what no good client sends."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import roslibpy
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.commands import run_command
from tests.servers import RunningServer, bearer

pytestmark = pytest.mark.slow

HAND = {
    "name": "right_hand",
    "gripper_type": "nao_hand",
    "kind": "Hand",
    "min_opening": 0.0,
    "max_opening": 0.08,
    "jaw_width": 0.02,
    "finger_length": 0.06,
    "max_force": 3.0,
    "max_payload": 0.1,
    "parent_link": "r_wrist",
    "planning_group": "right_arm",
}
ROBOT = {
    "model": "nao-h25-v5",
    "simulated": True,
    "end_effectors": [HAND],
    "cameras": [],
    "frames": [],
}
SEARCH = {"op": "search_object", "service": "send_point_cloud", "args": "zc5p81H1cO8P+Ksmfdf..."}


@pytest.fixture(scope="module")
def ros(server: RunningServer) -> Iterator[roslibpy.Ros]:
    """A robot program; the reactor of its library starts once in a process."""
    client = roslibpy.Ros(host="127.0.0.1", port=server.port)
    client.run(timeout=60)
    yield client
    client.close()


def call(ros: roslibpy.Ros, name: str, args: dict[str, Any] | None = None) -> Any:
    service = roslibpy.Service(ros, name, "rtask/Any")
    return service.call(roslibpy.ServiceRequest(args or {}), timeout=60)


def test_roslibpy_calls_a_service_of_the_engine(ros: roslibpy.Ros) -> None:
    answer = call(ros, "/rtask/register_robot", {"name": "ros-1", **ROBOT})
    assert answer["robot"].endswith("robot/ros-1")
    again = call(ros, "/rtask/register_robot", {"name": "ros-1", **ROBOT})
    assert again["robot"] == answer["robot"]


def test_roslibpy_hears_why_a_call_failed(ros: roslibpy.Ros) -> None:
    with pytest.raises(roslibpy.core.ServiceException, match="did you mean /rtask/register_robot"):
        call(ros, "/rtask/registr_robot")
    with pytest.raises(roslibpy.core.ServiceException, match="name"):
        call(ros, "/rtask/register_robot", {"nme": "x"})


def test_roslibpy_asks_for_time_services_and_topics(ros: roslibpy.Ros) -> None:
    assert abs(ros.get_time()["secs"] - time.time()) < 60  # both clocks are this machine's
    assert "/rtask/recognise_for_grasp" in ros.get_services()
    assert isinstance(ros.get_topics(), list)


def test_a_topic_travels_from_one_robot_to_another(
    ros: roslibpy.Ros, server: RunningServer
) -> None:
    heard = threading.Event()
    messages: list[Any] = []
    listener = roslibpy.Topic(ros, "/battery", "std_msgs/Float32")
    listener.subscribe(lambda message: (messages.append(message), heard.set()))
    with connect(server.websocket) as other:
        other.send(json.dumps({"op": "advertise", "topic": "/battery", "type": "std_msgs/Float32"}))
        deadline = time.monotonic() + 60
        while not heard.is_set() and time.monotonic() < deadline:
            # The subscription travels on its own connection; say it until it has arrived.
            other.send(json.dumps({"op": "publish", "topic": "/battery", "msg": {"data": 0.8}}))
            heard.wait(0.1)
    listener.unsubscribe()
    assert messages[0] == {"data": 0.8}


def test_a_commit_is_announced_to_who_subscribed(server: RunningServer) -> None:
    with connect(server.websocket) as robot:
        robot.send(json.dumps({"op": "subscribe", "topic": "/rtask/changes"}))
        robot.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
        robot.recv(timeout=60)  # the subscription was read before this was answered
        text = "INSERT DATA { GRAPH <urn:g:announced> { <urn:s> <urn:p> 1 } }"
        httpx.post(f"{server.url}/update", data={"update": text})
        change = json.loads(robot.recv(timeout=60))
    assert change["topic"] == "/rtask/changes"
    assert change["msg"]["graphs"] == ["urn:g:announced"]
    assert change["msg"]["added"] == 1


def test_the_messages_of_the_thesis_are_answered(server: RunningServer) -> None:
    """Gatto 2016, 3.2.4: the printed cloud is cut off, so the answer says that it is none."""
    with connect(server.url.replace("http", "ws") + "/rosbridge") as robot:
        robot.send(json.dumps(SEARCH))
        answer = json.loads(robot.recv(timeout=60))
    assert answer["op"] == "search_object_response"
    assert (answer["service"], answer["result"], answer["similar_objects"]) == ("query", False, [])
    assert answer["error"].startswith("args: ")


def test_the_same_operation_over_http(server: RunningServer) -> None:
    answer = httpx.post(f"{server.url}/engine/register_robot", json={"name": "ros-2", **ROBOT})
    assert answer.status_code == 200, answer.text
    assert answer.json()["robot"].endswith("robot/ros-2")


@pytest.mark.parametrize(
    ("path", "content", "kind", "status"),
    [
        ("register_robot", b"{broken", "application/json", 400),
        ("register_robot", b"[1]", "application/json", 400),
        ("register_robot", b"[" * 50_000, "application/json", 400),
        ("register_robot", b"{}", "text/plain", 415),
        ("no_such_thing", b"{}", "application/json", 404),
    ],
)
def test_a_faulty_call_over_http_is_refused(
    server: RunningServer, path: str, content: bytes, kind: str, status: int
) -> None:
    answer = httpx.post(
        f"{server.url}/engine/{path}", content=content, headers={"Content-Type": kind}
    )
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("text", ["{", "[]", '{"op": "fly"}', "[" * 9_000, "\x00", ""])
def test_rubbish_is_answered_and_the_robot_stays_connected(
    server: RunningServer, text: str
) -> None:
    with connect(server.websocket) as robot:
        robot.send(text)
        assert json.loads(robot.recv(timeout=60))["op"] == "status"
        robot.send(b"\x00\x01")
        assert json.loads(robot.recv(timeout=60))["op"] == "status"
        robot.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
        assert json.loads(robot.recv(timeout=60))["result"] is True


def status_of_handshake(url: str, **options: Any) -> int:
    try:
        with connect(url, **options):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Authorization": f"Bearer rtk_{'0' * 12}_{'0' * 32}"}, 401),
        ({}, 101),
    ],
)
def test_who_may_connect(server: RunningServer, headers: dict[str, str], status: int) -> None:
    assert status_of_handshake(server.websocket, additional_headers=headers) == status


def test_the_own_page_may_connect_and_no_other_address_takes_robots(
    server: RunningServer,
) -> None:
    own = {"Origin": server.url}
    assert status_of_handshake(server.websocket, additional_headers=own) == 101
    assert status_of_handshake(server.websocket + "nowhere") != 101


def test_a_token_in_the_header_names_the_robot(guarded: RunningServer, make_token: Any) -> None:
    token = make_token("--robot", "ws-1")
    call_ = {"op": "call_service", "service": "/rtask/register_robot"}
    with connect(guarded.websocket, additional_headers=bearer(token)) as robot:
        robot.send(json.dumps({**call_, "args": {"name": "ws-1", **ROBOT}}))
        assert json.loads(robot.recv(timeout=60))["result"] is True
        robot.send(json.dumps({**call_, "args": {"name": "another", **ROBOT}}))
        assert json.loads(robot.recv(timeout=60))["result"] is False


def test_a_token_in_the_address_is_refused(guarded: RunningServer, make_token: Any) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect(f"{guarded.websocket}?token={make_token('--robot', 'ws-url')}")
    assert refused.value.response.status_code == 401
    assert b"POST /tokens/ticket" in (refused.value.response.body or b"")


def test_a_ticket_opens_one_websocket_and_no_second(
    guarded: RunningServer, make_token: Any
) -> None:
    token = make_token("--robot", "ws-ticket")
    header = bearer(token)
    answer = httpx.post(f"{guarded.url}/tokens/ticket", headers=header)
    assert (answer.status_code, answer.headers["Cache-Control"]) == (201, "no-store")
    ticket = answer.json()["ticket"]
    assert token not in ticket
    with connect(f"{guarded.websocket}?token={ticket}") as robot:
        register = {"op": "call_service", "service": "/rtask/register_robot",
                    "args": {"name": "ws-ticket", **ROBOT}}  # fmt: skip
        robot.send(json.dumps(register))
        assert json.loads(robot.recv(timeout=60))["result"] is True
    assert status_of_handshake(f"{guarded.websocket}?token={ticket}") == 401
    another = httpx.post(f"{guarded.url}/tokens/ticket", headers=header).json()["ticket"]
    # In a header it is no token: only websockets take it.
    assert httpx.get(f"{guarded.url}/sparql", headers=bearer(another)).status_code == 401
    assert status_of_handshake(f"{guarded.websocket}?token={another}") == 101
    assert httpx.post(f"{guarded.url}/tokens/ticket").status_code == 401
    assert httpx.get(f"{guarded.url}/tokens/ticket", headers=header).status_code == 405


def test_one_token_holds_a_bounded_number_of_connections(
    guarded: RunningServer, make_token: Any
) -> None:
    token = make_token("--robot", "ws-many")
    with contextlib.ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(connect(guarded.websocket, additional_headers=bearer(token)))
        with pytest.raises(InvalidStatus) as refused:
            connect(guarded.websocket, additional_headers=bearer(token))
        assert refused.value.response.status_code == 503
        assert refused.value.response.headers["Retry-After"]
    assert status_of_handshake(guarded.websocket, additional_headers=bearer(token)) == 101


def test_a_flood_of_calls_is_answered_in_full_and_harms_no_other_robot(
    server: RunningServer,
) -> None:
    """Beyond 8 running and 32 waiting calls the rest are refused, each with its own id."""
    call_ = {"op": "call_service", "service": "/rtask/recall_grasps", "args": {"object": "none"}}
    with connect(server.websocket) as flood, connect(server.websocket) as other:
        for number in range(500):
            flood.send(json.dumps({**call_, "id": number}))
        other.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
        assert json.loads(other.recv(timeout=60))["result"] is True
        answers = [json.loads(flood.recv(timeout=60)) for _ in range(500)]
    assert sorted(answer["id"] for answer in answers) == list(range(500))
    assert {answer["result"] for answer in answers} == {False}
    assert {answer["status"] for answer in answers} <= {422, 503}


def test_a_robot_cannot_write_for_another_over_any_way_in(
    guarded: RunningServer, make_token: Any
) -> None:
    token = make_token("--robot", "ws-own")
    other = {"name": "ws-other", **ROBOT}
    with connect(guarded.websocket, additional_headers=bearer(token)) as robot:
        robot.send(
            json.dumps({"op": "call_service", "service": "/rtask/register_robot", "args": other})
        )
        refused = json.loads(robot.recv(timeout=60))
    assert (refused["result"], refused["status"]) == (False, 403)
    header = bearer(token)
    over_http = httpx.post(f"{guarded.url}/engine/register_robot", json=other, headers=header)
    assert over_http.status_code == 403
    asked = 'ASK { ?robot ?p "ws-other" }'
    found = httpx.get(f"{guarded.url}/sparql", params={"query": asked},
                      headers={**header, "Accept": "application/sparql-results+json"})  # fmt: skip
    assert found.json()["boolean"] is False


def test_revoking_a_token_closes_its_connections(guarded: RunningServer, make_token: Any) -> None:
    token = make_token("--robot", "ws-2")
    with connect(guarded.websocket, additional_headers=bearer(token)) as robot:
        revoke = ("token", "revoke", token.split("_")[1], "--data", str(guarded.data))
        run_command(*revoke, check=True)
        with pytest.raises(ConnectionClosed) as closed:
            robot.recv(timeout=60)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008
    assert status_of_handshake(guarded.websocket, additional_headers=bearer(token)) == 401
