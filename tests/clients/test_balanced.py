"""The configuration of nginx in docs/deploy before a writer and two followers."""

from __future__ import annotations

import json
import re
import shutil
import signal
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect

from tests.benchmarks.endpoint.following import make_writer
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import free_port

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/usr/local/sbin")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(NGINX is None, reason="no nginx; apt-get install nginx-light"),
]
_CONF = Path(__file__).resolve().parents[2] / "docs" / "deploy" / "nginx.conf"


def with_tls(server: str, port: int, folder: Path) -> str:
    """Return a server of nginx as its comment about TLS says, with a certificate of its own."""
    key, cert = folder / "rtask.key", folder / "rtask.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
            *("-keyout", str(key), "-out", str(cert), "-subj", "/CN=localhost"),
            *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
        ],
        check=True,
        capture_output=True,
    )
    without_plain = re.sub(r"\n    listen 8080;", "", server)
    uncommented = re.sub(r"(?m)^    # (?=listen|ssl_)", "    ", without_plain)
    assert uncommented.count("ssl") == without_plain.count("ssl") > 3
    return (
        uncommented.replace("listen 443", f"listen 127.0.0.1:{port}")
        .replace("/etc/ssl/rtask.pem", str(cert))
        .replace("/etc/ssl/rtask.key", str(key))
    )


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
        text = _CONF.read_text("utf-8")
        secure = with_tls(text[text.index("server {") :], free_port(), tmp_path)
        text = text.replace("listen 8080", f"listen {front[7:]}") + secure
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


def robot_reads(robot: ClientConnection) -> bool:
    """Return whether the graph answers a robot, which asks about an object that is not there."""
    call = {"op": "call_service", "service": "/rtask/recall_grasps", "args": {"object": "urn:x"}}
    robot.send(json.dumps(call))
    answer = json.loads(robot.recv(timeout=20))
    return answer["op"] == "service_response" and "urn:x" in answer["values"]


def by_tls(folder: Path, token: str) -> None:
    """Read by HTTPS and as a robot by a secure websocket."""
    port = re.search(r"listen 127\.0\.0\.1:(\d+) ssl", (folder / "nginx.conf").read_text("utf-8"))
    assert port is not None
    trust = ssl.create_default_context(cafile=str(folder / "rtask.pem"))
    place = f"127.0.0.1:{port[1]}"
    assert httpx.get(f"https://{place}/health/ready", verify=trust).status_code == 200
    with connect(f"wss://{place}/", ssl=trust, additional_headers=bearer(token)) as robot:
        assert robot_reads(robot)


def test_reads_survive_kills_writes_go_to_the_writer_and_robots_keep_their_websocket(
    lab: tuple[str, str, list[RunningServer]], tmp_path: Path
) -> None:
    front, token, (writer, first, second) = lab
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
            assert robot_reads(robot)
        with connect(websocket + "changes", additional_headers=bearer(token)) as changes:
            assert "hello" in str(changes.recv(timeout=20))
        by_tls(tmp_path, token)
        statuses: list[int] = []
        killed = threading.Event()

        def read_on() -> None:
            after = 0
            while after < 20:
                after += killed.is_set()
                statuses.append(client.post("/query", data=ask).status_code)

        reading = threading.Thread(target=read_on)
        reading.start()
        first.process.send_signal(signal.SIGKILL)
        first.process.wait()
        killed.set()
        reading.join()
        assert set(statuses) == {200}, statuses
        writer.process.send_signal(signal.SIGKILL)
        writer.process.wait()
        assert client.post("/query", data=ask).status_code == 200
        refused = client.post("/update", data=text)
        assert (refused.status_code, refused.json()["type"]) == (503, "/errors/writer-unreachable")
        with connect(websocket, additional_headers=bearer(token)) as robot:
            assert robot_reads(robot)
        second.process.send_signal(signal.SIGKILL)
        second.process.wait()
        for path, body in (("/query", ask), ("/update", text)):
            refused = client.post(path, data=body)
            assert refused.status_code == 503
            assert refused.headers["Content-Type"] == "application/problem+json"
            assert refused.headers["Retry-After"] == "2"
            assert refused.json()["transient"]
