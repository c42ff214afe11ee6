"""Bad input of every kind is answered, and the server lives."""

from __future__ import annotations

import socket

import httpx
import pytest

from tests.servers import RunningServer

pytestmark = pytest.mark.slow

QUERY_TYPE = {"Content-Type": "application/sparql-query"}
UPDATE_TYPE = {"Content-Type": "application/sparql-update"}


@pytest.mark.parametrize(
    ("text", "status", "slug"),
    [
        ("SELECT ?x WHERE { ?x", 400, "query-syntax"),
        ("", 400, "query-syntax"),
        ("# only a comment", 400, "query-syntax"),
        ("SELECT * {" + "{" * 10_000, 400, "query-too-complex"),
        ("SELECT * { FILTER(" + "!" * 10_000 + "?x) }", 400, "query-too-complex"),
        ("ASK {" + " UNION ".join(["{ ?s ?p ?o }"] * 10_000) + "}", 400, "query-too-complex"),
        (
            "ASK {" + ".".join(f"?s <urn:{i}> ?o" for i in range(999)) + "}",
            400,
            "query-too-complex",
        ),
        ("INSERT DATA { <urn:s> <urn:p> 1 }", 400, "query-syntax"),
        ("SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }", 403, None),
        ("SELECT * { ?s ?p ?o } # " + "x" * 2_000_000, 413, "too-large"),
    ],
)
def test_a_bad_query_is_refused(
    client: httpx.Client, text: str, status: int, slug: str | None
) -> None:
    answer = client.post("/sparql", content=text, headers=QUERY_TYPE)
    assert answer.status_code == status, answer.text[:300]
    assert answer.headers["content-type"] == "application/problem+json"
    if slug:
        assert answer.json()["type"] == f"/errors/{slug}"
    assert client.get("/sparql", params={"query": "ASK {}"}).json()["boolean"] is True


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("INSERT DATA { ?s <urn:p> 1 }", 400),
        ("DELETE DATA { _:b <urn:p> 1 }", 400),
        ("CLEAR XYZ", 400),
        ("SELECT * { ?s ?p ?o }", 400),
        ("LOAD <file:///etc/passwd>", 403),
        ("LOAD <http://127.0.0.1:1/>", 403),
        ("INSERT { <urn:s> <urn:p> ?o } WHERE { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }", 403),
    ],
)
def test_a_bad_update_is_refused(client: httpx.Client, text: str, status: int) -> None:
    answer = client.post("/update", content=text, headers=UPDATE_TYPE)
    assert answer.status_code == status, answer.text[:300]
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_failing_update_leaves_nothing_of_its_beginning(client: httpx.Client) -> None:
    graph = "urn:g:half"
    text = f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:half> <urn:p> 1 }} }} ; CREATE GRAPH <{graph}>"
    assert client.post("/update", content=text, headers=UPDATE_TYPE).status_code >= 400
    query = {"query": f"ASK {{ GRAPH <{graph}> {{ ?s ?p ?o }} }}"}
    assert client.get("/sparql", params=query).json()["boolean"] is False


def test_a_large_table_of_values_is_answered_whole(client: httpx.Client) -> None:
    values = " ".join(f'"{number:06d}"' for number in range(60_000))
    text = f"SELECT ?v {{ VALUES ?v {{ {values} }} }}"
    answer = client.post("/sparql", content=text, headers=QUERY_TYPE)
    assert len(answer.json()["results"]["bindings"]) == 60_000


def test_silent_calls_to_elsewhere_give_one_empty_solution(client: httpx.Client) -> None:
    text = "SELECT * { SERVICE SILENT <http://127.0.0.1:1/> { ?s ?p ?o } }"
    answer = client.get("/sparql", params={"query": text})
    assert answer.json()["results"]["bindings"] == [{}]


def test_control_bytes_do_not_break_xml(client: httpx.Client) -> None:
    query = {"query": r'SELECT ("a\u0008b" AS ?v) {}'}
    answer = client.get(
        "/sparql", params=query, headers={"Accept": "application/sparql-results+xml"}
    )
    assert "a\ufffdb" in answer.text


@pytest.mark.parametrize(
    "path",
    [
        "/api/blobs/../../kb.json",
        "/api/blobs/..%2F..%2Fkb.json",
        "/api/blobs/%2e%2e/%2e%2e/tokens.sqlite",
        "/api/blobs//etc/passwd",
        "/api/blobs/" + "0" * 63,
        "/api/blobs/" + "G" * 64,
        "/api/blobs/" + "0" * 64,
        "/static/../app.py",
        "/static/..%2fapp.py",
        "/static/%2e%2e/%2e%2e/pyproject.toml",
    ],
)
def test_no_path_leads_out_of_the_house(server: RunningServer, path: str) -> None:
    """Sent byte for byte: clients would tidy the dots away."""
    head, body = raw(server, f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
    assert int(head.split()[1]) in (400, 403, 404)
    assert b"SQLite" not in body
    assert b"import" not in body


def test_a_body_that_is_cut_off_is_not_executed(
    client: httpx.Client, server: RunningServer
) -> None:
    whole = "INSERT DATA { GRAPH <urn:g:cut> { <urn:s> <urn:p> 1 } } # and a long comment"
    head = (
        "POST /update HTTP/1.1\r\nHost: localhost\r\n"
        f"Content-Type: application/sparql-update\r\nContent-Length: {len(whole)}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall((head + whole[:-20]).encode())
    query = {"query": "ASK { GRAPH <urn:g:cut> { ?s ?p ?o } }"}
    assert client.get("/sparql", params=query).json()["boolean"] is False


def test_a_chunked_body_arrives_whole(server: RunningServer) -> None:
    def pieces() -> object:
        yield b"ASK "
        yield b"{}"

    answer = httpx.post(f"{server.url}/sparql", content=pieces(), headers=QUERY_TYPE)  # type: ignore[arg-type]
    assert answer.json()["boolean"] is True


@pytest.mark.parametrize("method", ["FOO", "TRACE", "PATCH"])
def test_an_unknown_method_is_405(server: RunningServer, method: str) -> None:
    head, _ = raw(
        server, f"{method} /sparql HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    )
    assert int(head.split()[1]) in (400, 405)


def test_nowhere_is_404_with_a_problem_for_programs_and_a_page_for_people(
    client: httpx.Client,
) -> None:
    assert client.get("/nowhere").headers["content-type"] == "application/problem+json"
    page = client.get("/nowhere", headers={"Accept": "text/html"})
    assert page.status_code == 404
    assert page.headers["content-type"].startswith("text/html")


def raw(server: RunningServer, text: str) -> tuple[str, bytes]:
    """Send bytes as they are; return the head of the answer and its body."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall(text.encode())
        received = b""
        while piece := connection.recv(65_536):
            received += piece
    head, _, body = received.partition(b"\r\n\r\n")
    return head.decode("latin-1"), body
