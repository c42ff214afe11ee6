"""``rtask mcp``: messages over standard input and output, without a server."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli.agents import THREADS, Send, mcp, serve

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
