"""Calls over HTTP that are sent again: only where it may help, and within the caller's time."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

import rtask
from rtask.client import failures
from rtask.errors import CallFailedError
from tests.clocks import PassedBySleeping

Answer = tuple[int, dict[str, Any]]


@pytest.fixture
def served() -> Iterator[Callable[[list[Answer]], tuple[str, list[str]]]]:
    """A server that gives prepared answers, and the addresses that it was asked at."""
    servers: list[ThreadingHTTPServer] = []

    def serve(answers: list[Answer]) -> tuple[str, list[str]]:
        asked: list[str] = []

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                self.rfile.read(int(self.headers["Content-Length"]))
                status, body = answers[min(len(asked), len(answers) - 1)]
                asked.append(self.path)
                data = json.dumps(body).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *args: Any) -> None:
                """Say nothing."""

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        servers.append(server)
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        return f"http://127.0.0.1:{server.server_port}", asked

    yield serve
    for server in servers:
        server.shutdown()
        server.server_close()


BUSY = (503, {"detail": "no such device yet", "transient": True})
BROKEN = (503, {"detail": "no such file", "transient": False})
DONE = (200, {"result": 1})


def test_what_may_pass_is_asked_again_with_the_time_that_is_left(served):
    url, asked = served([BUSY, BUSY, DONE])
    with rtask.connect(url) as client:
        assert client.call_service("lab/Arm", "use", timeout_s=30.0) == {"result": 1}
    times = [float(parse_qs(urlsplit(one).query)["timeout"][0]) for one in asked]
    assert len(times) == 3
    assert 30.0 > times[0] > times[1] > times[2]


def test_what_will_not_change_is_not_asked_again(served):
    url, asked = served([BROKEN, DONE])
    with (
        rtask.connect(url) as client,
        pytest.raises(CallFailedError, match="no such file") as caught,
    ):
        client.call_service("lab/Arm", "use", timeout_s=30.0, may_repeat=True)
    assert len(asked) == 1
    assert not caught.value.is_transient


def test_the_time_of_a_call_bounds_all_its_tries(served, monkeypatch):
    clock = PassedBySleeping()
    monkeypatch.setattr(failures, "time", clock)
    url, asked = served([BUSY])
    with rtask.connect(url) as client, pytest.raises(CallFailedError) as caught:
        client.call_service("lab/Arm", "use", timeout_s=20.0)
    assert caught.value.is_transient
    assert len(asked) > 5
    assert clock.now_s <= 20.0
