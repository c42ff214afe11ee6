"""The wire: lost connections, late answers, refusals; against a server that misbehaves on order."""

from __future__ import annotations

import contextlib
import json
import queue
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

import rtask
from rtask.client.calling.messages import addresses
from rtask.client.websocket import ServiceSocket
from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    RemoteUnavailableError,
    UsageError,
)

Behaviour = Callable[[ServerConnection, dict[str, Any], int], None]


def answer(socket, message, values, result=True):
    socket.send(
        json.dumps({"op": "service_response", "id": message["id"], "values": values,
                    "service": message["service"], "result": result})
    )  # fmt: skip


@pytest.fixture
def server() -> Iterator[Any]:
    """Return a function that starts a rosbridge whose answers a test decides."""
    with contextlib.ExitStack() as stack:

        def start(behave: Behaviour, process_request: Any = None) -> tuple[str, list[Any]]:
            heard: list[Any] = []

            def handle(socket: ServerConnection) -> None:
                with contextlib.suppress(ConnectionClosed):
                    for text in socket:
                        message = json.loads(text)
                        heard.append((message, dict(socket.request.headers)))
                        behave(socket, message, len(heard))

            running = serve(handle, "127.0.0.1", 0, process_request=process_request)
            thread = threading.Thread(target=running.serve_forever)
            thread.start()
            stack.callback(thread.join)
            stack.callback(running.shutdown)
            host, port = running.socket.getsockname()[:2]
            return f"ws://{host}:{port}/rosbridge", heard

        yield start


def test_a_call_carries_service_args_and_token(server):
    address, heard = server(lambda s, m, n: answer(s, m, {"x": 1}))
    socket = ServiceSocket(address, "rtk_1_secret", 5.0)
    assert socket.call("/rtask/ping", {"a": 2}, may_repeat=False) == {"x": 1}
    socket.close()
    message, headers = heard[0]
    assert message["op"] == "call_service"
    assert message["service"] == "/rtask/ping"
    assert message["args"] == {"a": 2}
    assert headers["authorization"] == "Bearer rtk_1_secret"


def test_a_failure_carries_the_servers_words(server):
    address, _ = server(lambda s, m, n: answer(s, m, "unknown gripper 'x'", result=False))
    with (
        contextlib.closing(ServiceSocket(address, None, 5.0)) as socket,
        pytest.raises(CallFailedError, match="unknown gripper 'x'"),
    ):
        socket.call("/rtask/ping", {}, may_repeat=True)


def test_a_lost_connection_is_opened_again_where_a_repeat_does_no_harm(server):
    def behave(socket, message, number):
        if number < 3:
            socket.close()
        else:
            answer(socket, message, {"number": number})

    address, heard = server(behave)
    with contextlib.closing(ServiceSocket(address, None, 10.0)) as socket:
        assert socket.call("/rtask/report_outcome", {"task_id": "t"}, True) == {"number": 3}
    assert [message["args"] for message, _ in heard] == [{"task_id": "t"}] * 3


def test_a_lost_connection_is_told_where_a_repeat_could_do_harm(server):
    address, heard = server(lambda s, m, n: s.close())
    with (
        contextlib.closing(ServiceSocket(address, None, 5.0)) as socket,
        pytest.raises(RemoteUnavailableError, match="may have been carried out"),
    ):
        socket.call("/rtask/teach_object", {}, may_repeat=False)
    assert len(heard) == 1


def test_an_answer_that_comes_too_late_is_not_taken_for_another(server):
    late: list[Any] = []

    def behave(socket, message, number):
        if number == 1:
            late.append(message)
            return
        answer(socket, late[0], {"for": "the first"})
        answer(socket, message, {"for": "the second"})

    address, _ = server(behave)
    with contextlib.closing(ServiceSocket(address, None, 0.3)) as socket:
        with pytest.raises(RemoteUnavailableError, match=r"within 0\.3 s"):
            socket.call("/rtask/slow", {}, may_repeat=False)
        # The first timeout dropped the connection: the late answer has no way in.
        assert socket.call("/rtask/quick", {}, may_repeat=False) == {"for": "the second"}


def test_a_busy_server_is_asked_again_until_it_has_time(server):
    def behave(socket, message, number):
        if number < 3:
            socket.send(json.dumps({"op": "service_response", "id": message["id"], "status": 503,
                                    "service": message["service"], "values": "busy: 8 running",
                                    "result": False}))  # fmt: skip
        else:
            answer(socket, message, {"number": number})

    address, _ = server(behave)
    with contextlib.closing(ServiceSocket(address, None, 10.0)) as socket:
        assert socket.call("/rtask/teach_object", {}, may_repeat=False) == {"number": 3}


def test_a_call_has_its_own_deadline(server):
    came = queue.Queue()

    def behave(socket, message, number):
        came.put(message)
        if number == 1:
            answer(socket, message, {})

    address, _ = server(behave)
    with contextlib.closing(ServiceSocket(address, None, 60.0)) as socket:
        # Connected first: on a busy machine that alone takes longer than the call may.
        socket.call("/rtask/ping", {}, may_repeat=True)
        with pytest.raises(RemoteUnavailableError, match=r"within 0\.2 s"):
            socket.call("/rtask/slow", {}, may_repeat=True, timeout_s=0.2)
        assert came.get(timeout=60.0)["timeout"] > 0.2
        assert came.get(timeout=60.0)["timeout"] <= 0.2  # the server is told, and stops too


def test_a_status_about_the_call_is_a_failure(server):
    def behave(socket, message, number):
        socket.send(json.dumps({"op": "status", "level": "error", "msg": "too deep",
                                "id": message["id"]}))  # fmt: skip

    address, _ = server(behave)
    with (
        contextlib.closing(ServiceSocket(address, None, 5.0)) as socket,
        pytest.raises(CallFailedError, match="too deep"),
    ):
        socket.call("/rtask/ping", {}, may_repeat=True)


def test_a_wrong_token_is_an_authentication_error_at_once(server):
    refused = []

    def refuse(connection, request):
        refused.append(request.path)
        return connection.respond(401, "no")

    address, _ = server(lambda s, m, n: None, refuse)
    with (
        contextlib.closing(ServiceSocket(address, "wrong", 20.0)) as socket,
        pytest.raises(AuthenticationError, match="valid token"),
    ):
        socket.call("/rtask/ping", {}, may_repeat=True)
    assert len(refused) == 1  # not retried until the time is up


def test_nobody_listening_is_an_error_after_the_given_time():
    socket = ServiceSocket("ws://127.0.0.1:9/rosbridge", None, 0.5)
    with pytest.raises(RemoteUnavailableError, match=r"127\.0\.0\.1:9/rosbridge cannot be"):
        socket.call("/rtask/ping", {}, may_repeat=True)


def test_a_value_that_json_cannot_say_is_refused_before_it_is_sent(server):
    address, heard = server(lambda s, m, n: answer(s, m, {}))
    with (
        contextlib.closing(ServiceSocket(address, None, 5.0)) as socket,
        pytest.raises(UsageError, match="are not JSON"),
    ):
        socket.call("/rtask/ping", {"x": float("nan")}, may_repeat=True)
    assert heard == []


@pytest.mark.parametrize("url", ["127.0.0.1:8765", "ftp://host", "", "http://"])
def test_an_address_that_is_none_is_named(url):
    with pytest.raises(UsageError, match="expected http://host:port"):
        addresses(url)


def test_token_and_agent_are_for_one_kind_of_target_each():
    with (
        rtask.open(":memory:", reason=False) as kb,
        pytest.raises(UsageError, match="token is for servers"),
    ):
        rtask.connect(kb, token="rtk")
    with pytest.raises(UsageError, match="agent is for clients in process"):
        rtask.connect("http://127.0.0.1:9", agent="nao-1")
