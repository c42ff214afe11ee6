"""A bare dataset or a server of RTASK over SPARQL 1.1 Protocol: calls, retries and refusals."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    ClosedError,
    ForbiddenError,
    QuerySyntaxError,
    QueryTimeout,
    RemoteUnavailableError,
    UnsupportedError,
    UsageError,
)
from rtask.rdf.terms import BlankNode, iri
from rtask.remote import knowledge_base as remote
from rtask.remote import transport as wire
from rtask.sparql.results import Triples


class Server(ThreadingHTTPServer):
    """A SPARQL server of thirty lines; ``faults`` are status codes that come first."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.store = ox.Store()
        self.faults: list[int] = []
        self.words = b'{"detail": "not now"}'
        self.requests: list[str] = []
        self.truncate = False
        self.go_on = threading.Event()
        self.go_on.set()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of clients that left; other tests look at standard error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]  # any socket


class Handler(BaseHTTPRequestHandler):
    """Answers queries and updates sent as forms (SPARQL 1.1 Protocol, 2.1.2 and 2.2.1)."""

    server: Server

    def do_POST(self) -> None:
        form = parse_qs(self.rfile.read(int(self.headers["Content-Length"])).decode())
        [text] = form.get("query", []) + form.get("update", [])
        self.server.requests.append(text)
        if self.headers.get("Authorization") != "Bearer secret":
            return self._answer(401, b'{"detail": "no token"}')
        self.server.go_on.wait(60.0)
        if self.server.faults:
            return self._answer(self.server.faults.pop(0), self.server.words)
        if "update" in form:
            self.server.store.update(text)
            return self._answer(204, b"")
        dataset: dict[str, Any] = {}
        if "default-graph-uri" in form:
            dataset["default_graph"] = [ox.NamedNode(g) for g in form["default-graph-uri"]]
        found: Any = self.server.store.query(
            text, use_default_graph_as_union=not dataset, **dataset
        )
        triples = isinstance(found, ox.QueryTriples)
        form: Any = ox.RdfFormat.N_TRIPLES if triples else ox.QueryResultsFormat.JSON
        body = found.serialize(format=form)
        return self._answer(200, body[:-5] if self.server.truncate else body)

    def _answer(self, status: int, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(wire, "_PAUSE_S", 0.0)
    with Server() as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.01,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


@pytest.fixture
def kb(server: Server) -> Iterator[rtask.KnowledgeBase]:
    address = f"http://127.0.0.1:{server.server_port}/sparql"
    with rtask.open(address, token="secret", plain=True) as opened:
        server.requests.clear()
        yield opened


def test_queries_and_updates_work_as_on_an_embedded_store(kb: rtask.KnowledgeBase) -> None:
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1, 'two'@en . _:b <urn:p> <urn:a> } }")
    rows = kb.select("SELECT ?o { <urn:a> <urn:p> ?o } ORDER BY ?o", bindings={"o": [1, 7]})
    assert rows.to_dicts() == [{"o": 1}]
    assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
    built = kb.query("CONSTRUCT WHERE { <urn:a> <urn:p> ?o }")
    assert isinstance(built, Triples)
    assert len(built) == 2
    [quad] = kb.match("urn:a", None, 1)
    assert quad.graph_name == iri("urn:g")
    assert kb.query("ASK { <urn:a> ?p ?o }", default_graphs=["urn:other"]) is False
    assert b'"boolean":true' in kb.serialize("ASK {}", "application/sparql-results+json")


def test_a_transaction_is_one_request(kb: rtask.KnowledgeBase, server: Server) -> None:
    with kb.transaction() as tx:
        tx.add("urn:a", "urn:p", 'a "quoted"\nline', "urn:g")
        tx.update("INSERT { ?s <urn:q> true } WHERE { GRAPH <urn:g> { ?s <urn:p> ?o } }")
        tx.remove("urn:a", "urn:p", 'a "quoted"\nline', "urn:g")
    assert len(server.requests) == 1
    assert [str(q.triple) for q in server.store] == [
        '<urn:a> <urn:q> "true"^^<http://www.w3.org/2001/XMLSchema#boolean>'
    ]

    def broken() -> None:
        with kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 2)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        broken()
    with kb.transaction() as tx, pytest.raises(UnsupportedError, match="blank nodes"):
        tx.remove(BlankNode(), "urn:p", 1)
    assert len(server.requests) == 1


def test_documents_are_sent_in_pieces(
    kb: rtask.KnowledgeBase, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PIECE", 4)
    text = "_:b <urn:p> _:c . _:c <urn:p> 1 . <urn:a> <urn:p> " + ", ".join(map(str, range(9)))
    count: Any = kb.load((text + " .").encode(), format="turtle", graph="urn:g")
    assert count == 11
    assert len(server.requests) == 3
    assert server.store.query("ASK { GRAPH <urn:g> { ?b <urn:p> ?c . ?c <urn:p> 1 } }")
    assert len(server.store) == 11


def test_errors_found_here_are_not_sent(kb: rtask.KnowledgeBase, server: Server) -> None:
    with pytest.raises(QuerySyntaxError, match="query 1:"):
        kb.query("SELECT ?x WHERE {")
    with pytest.raises(QuerySyntaxError, match="update 1:"):
        kb.update("INSERT DATA { ?s <urn:p> 1 }")
    assert server.requests == []


def test_reads_are_tried_again_and_updates_only_if_they_did_not_run(
    kb: rtask.KnowledgeBase, server: Server
) -> None:
    server.faults = [502, 504]
    assert kb.query("ASK {}") is True
    assert len(server.requests) == 3
    server.faults = [503]
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    server.requests.clear()
    server.faults = [504, 504]
    with pytest.raises(RemoteUnavailableError, match="504 not now"):
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
    assert len(server.requests) == 1


def test_what_lost_a_deadlock_is_sent_again(kb: rtask.KnowledgeBase, server: Server) -> None:
    server.words = b"Virtuoso 40001 Error SR172: Transaction deadlocked"
    server.faults = [500, 500]
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    assert server.faults == []
    server.faults = [500]
    assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
    server.words = b"Virtuoso 37000 Error SP030"
    server.faults = [500]
    with pytest.raises(CallFailedError, match="37000"):
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
    assert kb.query("ASK { <urn:a> <urn:p> 2 }") is False


def test_refusals_keep_their_meaning(kb: rtask.KnowledgeBase, server: Server) -> None:
    server.faults = [403]
    with pytest.raises(ForbiddenError, match="403 not now"):
        kb.update("CLEAR ALL")
    with pytest.raises(AuthenticationError, match="no token"):
        rtask.open(kb.query_url, plain=True)  # type: ignore[attr-defined]


def test_an_answer_that_breaks_off_is_an_error(kb: rtask.KnowledgeBase, server: Server) -> None:
    server.truncate = True
    with pytest.raises(RemoteUnavailableError, match="broke off"):
        kb.query("SELECT * { VALUES ?x { 1 2 3 } }")


def test_nobody_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "_PAUSE_S", 0.0)
    with pytest.raises(RemoteUnavailableError, match=r"127\.0\.0\.1:9"):
        rtask.open("http://127.0.0.1:9/sparql", plain=True)
    with (
        rtask.open("sparql+http://127.0.0.1:9/?query=/sparql", plain=True) as kb,
        pytest.raises(RemoteUnavailableError, match=r"127\.0\.0\.1:9"),
    ):
        kb.update("CLEAR ALL")


def test_a_deadline_ends_the_waiting(kb: rtask.KnowledgeBase, server: Server) -> None:
    server.go_on.clear()
    with pytest.raises(QueryTimeout, match=r"within 0\.3 s"):
        kb.query("ASK { ?s ?p ?o }", timeout_s=0.3)
    server.go_on.set()
    assert kb.query("ASK { ?s ?p ?o }", timeout_s=30.0) is False


def test_what_needs_the_embedded_store_says_so(kb: rtask.KnowledgeBase) -> None:
    for name in ("graphs", "blobs", "explain", "verify", "history"):
        with pytest.raises(UnsupportedError, match=f"{name} needs the embedded store"):
            getattr(kb, name)
    with pytest.raises(UnsupportedError, match="neither agents nor notes"):
        kb.update("CLEAR ALL", agent="nao-1")
    with pytest.raises(UnsupportedError, match="neither agents nor notes"):
        kb.transaction(agent="nao-1")
    with pytest.raises(UnsupportedError, match="neither agents nor notes"):
        kb.transaction(note="first sight")
    with pytest.raises(AttributeError):
        kb.nonsense  # type: ignore[attr-defined]  # noqa: B018
    kb.close()
    with pytest.raises(ClosedError):
        kb.query("ASK {}")
    with pytest.raises(UsageError, match="names no query endpoint"):
        rtask.open("sparql+http://127.0.0.1:9/")
