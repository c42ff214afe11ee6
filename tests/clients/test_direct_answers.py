"""Small queries by GET are answered by the server's protocol itself: same rules, same order."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable
from urllib.parse import quote

import httpx
import pytest

from tests.servers import RunningServer

pytestmark = pytest.mark.slow

NAME = "urn:direct"
VALUE = f"SELECT ?o {{ <{NAME}:n> <{NAME}:is> ?o }}"
JOINED = f"SELECT ?o ?r {{ <{NAME}:n> <{NAME}:is> ?o . <{NAME}:n> <{NAME}:was> ?r }}"
# Quick by its looks: each pattern starts from a constant. There are 27 million combinations.
SLOW = (
    f"SELECT ?a {{ <{NAME}:hub> <{NAME}:has> ?a . <{NAME}:hub> <{NAME}:has> ?b . "
    f"<{NAME}:hub> <{NAME}:has> ?c FILTER(STRLEN(CONCAT(STR(?a), STR(?b), STR(?c))) < 3) }}"
)


def _get(text: str, *fields: str, address: str = "/query", version: str = "1.1") -> bytes:
    lines = [f"GET {address}?query={quote(text)} HTTP/{version}", "Host: localhost", *fields]
    return "\r\n".join([*lines, "", ""]).encode()


def _answers(data: bytes) -> list[tuple[int, dict[str, str], bytes]]:
    """Split what a connection sent into status, header fields and body of each answer."""
    found = []
    while data:
        head, _, data = data.partition(b"\r\n\r\n")
        first, *lines = head.decode().split("\r\n")
        fields = {k.lower(): v for k, _, v in (line.partition(": ") for line in lines)}
        length = int(fields.get("content-length", "0"))
        found.append((int(first.split()[1]), fields, data[:length]))
        data = data[length:]
    return found


def _say(server: RunningServer, *requests: bytes) -> list[tuple[int, dict[str, str], bytes]]:
    """Send requests at once on one connection, the last of which closes it."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall(b"".join(requests))
        data = b""
        while piece := connection.recv(1 << 16):
            data += piece
    return _answers(data)


def _update(server: RunningServer, text: str) -> None:
    httpx.post(f"{server.url}/update", data={"update": text}, timeout=60).raise_for_status()


def test_requests_sent_at_once_are_answered_in_order(server: RunningServer) -> None:
    _update(server, f"INSERT DATA {{ <{NAME}:order> <{NAME}:is> 1, 2, 3 ; <{NAME}:was> 4 }}")
    look_up = f"SELECT ?o {{ <{NAME}:order> <{NAME}:was> ?o }}"
    counted = f"SELECT (COUNT(*) AS ?n) {{ <{NAME}:order> ?p ?o }}"
    answers = _say(
        server,
        _get(look_up),
        b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n",
        _get(counted, address="/sparql"),
        _get(look_up),
        _get("SELECT nonsense"),
        _get(look_up, "Connection: close"),
    )
    assert [status for status, _, _ in answers] == [200, 200, 200, 200, 400, 200]
    assert b'"4"' in answers[0][2]
    assert json.loads(answers[1][2]) == {"live": True}
    assert b'"4"' in answers[2][2]
    assert answers[3][2] == answers[0][2] == answers[5][2]
    assert json.loads(answers[4][2])["type"] == "/errors/query-syntax"
    assert answers[5][1]["connection"] == "close"
    for _, fields, _ in answers:
        assert fields["rtask-version"]
        assert fields["vary"]


@pytest.mark.slow
def test_what_is_answered_directly_equals_what_the_application_answers(
    server: RunningServer,
) -> None:
    _update(server, f"INSERT DATA {{ <{NAME}:n> <{NAME}:is> 1 ; <{NAME}:was> 2 }}")
    for text in (VALUE, JOINED, "ASK {}", "SELECT * {"):
        direct = httpx.get(f"{server.url}/query", params={"query": text}, timeout=60)
        posted = httpx.post(f"{server.url}/query", data={"query": text}, timeout=60)
        assert direct.status_code == posted.status_code
        for name in ("content-type", "etag", "vary", "rtask-version"):
            assert direct.headers.get(name) == posted.headers.get(name), name
        if direct.status_code == 200:
            assert direct.json() == posted.json()
            again = {"If-None-Match": direct.headers["etag"]}
            known = httpx.get(
                f"{server.url}/query", params={"query": text}, headers=again, timeout=60
            )
            assert (known.status_code, known.content) == (304, b"")


@pytest.mark.slow
@pytest.mark.parametrize("text", [VALUE, JOINED])
def test_no_reader_sees_less_than_was_acknowledged(server: RunningServer, text: str) -> None:
    """Equal questions while somebody counts up: the cache may not lag behind."""
    _update(server, f"DELETE WHERE {{ <{NAME}:n> ?p ?o }}")
    _update(server, f"INSERT DATA {{ <{NAME}:n> <{NAME}:is> 0 ; <{NAME}:was> 0 }}")
    acknowledged, failures = 0, []
    done = threading.Event()

    def read() -> None:
        with httpx.Client(base_url=server.url, timeout=60) as client:
            while not done.is_set():
                least = acknowledged
                answer = client.get("/query", params={"query": text})
                values = [int(row["o"]["value"]) for row in answer.json()["results"]["bindings"]]
                if answer.status_code != 200 or len(values) != 1 or values[0] < least:
                    failures.append((least, answer.status_code, values))

    readers = [threading.Thread(target=read) for _ in range(4)]
    for reader in readers:
        reader.start()
    try:
        for number in range(1, 41):
            _update(
                server,
                f"DELETE {{ <{NAME}:n> <{NAME}:is> ?o }} INSERT {{ <{NAME}:n> <{NAME}:is> "
                f"{number} }} WHERE {{ <{NAME}:n> <{NAME}:is> ?o }}",
            )
            acknowledged = number
    finally:
        done.set()
        for reader in readers:
            reader.join()
    assert failures == []


def _wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


@pytest.mark.slow
def test_a_query_that_only_looks_quick_is_stopped_when_its_client_leaves(
    server: RunningServer,
) -> None:
    values = ", ".join(f"<{NAME}:{n}>" for n in range(300))
    _update(server, f"INSERT DATA {{ <{NAME}:hub> <{NAME}:has> {values} }}")

    def running() -> list[str]:
        queries = httpx.get(f"{server.url}/queries", timeout=60).json()["queries"]
        return [query["query"] for query in queries if query["query"] == SLOW]

    for pause_s in (0.0, 1.5):  # among the quick ones, and after it was found to be slow
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.sendall(_get(SLOW))
            _wait_until(lambda: len(running()) == 1)
            time.sleep(pause_s)
        _wait_until(lambda: not running())
    with contextlib.closing(httpx.Client(base_url=server.url, timeout=60)) as client:
        assert client.get("/query", params={"query": "ASK {}"}).json()["boolean"] is True


@pytest.mark.slow
def test_a_query_that_only_looks_quick_is_answered_within_its_own_limit(
    server: RunningServer,
) -> None:
    values = ", ".join(f"<{NAME}:{n}>" for n in range(300))
    _update(server, f"INSERT DATA {{ <{NAME}:hub> <{NAME}:has> {values} }}")
    late = httpx.get(f"{server.url}/query", params={"query": SLOW, "timeout": "2"}, timeout=60)
    assert late.status_code == 504
    assert late.json()["limit"] == 2


@pytest.mark.slow
def test_a_long_answer_goes_on_beyond_its_first_piece(server: RunningServer) -> None:
    lines = " ".join(f"<{NAME}:long> <{NAME}:line> 'line {n} {'x' * 60}' ." for n in range(5_000))
    _update(server, f"INSERT DATA {{ {lines} }}")
    text = f"SELECT ?o ?p {{ <{NAME}:long> <{NAME}:line> ?o ; ?p ?o }}"
    answer = httpx.get(f"{server.url}/query", params={"query": text}, timeout=60)
    assert answer.status_code == 200
    assert len(answer.json()["results"]["bindings"]) == 5_000


def test_old_clients_and_heads_are_answered_too(server: RunningServer) -> None:
    ((status, fields, body),) = _say(server, _get("ASK {}", version="1.0"))
    assert (status, json.loads(body)["boolean"]) == (200, True)
    head = _get("ASK {}", "Connection: close").replace(b"GET", b"HEAD", 1)
    ((status, fields, body),) = _say(server, head)
    assert (status, body) == (200, b"")
    assert "etag" in fields
