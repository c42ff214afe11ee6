"""Queries that repeat the header of their connection are answered as any other."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

NAME = "urn:known"
JSON = "application/sparql-results+json"
# Quick by its looks: each pattern starts from a constant. There are 27 million combinations.
SLOW = (
    f"SELECT ?a {{ <{NAME}:hub> <{NAME}:has> ?a . <{NAME}:hub> <{NAME}:has> ?b . "
    f"<{NAME}:hub> <{NAME}:has> ?c FILTER(STRLEN(CONCAT(STR(?a), STR(?b), STR(?c))) < 3) }}"
)


def value(number: int) -> str:
    return f"SELECT ?o {{ <{NAME}:{number}> <{NAME}:is> ?o }}"


@dataclass
class Lab:
    """A server with tokens."""

    server: RunningServer
    tokens: TokenStore
    admin: str

    def update(self, text: str) -> None:
        httpx.post(
            f"{self.server.url}/update",
            data={"update": text},
            headers={"Authorization": f"Bearer {self.admin}"},
            timeout=60,
        ).raise_for_status()

    def connection(self, token: str, **fields: str) -> Connection:
        lines = {"Host": "localhost", "Accept": JSON, "Authorization": f"Bearer {token}", **fields}
        return Connection(self.server.port, lines)


@dataclass
class Connection:
    """A kept connection whose requests all have the same header."""

    port: int
    fields: dict[str, str]
    _socket: socket.socket = field(init=False)
    _ahead: bytes = b""

    def __post_init__(self) -> None:
        self._socket = socket.create_connection(("127.0.0.1", self.port), timeout=60)

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def request(self, text: str, more: str = "") -> bytes:
        lines = [f"{name}: {value}" for name, value in self.fields.items()]
        first = f"GET /query?query={quote(text, safe='')}{more} HTTP/1.1"
        return "\r\n".join([first, *lines, "", ""]).encode()

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def answer(self) -> tuple[int, dict[str, str], bytes]:
        """Return status, header fields and body of the next response."""
        head, _, rest = self._until(lambda data: b"\r\n\r\n" in data).partition(b"\r\n\r\n")
        first, *lines = head.decode().split("\r\n")
        fields = {k.lower(): v for k, _, v in (line.partition(": ") for line in lines)}
        if fields.get("transfer-encoding") == "chunked":
            self._ahead = rest
            body = self._until(lambda data: data.endswith(b"0\r\n\r\n"))
            self._ahead = b""
            return int(first.split()[1]), fields, body
        length = int(fields.get("content-length", "0"))
        self._ahead = rest
        data = self._until(lambda data: len(data) >= length)
        self._ahead = data[length:]
        return int(first.split()[1]), fields, data[:length]

    def _until(self, is_enough) -> bytes:  # type: ignore[no-untyped-def]
        data = self._ahead
        while not is_enough(data):
            piece = self._socket.recv(1 << 16)
            assert piece, "the server closed the connection"
            data += piece
        return data

    def ask(self, text: str, more: str = "") -> tuple[int, dict[str, str], bytes]:
        self.send(self.request(text, more))
        return self.answer()

    def become_known(self) -> None:
        """Ask until the server knows the header."""
        for _ in range(3):
            assert self.ask(value(0))[0] == 200


@pytest.fixture(scope="module", params=["--no-cache", "--cache"])
def lab(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder: Path = tmp_path_factory.mktemp("lab") / "kb"
    rtask.open(folder).close()
    tokens = TokenStore(folder)
    admin = tokens.create("admin")[0]
    options = ["--no-cache"] if request.param == "--no-cache" else []
    with running_server(folder, "--rate", "0", *options) as server:
        lab = Lab(server, tokens, admin)
        things = " ".join(f"<{NAME}:{n}> <{NAME}:is> {n} ." for n in range(50))
        hub = ", ".join(f"<{NAME}:h{n}>" for n in range(300))
        lines = ", ".join(f'"{n} {"x" * 60}"' for n in range(3_000))
        lab.update(f"INSERT DATA {{ {things} <{NAME}:hub> <{NAME}:has> {hub} }}")
        lab.update(f"INSERT DATA {{ <{NAME}:long> <{NAME}:line> {lines} }}")
        yield lab
    tokens.close()


@pytest.mark.parametrize("accept", [JSON, "text/csv", "*/*", "application/sparql-results+xml"])
@pytest.mark.parametrize("encoding", ["identity", "gzip"])
def test_answers_equal_those_of_other_requests(lab: Lab, accept: str, encoding: str) -> None:
    # Rows in a stated order: without one it may change when a reader takes its copy into memory.
    texts = [
        value(7),
        f"SELECT ?p ?o {{ <{NAME}:hub> ?p ?o }} ORDER BY ?o",
        f"ASK {{ <{NAME}:1> <{NAME}:is> 1 }}",
        f"SELECT ?o (NOW() AS ?t) {{ <{NAME}:1> <{NAME}:is> ?o }} LIMIT 0",
        "SELECT ?o { <#relative> ?p ?o }",
        "SELECT (COUNT(*) AS ?n) { ?s ?p ?o } ORDER BY ?n",
        f"SELECT ?o {{ <{NAME}:1> <{NAME}:is> ?o ",
        f"SELECT ?l {{ <{NAME}:long> <{NAME}:line> ?l }} ORDER BY ?l",
    ]
    fields = {"Accept": accept, "Accept-Encoding": encoding}
    with lab.connection(lab.admin, **fields) as known:
        known.become_known()
        for text in texts * 3:
            with lab.connection(lab.admin, **fields) as other:
                expected = other.ask(text)
            found = known.ask(text)
            assert found[0] == expected[0], text
            assert sorted(found[1]) == sorted(expected[1]), text
            own = ("date", "rtask-request-id", "content-length")
            for name in found[1].keys() - own:
                assert found[1][name] == expected[1][name], (text, name)
            if found[0] == 200:
                assert found[2] == expected[2] or "gzip" in found[1].get("content-encoding", "")


def test_each_answer_has_an_id_of_its_own(lab: Lab) -> None:
    with lab.connection(lab.admin) as known:
        known.become_known()
        ids = {known.ask(value(1))[1]["rtask-request-id"] for _ in range(5)}
    assert len(ids) == 5


def test_a_revoked_token_ends_what_its_connection_may_do(lab: Lab) -> None:
    text, token = lab.tokens.create("reader")
    with lab.connection(text) as known:
        known.become_known()
        assert known.ask(value(3))[0] == 200
        lab.tokens.revoke(token.id)
        end = time.monotonic() + 60
        while known.ask(value(3))[0] != 401:
            assert time.monotonic() < end
            time.sleep(0.05)


def test_a_caller_limited_to_some_graphs_reads_no_others(lab: Lab) -> None:
    secret, allowed = f"{NAME}:secret", f"{NAME}:allowed"
    lab.update(f"INSERT DATA {{ GRAPH <{secret}> {{ <{NAME}:x> <{NAME}:is> 'secret' }} }}")
    lab.update(f"INSERT DATA {{ GRAPH <{allowed}> {{ <{NAME}:x> <{NAME}:is> 'open' }} }}")
    text = f"SELECT ?o {{ <{NAME}:x> <{NAME}:is> ?o }}"
    limited = lab.tokens.create("reader", rights=(f"read:{allowed}",))[0]
    with lab.connection(limited) as one, lab.connection(lab.admin) as two:
        for _ in range(4):
            assert b"secret" in two.ask(text)[2]
            status, _, body = one.ask(text)
            assert status == 200
            assert b"open" in body
            assert b"secret" not in body


def test_no_answer_is_older_than_what_was_acknowledged(lab: Lab) -> None:
    text = f"SELECT ?o {{ <{NAME}:count> <{NAME}:is> ?o }}"
    with lab.connection(lab.admin) as known:
        known.become_known()
        for number in range(30):
            lab.update(
                f"DELETE WHERE {{ <{NAME}:count> <{NAME}:is> ?o }} ; "
                f"INSERT DATA {{ <{NAME}:count> <{NAME}:is> {number} }}"
            )
            for _ in range(3):
                rows = json.loads(known.ask(text)[2])["results"]["bindings"]
                assert [row["o"]["value"] for row in rows] == [str(number)]


def test_requests_may_come_together_or_in_parts(lab: Lab) -> None:
    with lab.connection(lab.admin) as known:
        known.become_known()
        known.send(b"".join(known.request(value(n)) for n in range(6)))
        for number in range(6):
            assert f'"{number}"'.encode() in known.answer()[2]
        whole = known.request(value(8))
        for cut in (1, 20, len(whole) - 70, len(whole) - 2):
            known.send(whole[:cut])
            time.sleep(0.02)  # so that the server sees it by itself
            known.send(whole[cut:])
            assert b'"8"' in known.answer()[2]
        known.send(known.request(value(9)) + whole[:30])
        assert b'"9"' in known.answer()[2]
        known.send(whole[30:])
        assert b'"8"' in known.answer()[2]


@pytest.mark.parametrize(
    ("more", "status"),
    [("&timeout=2", 200), ("&timeout=x", 400), ("&query=ASK", 400), ("%zz", 400), ("%00", 400)],
)
def test_what_is_not_a_plain_query_is_looked_at_closely(lab: Lab, more: str, status: int) -> None:
    with lab.connection(lab.admin) as known:
        known.become_known()
        assert known.ask(value(1), more)[0] == status
        assert known.ask(value(1))[0] == 200


def test_a_query_can_be_stopped_and_its_client_is_told(lab: Lab) -> None:
    headers = {"Authorization": f"Bearer {lab.admin}"}
    with lab.connection(lab.admin) as known, httpx.Client(base_url=lab.server.url) as other:
        known.become_known()
        known.send(known.request(SLOW))
        end = time.monotonic() + 60
        found: list[str] = []
        while not found:
            assert time.monotonic() < end
            running = other.get("/queries", headers=headers).json()["queries"]
            found = [query["id"] for query in running if query["query"] == SLOW]
        other.delete(f"/queries/{found[0]}", headers=headers)
        status, _, body = known.answer()
        assert (status, json.loads(body)["type"]) == (503, "/errors/query-stopped")
        assert known.ask(value(2))[0] == 200
