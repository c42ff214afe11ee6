"""``rtask mcp``: messages over standard input and output, without a server."""

from __future__ import annotations

import io
import json
import os
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli.agents import MAX_LINE, THREADS, Send, mcp, serve
from tests.servers import RTASK

_NUMBERS = " ".join(str(number) for number in range(60))
ENDLESS = (
    f"SELECT (COUNT(*) AS ?n) {{ {' '.join(f'VALUES ?v{i} {{ {_NUMBERS} }}' for i in range(6))} }}"
)


def request(number: int, method: str, **params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": number, "method": method, "params": params}


def cancel(number: int) -> dict[str, Any]:
    params = {"requestId": number}
    return {"jsonrpc": "2.0", "method": "notifications/cancelled", "params": params}


def lines(*messages: dict[str, Any]) -> bytes:
    return b"".join(json.dumps(message).encode() + b"\n" for message in messages)


@pytest.mark.slow
def test_a_session_has_progress_and_its_calls_can_be_cancelled(tmp_path: Path) -> None:
    rtask.open(tmp_path / "kb").close()
    query = {"name": "ask_sparql", "arguments": {"query": ENDLESS}}
    sent = lines(
        request(1, "initialize", protocolVersion="2025-03-26"),
        request(2, "tools/call", **query, _meta={"progressToken": "two"}),
        cancel(2),
        request(3, "tools/call", name="search", arguments={"words": "mug"}),
    )
    done = CliRunner().invoke(mcp, ["--data", str(tmp_path / "kb")], sent + b"no JSON\n")
    assert done.exit_code == 0, done.output
    received = [json.loads(line) for line in done.stdout.splitlines()]
    answers = {message["id"]: message for message in received if "id" in message}
    assert answers[1]["result"]["protocolVersion"] == "2025-03-26"
    assert answers[3]["result"]["structuredContent"]["hits"][0]["iri"] == "rt:Mug"
    assert answers[None]["error"]["code"] == -32700
    ended = answers.get(2)  # a call that had not begun needs no answer
    assert ended is None or ended["result"]["structuredContent"]["error"] == "cancelled"
    progress = [message["params"] for message in received if "method" in message]
    assert {part["progressToken"] for part in progress} <= {"two"}


def test_a_call_that_waits_for_its_turn_is_never_begun_once_it_is_cancelled() -> None:
    begun: list[object] = []
    last = threading.Event()

    def take(message: dict[str, Any], send: Send) -> Callable[[], None]:
        if message.get("id") is None:
            return last.set

        def work() -> None:
            begun.append(message["id"])
            last.wait(60)

        return work

    calls = [request(number, "tools/call") for number in range(THREADS + 1)]
    serve(take, io.BytesIO(lines(*calls, cancel(THREADS))), io.BytesIO())
    assert sorted(map(str, begun)) == [str(number) for number in range(THREADS)]


class _Echo:
    """Answers each request with its id, at once."""

    def __call__(self, message: dict[str, Any], send: Send) -> Callable[[], None]:
        if "id" not in message:
            return lambda: None
        return lambda: send({"jsonrpc": "2.0", "id": message["id"], "result": {}})


@pytest.mark.parametrize(
    "line",
    [b"no JSON", b"\xff\xfe\x00", b"[" * 100_000, b"[]", b"7", b'[{"id": 1}, 7]',
     b'{"a": "' + b"x" * (2 * MAX_LINE) + b'"}'],
)  # fmt: skip
def test_a_line_that_holds_no_message_is_refused_once_and_the_next_is_answered(line: bytes) -> None:
    outgoing = io.BytesIO()
    serve(_Echo(), io.BytesIO(line + b"\n" + lines(request(1, "ping"))), outgoing)
    refused, answered = map(json.loads, outgoing.getvalue().splitlines())
    assert (refused["id"], refused["error"]["code"]) == (None, -32700)
    assert answered["id"] == 1


def test_a_list_of_messages_is_answered_by_one_list() -> None:
    note = {"jsonrpc": "2.0", "method": "notifications/initialized"}
    batch = json.dumps([request(1, "ping"), note, request(2, "ping")]).encode()
    outgoing = io.BytesIO()
    serve(_Echo(), io.BytesIO(batch + b"\n"), outgoing)
    (answered,) = map(json.loads, outgoing.getvalue().splitlines())
    assert [one["id"] for one in answered] == [1, 2]


def test_calls_are_given_up_once_nobody_reads_their_answers() -> None:
    given_up: list[object] = []
    last = threading.Event()

    def take(message: dict[str, Any], send: Send) -> Callable[[], None]:
        if message["method"] == "notifications/cancelled":
            given_up.append(message["params"]["requestId"])
            return last.set
        return lambda: None if last.wait(60) else send({})

    reading, writing = os.pipe()
    os.close(reading)
    calls = [request(number, "tools/call") for number in range(THREADS + 1)]
    with os.fdopen(writing, "wb") as outgoing:
        serve(take, io.BytesIO(lines(*calls)), outgoing)
    assert given_up == list(range(THREADS + 1))


@pytest.mark.deep
def test_the_command_ends_when_its_agent_is_killed_amid_calls(tmp_path: Path) -> None:
    rtask.open(tmp_path / "kb").close()
    query = {"name": "ask_sparql", "arguments": {"query": ENDLESS}}
    calls = [
        request(number, "tools/call", **query, _meta={"progressToken": number})
        for number in range(12 * THREADS)
    ]
    command = [*RTASK, "mcp", "--data", str(tmp_path / "kb")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        running.stdin.write(lines(*calls))
        running.stdin.flush()
        assert b"notifications/progress" in running.stdout.readline()
        running.stdout.close()  # as the kernel does for an agent that is killed
        running.stdin.close()
        # By themselves, all the queries take twelve times the limit of one, 10 s.
        assert running.wait(90) == 0
