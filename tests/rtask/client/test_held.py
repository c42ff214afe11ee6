"""One held websocket: calls of several threads, topics over reconnections, refusals, its end."""

from __future__ import annotations

import contextlib
import json
import queue
import threading
from http import HTTPStatus

import pytest

from rtask.client.calling.client import HeldClient
from rtask.client.calling.held import HeldSocket
from rtask.client.calling.rules import CallRules
from rtask.errors import AuthenticationError, CallFailedError, RemoteUnavailableError, UsageError
from rtask.wire.request_id import RequestId
from tests.rtask.client.test_websocket import answer, server

__all__ = ["server"]  # a fixture

RULES = CallRules(
    frozenset({"where_is"}), frozenset({"report_outcome"}), {"report_outcome": RequestId("task_id")}
)


def call(socket, number):
    return socket.call("/s", {"n": number}, True)


@contextlib.contextmanager
def held(address, timeout_s=60.0, token=None):
    with contextlib.closing(HeldSocket(address, token, timeout_s)) as socket:
        yield socket


def test_answers_in_another_order_reach_the_threads_that_asked(server):
    waiting = []

    def behave(socket, message, number):
        waiting.append(message)
        if len(waiting) == 2:
            for each in reversed(waiting):
                answer(socket, each, {"of": each["args"]["n"]})

    address, heard = server(behave)
    answers = {}
    with held(address, token="rtk_1_x") as socket:
        threads = [
            threading.Thread(
                target=lambda n=n: answers.update({n: socket.call("/s", {"n": n}, True)})
            )
            for n in (1, 2)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
    assert answers == {1: {"of": 1}, 2: {"of": 2}}
    assert heard[0][1]["authorization"] == "Bearer rtk_1_x"


def test_a_lost_call_is_repeated_only_where_that_does_no_harm(server):
    def behave(socket, message, number):
        if message["args"].get("lose"):
            socket.close()
        elif number > 1:
            answer(socket, message, {"number": number})

    address, _ = server(lambda s, m, n: s.close() if n == 1 else answer(s, m, {"number": n}))
    with held(address) as socket:
        assert socket.call("/s", {}, True) == {"number": 2}
    address, _ = server(behave)
    with held(address) as socket:
        with pytest.raises(RemoteUnavailableError, match="may have been carried out"):
            socket.call("/s", {"lose": True}, False)
        assert socket.call("/s", {}, False) == {"number": 2}


def test_a_topic_is_subscribed_again_after_a_lost_connection(server):
    def behave(socket, message, number):
        if message["op"] == "subscribe":
            socket.send(json.dumps({"op": "publish", "topic": "/t", "msg": {"n": number}}))
        if message["op"] == "call_service":
            socket.close()

    address, heard = server(behave)
    messages = queue.Queue()
    with held(address) as socket:
        socket.subscribe("/t", messages.put)
        assert messages.get(timeout=60) == {"n": 1}
        with pytest.raises(RemoteUnavailableError):
            socket.call("/s", {}, False)
        assert messages.get(timeout=60)["n"] > 1
    assert [m["op"] for m, _ in heard] == ["subscribe", "call_service", "subscribe"]


def test_a_subscriber_that_fails_cuts_no_calls(server):
    def behave(socket, message, number):
        if message["op"] == "subscribe":
            socket.send('{"op": "publish", "topic": "/t", "msg": {}}')
        else:
            answer(socket, message, {"number": number})

    address, _ = server(behave)
    with held(address) as socket:
        socket.subscribe("/t", lambda message: 1 / 0)
        assert socket.call("/s", {}, False) == {"number": 2}


def test_refusals_have_the_servers_words_and_a_wrong_token_is_said_at_once(server):
    address, _ = server(lambda s, m, n: answer(s, m, "unknown hand", result=False))
    with held(address) as socket, pytest.raises(CallFailedError, match="unknown hand"):
        socket.call("/s", {}, True)
    address, _ = server(
        lambda s, m, n: None,
        lambda connection, request: connection.respond(HTTPStatus.UNAUTHORIZED, "no"),
    )
    with held(address, 60.0) as socket, pytest.raises(AuthenticationError, match="valid token"):
        socket.call("/s", {}, True)


def test_without_an_answer_or_a_server_a_call_ends_in_its_time(server):
    address, _ = server(lambda s, m, n: None)
    with held(address, 0.2) as socket:
        with pytest.raises(RemoteUnavailableError, match="no answer"):
            socket.call("/s", {}, True)
        with pytest.raises(UsageError, match="not JSON"):
            socket.call("/s", {"x": float("nan")}, True)
    with held("ws://127.0.0.1:9/rosbridge", 0.2) as socket:
        assert not socket.is_open
        with pytest.raises(RemoteUnavailableError, match="cannot be reached"):
            socket.call("/s", {}, True)


def test_reports_wait_in_the_outbox_with_an_id_and_are_delivered(server, tmp_path):
    ready = threading.Event()
    address, heard = server(lambda s, m, n: answer(s, m, {}) if ready.is_set() else None)
    client = HeldClient(address, None, 0.3, RULES, tmp_path / "outbox")
    with contextlib.closing(client):
        with pytest.raises(RemoteUnavailableError, match="kept in"):
            client.call("report_outcome", success=True)
        assert client.waiting == 1
        ready.set()
        assert client.deliver() == 1
        assert client.waiting == 0
    first, second = (message["args"] for message, _ in heard)
    assert first == second
    assert first["task_id"].startswith("urn:uuid:")


def test_a_report_under_way_is_not_sent_by_a_thread_that_delivers(server, tmp_path):
    asked, ready = threading.Event(), threading.Event()

    def behave(socket, message, number):
        asked.set()
        assert ready.wait(60)
        answer(socket, message, {"number": number})

    address, heard = server(behave)
    answers = queue.Queue()
    with contextlib.closing(HeldClient(address, None, 20.0, RULES, tmp_path / "outbox")) as client:
        thread = threading.Thread(target=lambda: answers.put(client.call("report_outcome", x=1)))
        thread.start()
        assert asked.wait(60)
        assert client.deliver() == 0
        ready.set()
        thread.join(60)
        assert client.waiting == 0
    assert answers.get(timeout=60) == {"number": 1}
    assert len(heard) == 1
