"""Requests that are hostile by their form, against a live server, and what others notice.

``python -m tests.benchmarks.endpoint.stress_hostile_requests [NAME...]`` sends each of
:data:`tests.hostile_requests.REQUESTS` once as a robot and once as a caller that may do everything,
then keeps connections that trickle. Meanwhile another client asks ``/health/live`` and inserts one
statement. Targets: none answered with 500, each ended within the limits and .5 s, others answered
within 250 ms (by the clock, and without waits for a processor), SIGTERM within 5 s.
"""

from __future__ import annotations

import os
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import httpx

from endpoint.access.tokens import TokenStore
from tests.benchmarks.endpoint.stress_updates import UPDATE, resident, told
from tests.hostile_requests import REQUESTS, HostileRequest
from tests.processor_waits import Wait, timed
from tests.servers import RunningServer, running_server

_BASE = "http://hostile.example/"
_TRICKLING = 100
_TRICKLED_S = 5.0


def send(server: RunningServer, request: HostileRequest, token: str, own: str) -> tuple[int, str]:
    """Send a request; return its status and the beginning of the answer."""
    body = request.body()
    if not request.encoding:
        body = body.replace(b"{port}", str(server.port).encode())
    headers = {"Content-Type": request.content_type, "Authorization": f"Bearer {token}"}
    if request.encoding:
        headers["Content-Encoding"] = request.encoding
    url = server.url + request.path.replace("{own}", own)
    try:
        answer = httpx.request(request.method, url, content=body, headers=headers, timeout=120)
    except httpx.HTTPError as error:
        return 0, repr(error)
    return answer.status_code, answer.text[:160].replace("\n", " ")


def watched(server: RunningServer, token: str, attack: threading.Thread) -> list[Wait]:
    """Return what others wait for while an attack goes on."""
    waits = []
    attack.start()
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=server.url, timeout=60, headers=headers) as client:
        while attack.is_alive():
            for path in ("/health/live", "/update"):
                text = f"INSERT DATA {{ <urn:seen> <urn:n> {time.monotonic_ns()} }}"
                with timed(server.process.pid) as wait:
                    answer = (
                        client.get(path)
                        if path == "/health/live"
                        else client.post(path, content=text, headers=UPDATE)
                    )
                if answer.status_code >= 300:
                    print("  another was refused:", answer.status_code, answer.text[:120])
                waits.append(wait)
            time.sleep(0.02)
    return waits


def trickle(server: RunningServer, token: str) -> None:
    """Hold connections to which a byte is sent now and then, in the head or in the body."""
    head = f"POST /update HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n"
    typed = head + "Content-Type: application/sparql-update\r\n"
    bodies = (
        typed + "Content-Length: 100000000\r\n\r\nINSERT",
        typed + "Transfer-Encoding: chunked\r\n\r\n1\r\nI\r\n",
        head,
    )
    held = []
    for number in range(_TRICKLING):
        connection = socket.create_connection(("127.0.0.1", server.port))
        connection.sendall(bodies[number % 3].encode())
        held.append(connection)
    until = time.monotonic() + _TRICKLED_S
    while time.monotonic() < until:
        for number, connection in enumerate(held):
            try:
                connection.sendall((b" ", b"1\r\n \r\n", b"X: 1\r\n")[number % 3])
            except OSError:
                continue
        time.sleep(0.5)
    for connection in held:
        connection.close()


def main() -> None:
    """Attack, measure and print."""
    chosen = sys.argv[1:] or list(REQUESTS)
    statuses: Counter[int] = Counter()
    others: list[Wait] = []
    print(f"{len(chosen)} hostile requests; load {os.getloadavg()[0]:.1f}")
    with (
        tempfile.TemporaryDirectory() as folder,
        running_server(Path(folder) / "kb", "--base", _BASE) as server,
    ):
        data = " . ".join(f"<urn:a{i}> <urn:b> {i % 7}" for i in range(2_000))
        start = f"INSERT DATA {{ {data} }}"
        httpx.post(f"{server.url}/update", content=start, headers=UPDATE).raise_for_status()
        tokens = TokenStore(Path(folder) / "kb")
        secrets = {
            "admin": tokens.create("admin")[0],
            "robot": tokens.create("robot", agent="nao-1")[0],
        }
        other = tokens.create("robot", agent="nao-2")[0]
        headers = {"Authorization": f"Bearer {other}"}
        while httpx.get(f"{server.url}/api/objects", headers=headers).status_code == 401:
            time.sleep(0.1)  # another process has made the tokens
        before = resident(server)
        for name in chosen:
            for role, secret in secrets.items():
                ended: list[tuple[float, int, str]] = []

                def attack(
                    name: str = name, secret: str = secret, ended: list[Any] = ended
                ) -> None:
                    started = time.perf_counter()
                    status, text = send(server, REQUESTS[name], secret, f"{_BASE}graph/agent/nao-1")
                    ended.append((time.perf_counter() - started, status, text))

                waits = watched(server, other, threading.Thread(target=attack))
                seconds, status, text = ended[0]
                statuses[status] += 1
                others += waits
                clock = max((wait.clock_s for wait in waits), default=0.0)
                health, insert = (
                    1e3 * max((wait.own_s for wait in waits[k::2]), default=0.0) for k in (0, 1)
                )
                print(f"{name:36} {role:6} {status} {seconds:6.2f} s  others {1e3 * clock:5.0f} "
                      f"ms; /health {health:4.0f}, insert {insert:4.0f} without processor waits; "
                      f"{resident(server) >> 20} MB  "
                      f"{text if status >= 500 or not status else ''}", flush=True)  # fmt: skip
                if server.process.poll() is not None:
                    print("THE SERVER ENDED", server.process.poll())
                    return
        waits = watched(server, other, threading.Thread(target=trickle, args=(server, other)))
        print("beside trickling connections:", told(waits))
        memory = resident(server)
        started = time.perf_counter()
        server.process.terminate()
        server.process.wait(60)
        stopped = time.perf_counter() - started
    print(f"answers {dict(statuses)}; {told(others)}")
    print(f"memory {memory / before:.2f} times; SIGTERM {stopped:.1f} s; "
          f"load {os.getloadavg()[0]:.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
