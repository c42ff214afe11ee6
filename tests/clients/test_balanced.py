"""The configuration of nginx in docs/deploy before a writer and two followers."""

from __future__ import annotations

import json
import shutil
import signal
import ssl
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect

from tests.following import make_writer
from tests.nginx import NGINX, running_nginx
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import free_port

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        NGINX is None or shutil.which("openssl") is None,
        reason="no nginx or openssl; apt-get install nginx-light openssl",
    ),
]


@pytest.fixture
def tls_port() -> int:
    return free_port()


@pytest.fixture
def lab(tmp_path: Path, tls_port: int) -> Iterator[tuple[str, str, list[RunningServer]]]:
    """Return the common address, a robot's token, and the writer with its followers."""
    token = make_writer(tmp_path / "writer", tmp_path / "token")
    port = free_port()
    front = f"http://127.0.0.1:{port}"
    common = ("--behind-proxy", "--public-url", front)
    with ExitStack() as stack:
        writer = stack.enter_context(running_server(tmp_path / "writer", *common))
        follow = ("--follow", writer.url, "--token-file", str(tmp_path / "token"), *common)
        followers = [
            stack.enter_context(running_server(tmp_path / f"f{n}", *follow)) for n in range(2)
        ]
        servers = [writer, *followers]
        ports = [server.port for server in servers]
        stack.enter_context(running_nginx(tmp_path, port, ports, tls_port))
        yield front, token, servers


def robot_reads(robot: ClientConnection) -> bool:
    """Return whether the graph answers a robot, which asks about an object that is not there."""
    call = {"op": "call_service", "service": "/rtask/recall_grasps", "args": {"object": "urn:x"}}
    robot.send(json.dumps(call))
    answer = json.loads(robot.recv(timeout=60))
    return answer["op"] == "service_response" and "urn:x" in answer["values"]


def robot_options(token: str) -> dict[str, Any]:
    return {"additional_headers": bearer(token), "open_timeout": 60}


def read_by_tls(certificate: Path, port: int, token: str) -> None:
    """Read by HTTPS and as a robot by a secure websocket."""
    trust = ssl.create_default_context(cafile=str(certificate))
    place = f"127.0.0.1:{port}"
    assert httpx.get(f"https://{place}/health/ready", verify=trust).status_code == 200
    with connect(f"wss://{place}/", ssl=trust, **robot_options(token)) as robot:
        assert robot_reads(robot)


def test_reads_survive_kills_writes_go_to_the_writer_and_robots_keep_their_websocket(
    lab: tuple[str, str, list[RunningServer]], tmp_path: Path, tls_port: int
) -> None:
    front, token, (writer, first, second) = lab
    with httpx.Client(base_url=front, headers=bearer(token), timeout=60) as client:
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
        with connect(websocket, **robot_options(token)) as robot:
            assert robot_reads(robot)
        with connect(websocket + "changes", **robot_options(token)) as changes:
            assert "hello" in str(changes.recv(timeout=60))
        read_by_tls(tmp_path / "rtask.pem", tls_port, token)
        statuses: list[int] = []
        cut: list[int] = []
        killed = threading.Event()

        def read_on() -> None:
            after = 0
            while after < 20:
                after += killed.is_set()
                try:
                    statuses.append(client.post("/query", data=ask).status_code)
                except httpx.RemoteProtocolError:  # its head had arrived when the server died
                    cut.append(after)

        reading = threading.Thread(target=read_on)
        reading.start()
        first.process.send_signal(signal.SIGKILL)
        first.process.wait()
        killed.set()
        reading.join()
        assert (set(statuses), len(cut) < 2) == ({200}, True), (statuses, cut)
        writer.process.send_signal(signal.SIGKILL)
        writer.process.wait()
        assert client.post("/query", data=ask).status_code == 200
        refused = client.post("/update", data=text)
        assert (refused.status_code, refused.json()["type"]) == (503, "/errors/writer-unreachable")
        with connect(websocket, **robot_options(token)) as robot:
            assert robot_reads(robot)
        second.process.send_signal(signal.SIGKILL)
        second.process.wait()
        for path, body in (("/query", ask), ("/update", text)):
            refused = client.post(path, data=body)
            assert refused.status_code == 503
            assert refused.headers["Content-Type"] == "application/problem+json"
            assert refused.headers["Retry-After"] == "2"
            assert refused.json()["transient"]
