"""Small calls by POST over one connection: answered in order, ended with their client."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow  # starts a server

SERVICE = '''
from pathlib import Path
import time
from rtask.errors import CancelledError
from rtask.services import Call, Service, method

class Pause(Service):
    """Takes its time."""
    name, version, max_workers = "bench/Pause", "1.0.0", 8

    @method
    def nap(self, seconds: float) -> float:
        """Sleep."""
        time.sleep(seconds)
        return seconds

    @method
    def stay(self, file: str) -> None:
        """Heed nobody until there is the file."""
        while not Path(file).exists():
            time.sleep(0.002)

    @method
    def write(self, size: int) -> str:
        """Return a long text."""
        return "x" * size

    @method(effect="reads")
    def wait(self, folder: str, call: Call) -> None:
        """Say that it has begun, and whether it was cancelled."""
        (Path(folder) / "begun").touch()
        try:
            while True:
                time.sleep(0.002)
                call.check_cancelled()
        except CancelledError:
            (Path(folder) / "cancelled").touch()
            raise
'''


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    file = tmp_path_factory.mktemp("service") / "pause.py"
    file.write_text(SERVICE)
    with running_server(None, "--service", str(file)) as running:
        yield running


def _head(path: str, length: int, *fields: str) -> bytes:
    lines = [f"POST {path} HTTP/1.1", "Host: localhost", "Content-Type: application/json"]
    return "\r\n".join([*lines, f"Content-Length: {length}", *fields, "", ""]).encode()


def _call(method: str, *fields: str, **request: Any) -> bytes:
    body = json.dumps(request).encode()
    return _head(f"/services/bench/Pause/{method}", len(body), *fields) + body


def _answers(connection: socket.socket, count: int) -> list[tuple[int, dict[str, Any]]]:
    """Read as many answers, all of them JSON."""
    found: list[tuple[int, dict[str, Any]]] = []
    data = b""
    while len(found) < count:
        piece = connection.recv(1 << 16)
        assert piece, f"the connection ended after {len(found)} answers"
        data += piece
        while b"\r\n\r\n" in data:
            head, _, rest = data.partition(b"\r\n\r\n")
            fields = dict(line.lower().split(b": ", 1) for line in head.split(b"\r\n")[1:])
            length = int(fields[b"content-length"])
            if len(rest) < length:
                break
            found.append((int(head.split()[1]), json.loads(rest[:length])))
            data = rest[length:]
    return found


def _connect(server: RunningServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=60)


def test_calls_sent_at_once_are_answered_in_order(server: RunningServer) -> None:
    live = b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with _connect(server) as connection:
        connection.sendall(
            _call("nap", seconds=0.2)
            + _call("nap", seconds=0)
            + live
            + _call("nap", seconds="x")
            + _call("nap", seconds=0.01)
            + _head("/engine/nothing_of_the_kind", 2) + b"{}"
        )  # fmt: skip
        answers = _answers(connection, 6)
    assert [status for status, _ in answers] == [200, 200, 200, 400, 200, 404]
    assert [body.get("result") for _, body in answers[:2]] == [0.2, 0]
    assert answers[2][1] == {"live": True}
    assert "seconds: expected a finite number" in answers[3][1]["detail"]


def test_a_body_may_come_late_and_in_pieces(server: RunningServer) -> None:
    call = _call("nap", seconds=0.25)
    with _connect(server) as connection:
        for piece in (call[:40], call[40:-9], call[-9:-3], call[-3:]):
            connection.sendall(piece)
            time.sleep(0.08)
        assert _answers(connection, 1) == [(200, {"result": 0.25})]


def test_the_rest_of_a_body_belongs_to_its_own_call(server: RunningServer) -> None:
    second = _call("nap", seconds=0.125)
    with _connect(server) as connection:
        connection.sendall(_call("nap", seconds=0.25) + second[:-6])
        time.sleep(0.1)  # meanwhile the first call runs
        connection.sendall(second[-6:])
        answers = _answers(connection, 2)
    assert answers == [(200, {"result": 0.25}), (200, {"result": 0.125})]


@pytest.mark.parametrize("timeout_s", [0, 0.02, 0.2])
def test_a_deadline_is_kept_whoever_waits_for_it(
    server: RunningServer, tmp_path: Path, timeout_s: float
) -> None:
    address = f"{server.url}/services/bench/Pause/stay?timeout={timeout_s}"
    end = tmp_path / "end"
    try:  # the call itself ends after the answer only
        answer = httpx.post(address, json={"file": str(end)}, timeout=60)
    finally:
        end.touch()
    assert (answer.status_code, answer.json()["type"]) == (504, "/errors/deadline")


@pytest.mark.parametrize("after_s", [0, 0.1])
def test_a_call_whose_client_leaves_is_cancelled(
    server: RunningServer, tmp_path: Path, after_s: float
) -> None:
    with _connect(server) as connection:
        connection.sendall(_call("wait", folder=str(tmp_path)))
        _wait_for(tmp_path / "begun")
        time.sleep(after_s)
    _wait_for(tmp_path / "cancelled")


def test_a_client_that_leaves_before_its_body_has_come_hurts_nobody(server: RunningServer) -> None:
    for after_s in (0, 0.1):
        with _connect(server) as connection:
            connection.sendall(_call("nap", seconds=0)[:-4])
            time.sleep(after_s)
    assert httpx.get(f"{server.url}/health/live").status_code == 200


def test_a_long_answer_is_sent_whole_and_a_connection_is_closed_when_asked(
    server: RunningServer,
) -> None:
    with _connect(server) as connection:
        connection.sendall(
            _call("write", size=300_000) + _call("write", "Connection: close", size=1)
        )
        answers = _answers(connection, 2)
        assert connection.recv(1) == b""
    assert [len(body["result"]) for _, body in answers] == [300_000, 1]


def _wait_for(file: Path) -> None:
    until = time.monotonic() + 60
    while not file.exists():
        assert time.monotonic() < until, f"{file.name} did not happen"
        time.sleep(0.005)
