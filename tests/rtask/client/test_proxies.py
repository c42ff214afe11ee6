"""Which servers a client of HTTP reaches through the proxy that the environment names."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from rtask.client.http import HttpClient


@pytest.fixture
def listeners() -> Iterator[tuple[HTTPServer, HTTPServer, list[tuple[int, str]]]]:
    """A server, a proxy, and what either was asked for, with its port."""
    asked: list[tuple[int, str]] = []

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append((self.server.server_port, self.path))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *words: object) -> None:
            """Say nothing."""

    with (
        HTTPServer(("127.0.0.1", 0), Answer) as near,
        HTTPServer(("127.0.0.1", 0), Answer) as proxy,
    ):
        threads = [threading.Thread(target=each.serve_forever) for each in (near, proxy)]
        for thread in threads:
            thread.start()
        yield near, proxy, asked
        for each, thread in zip((near, proxy), threads, strict=True):
            each.shutdown()
            thread.join()


def test_no_proxy_is_asked_for_a_server_of_this_machine(
    listeners: tuple[HTTPServer, HTTPServer, list[tuple[int, str]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    near, proxy, asked = listeners
    for name in ("NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{proxy.server_port}")
    for url in (f"http://127.0.0.1:{near.server_port}", "http://robot.example"):
        with HttpClient(url) as client:
            client._send("GET", "/datasets")
    assert asked == [
        (near.server_port, "/datasets"),
        (proxy.server_port, "http://robot.example/datasets"),
    ]
