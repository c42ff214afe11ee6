"""Servers of many layouts are opened by the address that a person has: host, dataset or page."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import AuthenticationError, CallFailedError, UsageError
from rtask.remote import transport
from rtask.remote.knowledge_base import RemoteKnowledgeBase
from tests.sparql_servers import OXIGRAPH, Oxigraph

_PAGE = "<html><form action=/find></form></html>"
_REPOSITORIES = {"results": {"bindings": [{"id": {"value": n}} for n in ("SYSTEM", "lab one")]}}
_DATASETS = {"datasets": [{"ds.name": "/robots"}]}
LAYOUTS: dict[str, dict[str, Any]] = {
    "oxigraph 0.2": {"/query": "query", "/update": "update", "/": _PAGE},
    "fuseki": {
        "/$/datasets": _DATASETS,
        "/robots": "both",
        "/robots/query": "query",
        "/robots/sparql": "query",
        "/robots/update": "update",
    },
    "fuseki, list refused": {"/$/datasets": 401, "/ds/sparql": "query", "/ds/update": "update"},
    "graphdb": {
        "/": _PAGE,
        "/sparql": _PAGE,
        "/query": _PAGE,
        "/update": _PAGE,
        "/repositories": _REPOSITORIES,
        "/repositories/lab%20one": "query",
        "/repositories/lab%20one/statements": "update",
    },
    "rdf4j": {
        "/rdf4j-server/repositories": _REPOSITORIES,
        "/rdf4j-server/repositories/lab%20one": "query",
        "/rdf4j-server/repositories/lab%20one/statements": "update",
    },
    "virtuoso": {"/": _PAGE, "/sparql": "both"},
    "stardog": {
        "/admin/databases": {"databases": ["catalog", "lab"]},
        "/lab/query": "query",
        "/lab/update": "update",
    },
    "one address for all": {"/": "both"},
    "blazegraph": {"/": _PAGE, "/blazegraph/namespace/kb/sparql": "both"},
}
AT_HOST = {
    "oxigraph 0.2": ("/query", "/update"),
    "fuseki": ("/robots", "/robots"),
    "fuseki, list refused": ("/ds/sparql", "/ds/update"),
    "graphdb": ("/repositories/lab%20one", "/repositories/lab%20one/statements"),
    "rdf4j": (
        "/rdf4j-server/repositories/lab%20one",
        "/rdf4j-server/repositories/lab%20one/statements",
    ),
    "virtuoso": ("/sparql", "/sparql"),
    "stardog": ("/lab/query", "/lab/update"),
    "one address for all": ("", ""),
    "blazegraph": ("/blazegraph/namespace/kb/sparql", "/blazegraph/namespace/kb/sparql"),
}


class StandIn(ThreadingHTTPServer):
    """A SPARQL server whose endpoints are where ``layout`` says."""

    layout: dict[str, Any]

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.store = ox.Store()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Handler(BaseHTTPRequestHandler):
    server: StandIn

    def do_GET(self) -> None:
        place = self.server.layout.get(urlsplit(self.path).path)
        if isinstance(place, dict):
            return self._answer(200, "application/json", json.dumps(place))
        return self._elsewhere(place)

    def do_POST(self) -> None:
        form = parse_qs(self.rfile.read(int(self.headers["Content-Length"])).decode())
        place = self.server.layout.get(self.path)
        if place not in ("query", "update", "both"):
            return self._elsewhere(place)
        wants = "query" if "query" in form else "update"
        if place not in (wants, "both"):
            return self._answer(400, "text/plain", f"parameter {place} is missing")
        if wants == "update":
            self.server.store.update(form["update"][0])
            return self._answer(204, "text/plain", "")
        rows: Any = self.server.store.query(form["query"][0], use_default_graph_as_union=True)
        body = rows.serialize(format=ox.QueryResultsFormat.JSON).decode()
        return self._answer(200, "application/sparql-results+json", body)

    def _elsewhere(self, place: object) -> None:
        if isinstance(place, int):
            return self._answer(place, "text/plain", "give name and password")
        if isinstance(place, str):
            return self._answer(200, "text/html; charset=utf-8", place)
        return self._answer(404, "text/plain", "")

    def _answer(self, status: int, kind: str, body: str) -> None:
        data = body.encode()
        self.send_response(status)
        if data:
            self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args: object) -> None:
        """Log nothing."""


@pytest.fixture(scope="module")
def running() -> Iterator[StandIn]:
    with StandIn() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def server(running: StandIn, monkeypatch: pytest.MonkeyPatch) -> StandIn:
    monkeypatch.setattr(transport, "_PAUSE_S", 0.0)
    running.store.clear()
    return running


def _open(address: str, **options: Any) -> RemoteKnowledgeBase:
    kb = rtask.open(address, plain=True, **options)
    assert isinstance(kb, RemoteKnowledgeBase)
    return kb


def _places(kb: RemoteKnowledgeBase, server: StandIn) -> tuple[str, str]:
    return kb.query_url.removeprefix(server.url), kb.update_url.removeprefix(server.url)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_address_of_the_host_is_enough(layout: str, server: StandIn) -> None:
    server.layout = LAYOUTS[layout]
    with _open(server.url) as kb:
        assert _places(kb, server) == AT_HOST[layout]
        assert len(server.store) == 0
        kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } }")
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True


@pytest.mark.parametrize(
    ("layout", "typed", "query", "update"),
    [
        ("oxigraph 0.2", "/query", "/query", "/update"),
        ("oxigraph 0.2", "/update", "/query", "/update"),
        ("oxigraph 0.2", "/sparql", "/query", "/update"),
        ("fuseki", "/robots", "/robots", "/robots"),
        ("fuseki", "/robots/", "/robots/sparql", "/robots/update"),
        ("fuseki", "/robots/query", "/robots/query", "/robots/update"),
        ("fuseki", "/robots/sparql", "/robots/sparql", "/robots/update"),
        ("graphdb", *["/repositories/lab%20one"] * 2, "/repositories/lab%20one/statements"),
        ("rdf4j", "/rdf4j-server", *AT_HOST["rdf4j"]),
        ("blazegraph", "/blazegraph", *AT_HOST["blazegraph"]),
        ("stardog", "/lab", "/lab/query", "/lab/update"),
        ("one address for all", "/sparql", "/", "/"),
    ],
)
def test_the_address_of_a_dataset_or_of_either_endpoint_is_enough(
    layout: str, typed: str, query: str, update: str, server: StandIn
) -> None:
    server.layout = LAYOUTS[layout]
    with _open(server.url + typed) as kb:
        assert _places(kb, server) == (query, update)


def test_the_place_taken_is_stated_with_the_address_that_needs_no_search(
    server: StandIn, caplog: pytest.LogCaptureFixture
) -> None:
    server.layout = LAYOUTS["graphdb"]
    with caplog.at_level(logging.WARNING), _open(server.url) as kb:
        query_url, update_url = kb.query_url, kb.update_url
    [line] = caplog.messages
    assert f"queries at {query_url} and updates at {update_url}" in line
    explicit = next(word for word in line.split() if word.startswith("sparql+"))
    caplog.clear()
    with _open(explicit) as kb:
        assert (kb.query_url, kb.update_url) == (query_url, update_url)
    assert not caplog.messages


def test_where_nothing_answers_the_places_tried_and_the_explicit_form_are_named(
    server: StandIn,
) -> None:
    server.layout = {"/": _PAGE}
    with pytest.raises(CallFailedError) as failed:
        rtask.open(server.url)
    words = str(failed.value)
    assert "/sparql (404), /query (404)" in words
    assert "/repositories (404)" in words
    assert f"sparql+{server.url}/?query=/PATH&update=/PATH" in words


@pytest.mark.parametrize("typed", ["localhost:7878", "127.0.0.1:3030/ds", "lab-pc.example.org:80"])
def test_an_address_without_http_makes_no_folder(
    typed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=f"open http://{typed}, or for a new folder"):
        rtask.open(typed)
    assert not list(tmp_path.iterdir())
    with rtask.open(f"./{typed}", ontologies=False):
        assert Path(typed).is_dir()
    with rtask.open(typed, ontologies=False) as kb:
        assert kb.seq == 0


def test_several_datasets_are_listed_and_none_is_guessed(server: StandIn) -> None:
    server.layout = {"/$/datasets": {"datasets": [{"ds.name": "/a"}, {"ds.name": "/b"}]}}
    with pytest.raises(CallFailedError, match="several datasets") as failed:
        rtask.open(server.url)
    assert f"{server.url}/a, {server.url}/b" in str(failed.value)


def test_a_list_of_another_kind_is_passed_over(server: StandIn) -> None:
    odd = {"datasets": None, "results": [], "databases": 7}
    lists = ("/$/datasets", "/repositories", "/admin/databases")
    server.layout = {**dict.fromkeys(lists, odd), "/ds/query": "both"}
    with _open(server.url) as kb:
        assert _places(kb, server) == ("/ds/query", "/ds/query")


def test_a_server_that_wants_a_password_first_says_so(server: StandIn) -> None:
    server.layout = {"/": 401, "/sparql": "both"}
    with pytest.raises(AuthenticationError, match="give name and password"):
        rtask.open(server.url)


def test_a_server_without_updates_can_be_read_but_not_written(
    server: StandIn, tmp_path: Path
) -> None:
    server.layout = {"/sparql": "query"}
    with _open(server.url) as kb:
        assert kb.query("ASK {}") is True
    with pytest.raises(UsageError, match=r"no usual place there takes updates.*mode='r'"):
        rtask.open(server.url, folder=tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(OXIGRAPH is None, reason="no oxigraph server; pip install oxigraph")
def test_a_knowledge_base_on_oxigraph_is_opened_by_the_address_of_the_host(
    tmp_path: Path,
) -> None:
    server = Oxigraph(tmp_path / "server")
    server.start()
    try:
        options: dict[str, Any] = {"folder": tmp_path / "kb", "ontologies": False, "reason": False}
        with rtask.open(server.url, **options) as kb, kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 1)
        for address in (server.url + "/query", server.url + "/sparql", tmp_path / "kb"):
            with rtask.open(address, **options) as kb:
                assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
    finally:
        server.kill()
