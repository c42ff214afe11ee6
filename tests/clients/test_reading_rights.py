"""Tokens that are limited to some graphs: no surface of a server shows them any other graph."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.commands import run_command
from tests.servers import RunningServer, bearer, new_application, running_server

pytestmark = pytest.mark.slow

OPEN, ALSO, SECRET = (
    "http://lab.example/open",
    "http://lab.example/also",
    "http://lab.example/vault",
)
MARK = "zebrafish"
_UNHURRIED = ("--rate", "0", "--write-rate", "0")
_TURTLE = {"Content-Type": "text/turtle"}
_CLASS = "http://www.w3.org/2000/01/rdf-schema#"
_DATA = {
    OPEN: f'<urn:mug> <urn:p> "plain" . <urn:mug> a <urn:Cup> . <urn:Cup> <{_CLASS}label> "cup" .',
    ALSO: '<urn:mug> <urn:p> "plain" . <urn:pot> <urn:p> "pot" .',
    SECRET: f'<urn:mug> <urn:p> "{MARK}" . <urn:mug> <urn:q> <urn:{MARK}> . '
    f'<urn:Cup> <{_CLASS}subClassOf> <urn:Kind{MARK}> . <urn:mug> <{_CLASS}label> "{MARK}" .',
}

_TRIED = [("GET", accept) for accept in ("text/html", "application/json", "text/event-stream")]
_TRIED += [(method, "application/json") for method in ("POST", "PUT", "DELETE")]


def _send(method: str, url: str, **options: Any) -> httpx.Response:
    return httpx.request(method, url, timeout=60, **options)


@dataclass(frozen=True)
class Lab:
    """A server with a secret graph, and header fields of its callers."""

    url: str
    websocket: str
    folder: Path
    admin: dict[str, str]
    stranger: dict[str, str]
    both: dict[str, str]
    secret: dict[str, str]

    def ask(self, text: str, who: dict[str, str] | None = None, **fields: Any) -> httpx.Response:
        """Send a query; as the stranger if nobody is named."""
        headers = {"Accept": "text/csv", **(self.stranger if who is None else who)}
        if text.startswith(("CONSTRUCT", "DESCRIBE")):
            headers["Accept"] = "application/n-triples"
        params = {"query": text, **fields}
        return _send("GET", self.url + "/sparql", params=params, headers=headers)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("lab") / "store"
    rtask.open(folder, ontologies=False).close()
    with closing(TokenStore(folder)) as tokens:
        admin = bearer(tokens.create("admin")[0])
        stranger = bearer(tokens.create("reader", rights=[f"read:{OPEN}"])[0])
        both = bearer(tokens.create("reader", rights=[f"read:{OPEN}", f"read:{ALSO}"])[0])
        secret = bearer(tokens.create("reader", rights=[f"read:{SECRET}"])[0])
    with running_server(folder, *_UNHURRIED) as server:
        for graph, turtle in _DATA.items():
            done = _send(
                "PUT",
                f"{server.url}/store",
                params={"graph": graph},
                content=turtle,
                headers={**_TURTLE, **admin},
            )
            assert done.status_code == 201, done.text
        yield Lab(server.url, server.websocket, folder, admin, stranger, both, secret)


@pytest.mark.parametrize(
    "text",
    [
        "SELECT * { ?s ?p ?o }",
        "SELECT * { GRAPH ?g { ?s ?p ?o } }",
        f"SELECT * {{ GRAPH <{SECRET}> {{ ?s ?p ?o }} }}",
        "SELECT * { <urn:mug> (<urn:q>|!<urn:z>)* ?o }",
        "SELECT * { <urn:mug> a/!<urn:z> ?c }",
        "SELECT * { <urn:mug> ?p ?o }",
        "SELECT * { GRAPH ?g { <urn:mug> !<urn:z> ?o } }",
        "SELECT * { <urn:mug> a ?inferred }",
        "DESCRIBE <urn:mug>",
        "DESCRIBE ?s { ?s a <urn:Cup> }",
        "CONSTRUCT { ?s ?p ?o } { { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }",
    ],
)
def test_no_query_shows_another_graph_and_twice_is_no_different(lab: Lab, text: str) -> None:
    # Asked repeatedly and by turns, so that answers come from memory as well.
    for _ in range(3):
        theirs = lab.ask(text, lab.admin)
        own = lab.ask(text)
        assert theirs.status_code == own.status_code == 200, own.text
        assert MARK not in own.text
        assert "/vault" not in own.text
        if SECRET not in text:
            assert MARK in theirs.text
            assert own.text.strip()


@pytest.mark.parametrize("also", [{}, {"inferred": "1"}, {"timeout": "9"}])
def test_counts_are_those_of_the_callers_graphs(lab: Lab, also: dict[str, str]) -> None:
    def number(text: str, who: dict[str, str], **fields: Any) -> str:
        answer = lab.ask(text, who, **also, **fields)
        assert answer.status_code == 200, answer.text
        return answer.text.split()[1]

    count = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
    named = "SELECT (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } }"
    graphs = "SELECT (COUNT(*) AS ?n) { GRAPH ?g {} }"
    for _ in range(3):
        assert [number(one, lab.stranger) for one in (count, named, graphs)] == ["3", "3", "1"]
        assert [number(one, lab.secret) for one in (count, named, graphs)] == ["4", "4", "1"]
        one = {"default-graph-uri": ALSO, "named-graph-uri": [OPEN, ALSO, OPEN]}
        assert [number(text, lab.both, **one) for text in (count, named, graphs)] == ["2", "5", "2"]


def test_only_the_own_graph_exists(lab: Lab) -> None:
    for text in (f"ASK {{ GRAPH <{SECRET}> {{}} }}", "ASK { FILTER EXISTS { ?s <urn:q> ?o } }"):
        assert lab.ask(text).text.strip() == "false"
    assert lab.ask(f"ASK {{ GRAPH <{OPEN}> {{}} }}").text.strip() == "true"


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("SELECT * { ?s ?p ?o }", {"default-graph-uri": SECRET}),
        ("SELECT * { GRAPH ?g { ?s ?p ?o } }", {"named-graph-uri": [OPEN, SECRET]}),
        ("SELECT * { ?s ?p ?o }", {"default-graph-uri": "urn:there-is-no-such-graph"}),
        (f"SELECT * FROM <{SECRET}> {{ ?s ?p ?o }}", {}),
        (f"SELECT * FROM NAMED <{SECRET}> {{ GRAPH ?g {{ ?s ?p ?o }} }}", {}),
        (f'SELECT * {{ SERVICE <urn:rtask:text> {{ ?s <urn:rtask:words> "{MARK}" }} }}', {}),
        (f"SELECT * {{ SERVICE <urn:rtask:place> {{ ?s <{ontology.FUNCTIONS}near> ?o }} }}", {}),
        ("SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }", {}),
        ("SELECT * { \\u0053ERVICE <urn:rtask:text> { ?s ?p ?o } }", {}),
    ],
)
def test_what_asks_for_another_graph_is_refused(
    lab: Lab, text: str, fields: dict[str, Any]
) -> None:
    answer = lab.ask(text, **fields)
    assert answer.status_code == 403, answer.text


def test_a_reader_of_several_graphs_sees_them_as_one_set(lab: Lab) -> None:
    count = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
    fields = {"default-graph-uri": [OPEN, ALSO]}
    for _ in range(3):
        for sent in ({}, fields, {"named-graph-uri": [OPEN, ALSO], **fields}):
            answer = lab.ask(count, lab.both, **sent)
            assert answer.text.split() == ["n", "4"], answer.text
            # One of the five statements is in both graphs.
            rows = lab.ask("SELECT ?o { ?s <urn:p> ?o }", lab.both, **sent).text.split()
            assert sorted(rows) == ["o", "plain", "pot"]
    by_graph = lab.ask("SELECT (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } }", lab.both)
    assert by_graph.text.split() == ["n", "5"]
    assert MARK not in lab.ask("SELECT * { ?s ?p ?o }", lab.both).text
    refused = {"default-graph-uri": [OPEN, SECRET]}
    assert lab.ask(count, lab.both, **refused).status_code == 403


def test_forms_and_bodies_are_limited_like_addresses(lab: Lab) -> None:
    text = "SELECT * { { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }"
    typed = {"Content-Type": "application/sparql-query", "Accept": "text/csv"}
    for address in ("/sparql", "/query"):
        for who, is_shown in ((lab.admin, True), (lab.stranger, False)):
            form = _send("POST", lab.url + address, data={"query": text}, headers=who)
            body = _send("POST", lab.url + address, content=text, headers={**typed, **who})
            assert form.status_code == body.status_code == 200
            assert (MARK in form.text, MARK in body.text) == (is_shown, is_shown)


def test_the_graph_store_opens_the_own_graph_only(lab: Lab) -> None:
    def get(method: str = "GET", **fields: str) -> httpx.Response:
        return _send(method, lab.url + "/store", params=fields, headers=lab.stranger)

    assert '"plain"' in get(graph=OPEN).text
    assert MARK not in get(graph=OPEN).text
    for fields in ({"graph": SECRET}, {"default": ""}, {}, {"graph": "urn:no-such-graph"}):
        for method in ("GET", "HEAD", "PUT", "POST", "DELETE"):
            assert get(method, **fields).status_code == 403, (method, fields)
    assert get("DELETE", graph=OPEN).status_code == 403
    direct = _send("GET", lab.url + "/store/anything", headers=lab.stranger)
    assert direct.status_code == 403


def test_graphs_that_the_knowledge_base_keeps_are_given_to_nobody(lab: Lab) -> None:
    with rtask.open(lab.folder, mode="r") as kb:
        kept = [kb.graphs.inferred, kb.graphs.provenance, kb.graphs.meta, kb.graphs.quarantine]
    with closing(TokenStore(lab.folder)) as tokens:
        for graph in kept:
            who = bearer(tokens.create("reader", rights=[f"read:{graph.value}"])[0])
            assert lab.ask("SELECT * { ?s ?p ?o }", who).status_code == 403
            params = {"graph": graph.value}
            whole = _send("GET", lab.url + "/store", params=params, headers=who)
            assert whole.status_code == 403


@pytest.fixture(scope="module")
def addresses(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """All addresses that the server has rules for, and those that it serves without one."""
    with rtask.open(":memory:", ontologies=False) as kb, closing(TokenStore(None)) as tokens:
        application: Application = new_application(kb, NoEngine(), tokens, Config())
        try:
            rules = [rule.rule for rule in create_app(application).url_map.iter_rules()]
        finally:
            application.close()
    more = [
        "/changes",
        *(f"/changes/{number}" for number in range(1, 7)),
        "/activity/events",
        "/activity/stream",
    ]
    more += ["/replicate/records", "/replicate/snapshot", "/metrics", "/queries", "/backup"]
    more += ["/api/robots", "/api/objects", "/api/tasks", "/api/outcomes", "/api/history"]
    more += ["/api/blobs/" + "0" * 64, "/mcp", "/mcp/services", "/datasets", "/services", "/jobs"]
    more += ["/engine/x"]
    more += ["/engine/search_object", "/reasoner/rules", "/sparql/check", "/tokens/ticket", "/"]
    more += ["/search?q=zebra", "/resource?iri=urn:mug", "/resource.json?iri=urn:mug"]
    more += ["/openapi.json", "/sparql/", "//sparql", "/sparql%2f", "/%73parql/check"]
    return sorted({*rules, *more} - {"/logout"})  # would end the session that is tried


_IN_THE_OPEN = ("/health", "/static", "/login")


def test_every_other_address_is_closed(lab: Lab, addresses: list[str]) -> None:
    assert len(addresses) > 60
    with httpx.Client(base_url=lab.url, timeout=60) as client:
        signed_in = client.post(
            "/login",
            data={"token": lab.stranger["Authorization"].removeprefix("Bearer ")},
            headers={"Origin": lab.url},
        )
        cookie = {"Cookie": signed_in.headers["set-cookie"].partition(";")[0]}
        for rule in addresses:
            address = rule
            while "<" in address:
                before, _, rest = address.partition("<")
                address = before + "x" + rest.partition(">")[2]
            tried = [(lab.stranger, *one) for one in _TRIED] + [(cookie, "GET", "text/html")]
            for who, method, accept in tried:
                headers = {**who, "Accept": accept, "Origin": lab.url}
                params = {"iri": "urn:mug"} if "?" not in address else None
                answer = client.request(method, address, params=params, headers=headers)
                where = (method, address, accept, answer.status_code, answer.text[:200])
                assert MARK not in answer.text, where
                assert answer.status_code < 500, where
                assert answer.status_code != 429, "so nothing was tried"
                assert address.startswith(_IN_THE_OPEN) or answer.status_code >= 400, where
        page = {**lab.admin, "Accept": "text/html"}
        assert MARK in client.get("/resource?iri=urn:mug", headers=page).text
        last = client.get("/health").json()["seq"]
        commits = (client.get(f"/changes/{n}", headers=lab.admin) for n in range(1, last + 1))
        assert any(MARK in commit.text for commit in commits)
        still = client.get("/objects", headers={**cookie, "Accept": "text/html"})
        assert still.status_code == 403  # signed in to the end


def test_websockets_are_closed(lab: Lab) -> None:
    for path in ("/", "/rosbridge", "/changes"):
        with pytest.raises(InvalidStatus) as caught:
            connect(
                lab.websocket.rstrip("/") + path, additional_headers=lab.stranger, open_timeout=60
            ).close()
        assert caught.value.response.status_code == 403
    with connect(
        lab.websocket.rstrip("/") + "/rosbridge", additional_headers=lab.admin, open_timeout=60
    ):
        pass


def test_nobody_reads_without_a_token(lab: Lab) -> None:
    assert lab.ask("ASK {}", {}).status_code == 401
    for address in ("/changes", "/api/objects", "/store", "/metrics"):
        assert _send("GET", lab.url + address).status_code == 401


def test_what_was_open_closes_when_the_first_token_is_limited(tmp_path: Path) -> None:
    rtask.open(tmp_path / "store", ontologies=False).close()
    with running_server(tmp_path / "store") as server:
        with connect(server.websocket, open_timeout=60) as robot:
            with closing(TokenStore(tmp_path / "store")) as tokens:
                tokens.create("reader", rights=[f"read:{OPEN}"])
            with pytest.raises(ConnectionClosedError, match="revoked"):
                robot.recv(timeout=60)
        _wait_for(lambda: _send("GET", server.url + "/store").status_code == 401)


def test_a_follower_limits_the_same_tokens(tmp_path: Path, lab: Lab) -> None:
    file = tmp_path / "token"
    with closing(TokenStore(lab.folder)) as tokens:
        file.write_text(tokens.create("reader", rights=["replicate"])[0], "utf-8")
    where = ("--follow", lab.url, "--token-file", str(file))
    with running_server(tmp_path / "copy", *where) as copy:
        there = _at(copy, lab)
        text = "SELECT * { { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }"
        _wait_for(lambda: MARK in there.ask(text, lab.admin).text)
        for _ in range(3):
            assert MARK not in there.ask(text).text
            assert "plain" in there.ask(text).text
        for address in ("/changes", "/api/objects", "/search?q=x", "/store"):
            assert _send("GET", copy.url + address, headers=lab.stranger).status_code == 403
        update = {"update": "INSERT DATA { <urn:a> <urn:b> 1 }"}
        done = _send("POST", copy.url + "/update", data=update, headers=lab.stranger)
        assert done.status_code == 403
        assert there.ask("ASK {}", {}).status_code == 401


def _at(server: RunningServer, lab: Lab) -> Lab:
    callers = (lab.admin, lab.stranger, lab.both, lab.secret)
    return Lab(server.url, server.websocket, lab.folder, *callers)


def _wait_for(condition: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.05)


@pytest.mark.parametrize(
    "options",
    [
        ("--robot", "nao-1", "--right", f"read:{OPEN}"),
        ("--role", "admin", "--right", f"read:{OPEN}"),
        ("--role", "reader", "--right", f"read:{OPEN}", "--right", "replicate"),
        ("--role", "reader", "--right", "read:"),
        ("--role", "reader", "--right", "read:not an iri"),
        ("--role", "reader", "--right", "reads:urn:x"),
    ],
)
def test_a_limit_that_would_not_hold_is_not_given(tmp_path: Path, options: tuple[str, ...]) -> None:
    rtask.open(tmp_path / "store", ontologies=False).close()
    done = run_command("token", "create", "-d", str(tmp_path / "store"), *options)
    assert done.returncode in (2, 3)
    assert "read" in done.stderr
    with closing(TokenStore(tmp_path / "store")) as tokens:
        assert tokens.all() == []
