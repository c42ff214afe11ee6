"""Following the graph: nothing missed, nothing twice, whatever happens to the connection."""

from __future__ import annotations

import contextlib
import http.client
import json
import queue
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

GRAPH = "urn:g:followed"


class Events:
    """Server-sent events as a browser reads them."""

    def __init__(
        self, url: str, method: str = "GET", headers: Any = None, body: Any = None
    ) -> None:
        parts = urlsplit(url)
        self._connection = http.client.HTTPConnection(parts.netloc, timeout=60)
        self._connection.connect()
        self._socket = self._connection.sock
        kind = {} if body is None else {"Content-Type": "application/json"}
        self._connection.request(
            method,
            f"{parts.path}?{parts.query}",
            None if body is None else json.dumps(body),
            {**kind, **(headers or {})},
        )
        self.response = self._connection.getresponse()
        assert self.response.status == 200, self.response.read()
        self._events: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self.last_id = ""
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        fields: dict[str, str] = {}
        with contextlib.suppress(OSError, ValueError, http.client.HTTPException):
            while raw := self.response.readline():
                line = raw.decode().rstrip("\n")
                if not line and fields:
                    self._events.put({**fields, "data": json.loads(fields.get("data", "{}"))})
                    fields = {}
                elif line and not line.startswith(":"):
                    name, _, value = line.partition(": ")
                    fields[name] = value
        self._events.put(None)

    def next(self, timeout: float = 20) -> dict[str, Any] | None:
        """Wait for the next event; none at the end of the stream."""
        found = self._events.get(timeout=timeout)
        if found is not None and "id" in found:
            self.last_id = found["id"]
        return found

    def values(self, count: int) -> list[int]:
        """Return the numbers that the next changes added."""
        found: list[int] = []
        while len(found) < count:
            event = self.next()
            assert event is not None, f"the stream ended after {found}"
            if event["event"] == "change":
                found += [int(q[2].split('"')[1]) for q in event["data"]["added"]]
        return found

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(60)
        self.response.close()
        self._connection.close()

    def __enter__(self) -> Events:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def write(server: RunningServer, *numbers: int, subject: str = "urn:s") -> None:
    for number in numbers:
        text = f"INSERT DATA {{ GRAPH <{GRAPH}> {{ <{subject}> <urn:p> {number} }} }}"
        httpx.post(f"{server.url}/update", data={"update": text}, timeout=60).raise_for_status()


def changes(server: RunningServer, **parameters: str) -> str:
    return f"{server.url}/changes?{httpx.QueryParams(parameters)}"


@pytest.fixture
def followed(server: RunningServer) -> Iterator[RunningServer]:
    yield server
    text = f"DROP SILENT GRAPH <{GRAPH}>"
    httpx.post(f"{server.url}/update", data={"update": text}, timeout=60)


def test_a_commit_arrives_with_its_statements_and_its_version(followed: RunningServer) -> None:
    with Events(changes(followed, s="urn:s", p="<urn:p>")) as events:
        assert events.response.getheader("content-type") == "text/event-stream"
        hello = events.next()
        assert hello is not None
        assert hello["event"] == "hello"
        write(followed, 7)
        write(followed, 99, subject="urn:other")
        write(followed, 8)
        first = events.next()
        assert first is not None
        assert first["event"] == "change"
        number = '"7"^^<http://www.w3.org/2001/XMLSchema#integer>'
        assert first["data"]["added"] == [["<urn:s>", "<urn:p>", number, f"<{GRAPH}>"]]
        assert first["id"].endswith(f":{first['data']['seq']}")
        assert events.values(1) == [8]  # what was said of another subject is not heard


def test_a_lost_connection_goes_on_without_gap_or_repeat(followed: RunningServer) -> None:
    with Events(changes(followed, s="urn:s")) as events:
        write(followed, 1, 2)
        assert events.values(2) == [1, 2]
        seen = events.last_id
    write(followed, 3, 4)  # nobody listens
    header = {"Last-Event-ID": seen}
    with Events(changes(followed, s="urn:s"), headers=header) as events:
        write(followed, 5)
        assert events.values(3) == [3, 4, 5]
    with Events(changes(followed, s="urn:s", since=seen)) as events:
        assert events.values(3) == [3, 4, 5]


@pytest.mark.slow
def test_a_killed_server_loses_no_event(tmp_path: Path) -> None:
    with running_server(tmp_path / "store") as server:
        with Events(changes(server, s="urn:s")) as events:
            write(server, 1)
            assert events.values(1) == [1]
            seen = events.last_id
            write(server, 2)
        server.stop(signal.SIGKILL)
    with running_server(tmp_path / "store") as server:
        header = {"Last-Event-ID": seen}
        with Events(changes(server, s="urn:s"), headers=header) as events:
            write(server, 3)
            assert events.values(2) == [2, 3]


@pytest.mark.slow
def test_a_stopping_server_says_goodbye(tmp_path: Path) -> None:
    with running_server(None) as server, Events(changes(server)) as events:
        events.next()
        with connect(f"{server.websocket}changes") as follower:
            follower.recv(timeout=60)
            assert server.stop() == 0
            with pytest.raises(ConnectionClosed) as closed:
                follower.recv(timeout=60)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1012
        bye = events.next()
        assert bye is not None
        assert (bye["event"], events.next()) == ("bye", None)


def test_what_is_no_longer_kept_is_told(followed: RunningServer) -> None:
    epoch = httpx.get(f"{followed.url}/health").json()["epoch"]
    foreign = f"{'0' * len(epoch)}:1"
    refused = httpx.get(changes(followed, since=foreign))
    assert refused.status_code == 410
    assert refused.json()["type"] == "/errors/epoch-changed"
    with Events(changes(followed, s="urn:s"), headers={"Last-Event-ID": foreign}) as events:
        events.next()
        told = events.next()
        assert told is not None
        assert told["event"] == "epoch"
        assert told["id"].startswith(epoch)  # a browser that comes back goes on from here
        write(followed, 1)
        assert events.values(1) == [1]
    future = httpx.get(changes(followed, since=f"{epoch}:999999"))
    assert future.status_code == 400


@pytest.mark.parametrize(
    ("parameters", "part"),
    [
        ({"s": "not an iri <>"}, "s:"),
        ({"p": '"text"@en'}, "p: expected an IRI"),
        ({"o": '"x" . <urn:a> <urn:b> <urn:c>'}, "o:"),
        ({"since": "yesterday"}, "since"),
        ({"inferred": "perhaps"}, "inferred"),
        ({"pattern": "{"}, "not JSON"),
        ({"pattern": '{"subject": "urn:s"}'}, "unknown field"),
        ({"pattern": "[" * 9_000}, "JSON"),
    ],
)
def test_a_faulty_wish_is_refused(
    server: RunningServer, parameters: dict[str, str], part: str
) -> None:
    refused = httpx.get(changes(server, **parameters))
    assert refused.status_code == 400
    assert part in refused.json()["detail"]


def test_other_methods_media_types_and_addresses_are_refused(server: RunningServer) -> None:
    url = f"{server.url}/changes"
    assert httpx.put(url).status_code == 405
    assert httpx.post(url, content=b"{}").status_code == 415
    assert httpx.post(url, json={"patterns": 1}).status_code == 400
    assert httpx.post(url, json={"patterns": [{}] * 101}).status_code == 400
    assert httpx.get(f"{url}/999999999").status_code == 404
    assert httpx.get(f"{url}/x").status_code == 404


def test_a_large_commit_is_shortened_and_can_be_fetched_whole(followed: RunningServer) -> None:
    many = " ".join(f"<urn:s> <urn:p> {n} ." for n in range(1_500))
    with Events(changes(followed, s="urn:s")) as events:
        events.next()
        text = f"INSERT DATA {{ GRAPH <{GRAPH}> {{ {many} }} }}"
        httpx.post(f"{followed.url}/update", data={"update": text}, timeout=60)
        told = events.next()
    assert told is not None
    assert told["data"]["truncated"] is True
    assert told["data"]["statements"] == 1_500
    whole = httpx.get(followed.url + told["data"]["whole"]).json()
    assert len(whole["added"]) == 1_500


def test_several_patterns_are_one_stream(followed: RunningServer) -> None:
    body = {"patterns": [{"s": "urn:a"}, {"s": "urn:b", "p": "urn:p"}, {"graph": "urn:g:none"}]}
    with Events(f"{followed.url}/changes", method="POST", body=body) as events:
        events.next()
        write(followed, 1, subject="urn:a")
        write(followed, 2, subject="urn:c")
        write(followed, 3, subject="urn:b")
        both = f"<{GRAPH}> {{ <urn:a> <urn:p> 4 . <urn:b> <urn:p> 5 . <urn:c> <urn:p> 6 }}"
        httpx.post(f"{followed.url}/update", data={"update": f"INSERT DATA {{ GRAPH {both} }}"})
        assert events.values(4) == [1, 3, 4, 5]


def say(socket: ClientConnection, **message: Any) -> dict[str, Any]:
    socket.send(json.dumps(message))
    return hear(socket)


def hear(socket: ClientConnection) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(socket.recv(timeout=60))
    return found


def test_a_websocket_follows_patterns_and_queries(followed: RunningServer) -> None:
    with connect(f"{followed.websocket}changes") as socket:
        assert hear(socket)["op"] == "hello"
        subscribed = say(socket, op="subscribe", id="a", patterns=[{"s": "urn:s"}])
        assert (subscribed["op"], subscribed["id"]) == ("subscribed", "a")
        write(followed, 1)
        change = hear(socket)
        assert (change["op"], change["id"]) == ("change", "a")
        assert change["added"][0][0] == "<urn:s>"
        say(socket, op="unsubscribe", id="a")
        select = "SELECT ?o { GRAPH ?g { <urn:s> <urn:p> ?o } }"
        assert say(socket, op="query", id=7, select=select)["op"] == "subscribed"
        first = hear(socket)
        assert (first["op"], first["id"], len(first["added"])) == ("rows", 7, 1)
        write(followed, 2)
        second = hear(socket)
        assert [row["o"].split('"')[1] for row in second["added"]] == ["2"]
        again = say(socket, op="subscribe", id="b", patterns=[{"s": "urn:s"}],
                    since=change["version"])  # fmt: skip
        assert again["op"] == "subscribed"
        replayed = hear(socket)
        assert replayed["added"][0][2].split('"')[1] == "2"


@pytest.mark.parametrize(
    "message",
    [
        "{",
        "[]",
        {"op": "fly", "id": 1},
        {"op": ["subscribe"], "id": 1},
        {"op": "subscribe"},
        {"op": "subscribe", "id": [1]},
        {"op": "subscribe", "id": 1, "patterns": "all"},
        {"op": "subscribe", "id": 1, "patterns": [1]},
        {"op": "subscribe", "id": 1, "since": {}},
        {"op": "unsubscribe", "id": "never"},
        {"op": "query", "id": 1},
        {"op": "query", "id": 1, "select": "SELECT nonsense"},
        {"op": "query", "id": 1, "select": "ASK {}"},
    ],
)
def test_rubbish_on_the_websocket_is_answered_and_it_stays(
    server: RunningServer, message: Any
) -> None:
    with connect(f"{server.websocket}changes") as socket:
        hear(socket)
        socket.send(message if isinstance(message, str) else json.dumps(message))
        told = hear(socket)
        if told["op"] == "subscribed":  # the text was understood to be a query's
            told = hear(socket)
        assert told["op"] == "error"
        assert told["status"] < 500
        assert say(socket, op="subscribe", id="fine", patterns=[])["op"] == "subscribed"


def test_a_page_of_another_origin_cannot_follow_by_websocket(server: RunningServer) -> None:
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(
            f"{server.websocket}changes",
            additional_headers={"Origin": "http://evil.example"},
        ),
    ):
        pass
    assert refused.value.response.status_code == 403


@pytest.mark.slow
def test_a_follower_that_does_not_read_harms_nobody(followed: RunningServer) -> None:
    """The socket's buffers fill, then the queue; writers and other followers never wait."""
    with (
        # It does not read, so that nothing answers the end of the connection.
        connect(f"{followed.websocket}changes", max_queue=1, close_timeout=0.1) as asleep,
        Events(changes(followed, s="urn:s")) as events,
    ):
        say(asleep, op="subscribe", id="a", patterns=[{"s": "urn:s"}])
        words = "x" * 100_000
        for number in range(20):
            text = (
                f"INSERT DATA {{ GRAPH <{GRAPH}> {{ <urn:s> <urn:p> {number} ; "
                f'<urn:words> "{number}{words}" }} }}'
            )
            done = httpx.post(f"{followed.url}/update", data={"update": text}, timeout=60)
            assert done.status_code == 204
        events.next()
        seen = [events.next() for _ in range(20)]
    assert all(event is not None and event["event"] == "change" for event in seen)


def test_a_parameter_that_would_select_nothing_is_refused_by_name(server: RunningServer) -> None:
    answer = httpx.get(changes(server, subject="urn:s"))
    assert answer.status_code == 400
    assert answer.json()["parameter"] == "subject"
