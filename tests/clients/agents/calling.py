"""Real transports for agents of the tests: HTTP, and the command over standard input and output."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx

from tests.servers import RTASK

__all__ = ["Call", "by_http", "by_stdio", "tool_caller"]

Call = Callable[[str, dict[str, Any]], dict[str, Any]]


@contextmanager
def by_http(client: httpx.Client, _token: str) -> Iterator[Call]:
    def call(method: str, params: dict[str, Any]) -> dict[str, Any]:
        answer: dict[str, Any] = client.post("/mcp", json=_request(method, params)).json()
        return answer

    yield call


@contextmanager
def by_stdio(client: httpx.Client, token: str) -> Iterator[Call]:
    command = [*RTASK, "mcp", "--server", str(client.base_url).rstrip("/")]
    environment = {**os.environ, "RTASK_TOKEN": token}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        sent, received = running.stdin, running.stdout

        def call(method: str, params: dict[str, Any]) -> dict[str, Any]:
            sent.write(json.dumps(_request(method, params)).encode() + b"\n")
            sent.flush()
            answer: dict[str, Any] = json.loads(received.readline())
            return answer

        yield call
        sent.close()
        assert running.wait(60) == 0


def tool_caller(call: Call) -> Call:
    """Return what calls a tool by its name."""
    return lambda name, arguments: call("tools/call", {"name": name, "arguments": arguments})


def _request(method: str, params: dict[str, Any]) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
