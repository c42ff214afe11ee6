"""SERVICE and LOAD reach the addresses that an operator allowed, and nothing else."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx
import pytest

from endpoint.http.outbound_http import Outgoing
from rtask.errors import ForbiddenError
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

UPDATE = {"Content-Type": "application/sparql-update"}
ROWS = {
    "head": {"vars": ["s", "n"]},
    "results": {
        "bindings": [
            {
                "s": {"type": "uri", "value": "urn:mug"},
                "n": {"type": "literal", "value": 'a "mug"', "xml:lang": "en"},
            },
            {"s": {"type": "bnode", "value": "b0"}},
        ]
    },
}


class Elsewhere(BaseHTTPRequestHandler):
    """Another server: answers, answers rubbish, redirects, or takes its time."""

    asked: list[str]
    released = threading.Event()  # what is slow waits for this

    def do_POST(self) -> None:
        """Answer SPARQL."""
        body = self.rfile.read(int(self.headers["Content-Length"]))
        type(self).asked.append(body.decode())
        self._answer()

    def do_GET(self) -> None:
        """Answer a document."""
        type(self).asked.append(self.path)
        self._answer()

    def _answer(self) -> None:
        if self.path.endswith("/slow"):
            type(self).released.wait(120)
        if self.path.endswith("/away"):
            self.send_response(302)
            self.send_header("Location", "/ok/rows")
            self.end_headers()
            return
        kinds = {
            "rows": ("application/sparql-results+json", json.dumps(ROWS)),
            "doc": ("text/turtle", "<urn:loaded> <urn:p> <relative> ."),
            "bad": ("text/turtle", "<urn:half> <urn:p> "),
        }
        name = self.path.rpartition("/")[2]
        media_type, text = kinds.get(name, ("text/html", "<p>hello"))
        self.send_response(200)
        self.send_header("Content-Type", media_type)
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


class QuietServer(ThreadingHTTPServer):
    """A server whose clients may leave early."""

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of clients that left; other tests look at standard error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]  # any socket


@pytest.fixture(scope="module")
def elsewhere() -> Iterator[str]:
    Elsewhere.asked = []
    server = QuietServer(("127.0.0.1", 0), Elsewhere)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="module")
def allowing(elsewhere: str) -> Iterator[RunningServer]:
    ok = f"{elsewhere}/ok"
    with running_server(None, "--allow-service", ok, "--allow-load", ok) as running:
        yield running


@pytest.fixture
def client(allowing: RunningServer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=allowing.url, timeout=60) as connected:
        yield connected


def ask(client: httpx.Client, text: str, **more: str) -> httpx.Response:
    return client.post("/query", data={"query": text, **more})


def update(client: httpx.Client, text: str) -> httpx.Response:
    return client.post("/update", content=text, headers=UPDATE)


def test_a_service_gives_its_solutions(client: httpx.Client, elsewhere: str) -> None:
    text = f"PREFIX x: <urn:> SELECT * {{ SERVICE <{elsewhere}/ok/rows> {{ ?s x:name ?n }} }}"
    rows = ask(client, text).json()["results"]["bindings"]
    mug = next(row for row in rows if row["s"]["value"] == "urn:mug")
    assert mug["n"] == {"type": "literal", "value": 'a "mug"', "xml:lang": "en"}
    assert len(rows) == 2
    assert "PREFIX x: <urn:>" in Elsewhere.asked[-1]
    assert "?s x:name ?n" in Elsewhere.asked[-1]


def test_its_solutions_are_joined_with_what_is_here(client: httpx.Client, elsewhere: str) -> None:
    update(client, "INSERT DATA { <urn:mug> <urn:on> <urn:table> }")
    text = f"SELECT * {{ ?s <urn:on> ?t . SERVICE <{elsewhere}/ok/rows> {{ ?s ?p ?n }} }}"
    rows = ask(client, text).json()["results"]["bindings"]
    assert [(row["t"]["value"], row["n"]["value"]) for row in rows] == [("urn:table", 'a "mug"')]


@pytest.mark.parametrize("path", ["/no/rows", "/okay/rows", "/ok/../no", "/ok/%2e%2e/no"])
def test_other_addresses_are_refused_before_anybody_calls(
    client: httpx.Client, elsewhere: str, path: str
) -> None:
    before = len(Elsewhere.asked)
    for silent in ("", "SILENT"):
        answer = ask(client, f"SELECT * {{ SERVICE {silent} <{elsewhere}{path}> {{ ?s ?p ?o }} }}")
        assert answer.status_code == 403, answer.text
        assert answer.json()["type"] == "/errors/service-not-allowed"
        assert update(client, f"LOAD {silent} <{elsewhere}{path}>").status_code == 403
    assert len(Elsewhere.asked) == before


@pytest.mark.parametrize("path", ["/ok/away", "/ok/rubbish"])
def test_a_service_that_fails_is_502_or_one_empty_solution(
    client: httpx.Client, elsewhere: str, path: str
) -> None:
    answer = ask(client, f"SELECT * {{ SERVICE <{elsewhere}{path}> {{ ?s ?p ?o }} }}")
    assert answer.status_code == 502
    silent = ask(client, f"SELECT * {{ SERVICE SILENT <{elsewhere}{path}> {{ ?s ?p ?o }} }}")
    assert silent.json()["results"]["bindings"] == [{}]


def test_a_slow_service_ends_with_the_query(client: httpx.Client, elsewhere: str) -> None:
    text = f"SELECT * {{ SERVICE <{elsewhere}/ok/slow> {{ ?s ?p ?o }} }}"
    try:
        assert ask(client, text, timeout="1").status_code in (502, 504)
    finally:
        Elsewhere.released.set()


def test_a_variable_service_is_refused(client: httpx.Client) -> None:
    assert ask(client, "SELECT * { SERVICE ?s { ?s ?p ?o } }").status_code == 403


def test_load_is_one_commit_with_its_neighbours(client: httpx.Client, elsewhere: str) -> None:
    text = (
        "PREFIX e: <urn:> INSERT DATA { GRAPH e:before { e:a e:b 1 } } ; "
        f"LOAD <{elsewhere}/ok/doc> INTO GRAPH e:loaded ; "
        "PREFIX f: <urn:> INSERT { GRAPH e:after { ?s f:seen true } } "
        "WHERE { GRAPH f:loaded { ?s ?p ?o } }"
    )
    answer = client.post("/update", content=text, headers={**UPDATE, "Accept": "application/json"})
    assert answer.status_code == 200, answer.text
    assert answer.json()["added"] == 3
    found = ask(client, "ASK { GRAPH <urn:after> { <urn:loaded> <urn:seen> true } }").json()
    assert found["boolean"] is True
    base = f"ASK {{ GRAPH <urn:loaded> {{ <urn:loaded> <urn:p> <{elsewhere}/ok/relative> }} }}"
    assert ask(client, base).json()["boolean"] is True


def test_a_failing_load_leaves_nothing_of_its_request(client: httpx.Client, elsewhere: str) -> None:
    text = "INSERT DATA {{ GRAPH <urn:lost> {{ <urn:a> <urn:b> 1 }} }} ; LOAD {} <{}/ok/bad>"
    assert update(client, text.format("", elsewhere)).status_code == 502
    assert ask(client, "ASK { GRAPH <urn:lost> { ?s ?p ?o } }").json()["boolean"] is False
    assert update(client, text.format("SILENT", elsewhere)).status_code == 204
    assert ask(client, "ASK { GRAPH <urn:lost> { ?s ?p ?o } }").json()["boolean"] is True


@pytest.mark.parametrize(
    "url", ["file:///etc/passwd", "data:text/turtle,<a>", "ftp://x/y", "http://user@h/ok"]
)
def test_other_schemes_are_never_allowed(url: str) -> None:
    with pytest.raises(ForbiddenError):
        Outgoing("LOAD", ("file:///", "data:", "ftp://x", "http://h/ok")).check(url)


def test_a_name_that_means_this_machine_is_no_way_in(monkeypatch: pytest.MonkeyPatch) -> None:
    def getaddrinfo(host: str, port: int, **_: object) -> list[Any]:
        return [(2, 1, 6, "", ("127.0.0.1", port))]

    monkeypatch.setattr("socket.getaddrinfo", getaddrinfo)
    outgoing = Outgoing("SERVICE", ("http://public.example/sparql",))
    with pytest.raises(ForbiddenError, match="address of this network"):
        outgoing.fetch("http://public.example/sparql", time.monotonic() + 5, accept="*/*")


def test_an_update_that_would_hold_the_writers_lock_for_hours_is_refused_in_time(
    client: httpx.Client,
) -> None:
    endless = "INSERT { <urn:x> <urn:y> ?n } WHERE { SELECT (COUNT(*) AS ?n) { %s } }"
    product = " . ".join(f"?a{i} ?b{i} ?c{i}" for i in range(4))
    answer = update(client, endless % product)
    assert answer.status_code == 504
    assert "nothing was stored" in answer.json()["detail"]
    assert update(client, "INSERT DATA { <urn:still> <urn:here> 1 }").status_code == 204
