"""The configuration of nginx in docs/deploy before a writer and two followers."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from websockets.sync.client import connect

from tests.benchmarks.endpoint.following import make_writer
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import free_port

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/usr/local/sbin")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(NGINX is None, reason="no nginx; apt-get install nginx-light"),
]
_CONF = Path(__file__).resolve().parents[2] / "docs" / "deploy" / "nginx.conf"


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[tuple[str, str, list[RunningServer]]]:
    """Return the common address, a robot's token, and the writer with its followers."""
    token = make_writer(tmp_path / "writer", tmp_path / "token")
    front = f"http://127.0.0.1:{free_port()}"
    common = ("--behind-proxy", "--public-url", front)
    with ExitStack() as stack:
        writer = stack.enter_context(running_server(tmp_path / "writer", *common))
        follow = ("--follow", writer.url, "--token-file", str(tmp_path / "token"), *common)
        followers = [
            stack.enter_context(running_server(tmp_path / f"f{n}", *follow)) for n in range(2)
        ]
        text = _CONF.read_text("utf-8").replace("listen 8080", f"listen {front[7:]}")
        for port, server in zip((8765, 8766, 8767), (writer, *followers), strict=True):
            text = text.replace(f"127.0.0.1:{port}", f"127.0.0.1:{server.port}")
        head = f"daemon off; pid {tmp_path}/pid; error_log {tmp_path}/error.log; events {{}}\n"
        paths = "".join(
            f"{name}_temp_path {tmp_path}/{name};\n"
            for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        (tmp_path / "nginx.conf").write_text(
            f"{head}http {{ access_log off;\n{paths}{text}\n}}\n", "utf-8"
        )
        assert NGINX is not None
        command = [NGINX, "-c", str(tmp_path / "nginx.conf"), "-e", str(tmp_path / "error.log")]
        nginx = subprocess.Popen(command)
        stack.callback(nginx.wait)
        stack.callback(nginx.terminate)
        end = time.monotonic() + 20
        while True:
            try:
                httpx.get(front + "/health/live")
                break
            except httpx.TransportError:
                assert nginx.poll() is None, (tmp_path / "error.log").read_text("utf-8")
                assert time.monotonic() < end
                time.sleep(0.05)
        yield front, token, [writer, *followers]


def test_reads_are_spread_writes_go_to_the_writer_and_robots_keep_their_websocket(
    lab: tuple[str, str, list[RunningServer]],
) -> None:
    front, token, (_, first, _) = lab
    with httpx.Client(base_url=front, headers=bearer(token), timeout=30) as client:
        text = {"update": "INSERT DATA { <urn:a> <urn:p> 1 }"}
        stored = client.post("/update", data=text)
        assert stored.status_code in (200, 204), stored.text
        assert "RTASK-Staleness" not in stored.headers  # the writer itself
        own = {"RTASK-Min-Version": stored.headers["RTASK-Version"]}
        ask = {"query": "ASK { <urn:a> <urn:p> 1 }"}
        for _ in range(6):
            answer = client.get("/sparql", params=ask, headers=own)
            assert answer.status_code == 200, answer.text
            assert "RTASK-Staleness" in answer.headers  # a follower
            assert "true" in answer.text
        websocket = front.replace("http", "ws", 1) + "/"
        with connect(websocket, additional_headers=bearer(token)) as robot:
            robot.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
            answer_text = robot.recv(timeout=20)
            assert "service_response" in str(answer_text)
        with connect(websocket + "changes", additional_headers=bearer(token)) as changes:
            assert "hello" in str(changes.recv(timeout=20))
        first.stop()
        for _ in range(4):
            assert client.get("/sparql", params=ask).status_code == 200
