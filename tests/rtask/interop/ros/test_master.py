"""The master: what answers in its place, and the thread that watches it; without ROS."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator

import pytest

from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.master import Master, Watch


class Page(http.server.BaseHTTPRequestHandler):
    """Answers every request with a page."""

    def do_POST(self) -> None:
        body = b"<html><br></html>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def page() -> Iterator[str]:
    with http.server.HTTPServer(("127.0.0.1", 0), Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_web_server_in_the_place_of_the_master_is_named(page):
    with pytest.raises(RemoteUnavailableError, match=f"no ROS master answers at {page}"):
        Master(page).ask("getPid")


def test_the_watch_survives_what_fails_in_a_round(monkeypatch, page):
    monkeypatch.setattr("rtask.interop.ros.master._POLL_S", 0.0)
    rounds, enough = [], threading.Event()

    def refused() -> None:
        rounds.append(1)
        if len(rounds) == 3:
            enough.set()
        raise UsageError("refused by the server")

    watch = Watch(Master(page), "/node", lambda: None, refused)
    watch.start()
    try:
        assert enough.wait(60)
    finally:
        watch.end()
        watch.join()
