"""Whole graphs over HTTP (SPARQL 1.1 Graph Store HTTP Protocol)."""

from __future__ import annotations

import uuid
from urllib.parse import quote, unquote

import httpx
import pyoxigraph
import pytest
from rdflib import Graph, Literal, URIRef

from tests.servers import RunningServer

TURTLE = {"Content-Type": "text/turtle"}
ONE = "<http://example.org/s> <http://example.org/p> 'é' ."


@pytest.fixture
def address() -> str:
    """A graph that is not there yet, by its indirect address."""
    return "/store?graph=" + quote(f"http://example.org/{uuid.uuid4()}", safe="")


def ask(client: httpx.Client, query: str) -> bool:
    return bool(client.get("/sparql", params={"query": query}).json()["boolean"])


def test_put_get_replace_delete(client: httpx.Client, address: str) -> None:
    assert client.get(address).status_code == 404
    assert client.put(address, content=ONE, headers=TURTLE).status_code == 201
    assert client.put(address, content=ONE, headers=TURTLE).status_code == 204
    answer = client.get(address, headers={"Accept": "application/n-triples"})
    graph = Graph().parse(data=answer.text, format="nt")
    assert list(graph) == [
        (URIRef("http://example.org/s"), URIRef("http://example.org/p"), Literal("é"))
    ]
    assert client.delete(address).status_code == 204
    assert client.get(address).status_code == 404
    assert client.delete(address).status_code == 404


def test_post_merges_and_keeps_blank_nodes_of_two_posts_apart(
    client: httpx.Client, address: str
) -> None:
    body = "_:b <http://example.org/p> 1 ."
    assert client.post(address, content=body, headers=TURTLE).status_code == 201
    assert client.post(address, content=body, headers=TURTLE).status_code == 204
    answer = client.get(address, headers={"Accept": "application/n-triples"})
    assert len(Graph().parse(data=answer.text, format="nt")) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    # The larger, together with what is added at last, exceed what a commit may add or remove.
    "count",
    [2_000, pytest.param(120_000, marks=pytest.mark.deep)],
)
def test_a_large_graph_is_put_over_a_large_graph_and_deleted(
    client: httpx.Client, address: str, count: int
) -> None:

    def body(word: str) -> str:
        return "".join(f"<urn:{word}:{k}> <urn:p> {k % 7} .\n" for k in range(count))

    for word, status in (("old", 201), ("new", 204)):
        done = client.put(address, content=body(word), headers=TURTLE, timeout=300)
        assert done.status_code == status, done.text
    name = unquote(address.partition("=")[2])
    query = f"""SELECT (COUNT(*) AS ?n) (MIN(STR(?s)) AS ?least)
WHERE {{ GRAPH <{name}> {{ ?s ?p ?o }} }}"""
    answer = client.get("/sparql", params={"query": query}, timeout=300).json()
    (row,) = answer["results"]["bindings"]
    assert (row["n"]["value"], row["least"]["value"]) == (str(count), "urn:new:0")
    more = client.post(address, content=body("more"), headers=TURTLE, timeout=300)
    assert more.status_code == 204, more.text
    gone = client.delete(address, timeout=300)
    assert gone.status_code == 204, gone.text
    assert client.get(address).status_code == 404


def test_an_empty_put_makes_a_graph_that_is_there(client: httpx.Client, address: str) -> None:
    assert client.put(address, headers=TURTLE).status_code == 201
    assert client.get(address).status_code == 200
    assert client.head(address).headers["content-type"] == "text/turtle; charset=utf-8"


def test_a_malformed_body_changes_nothing_and_says_where(
    client: httpx.Client, address: str
) -> None:
    client.put(address, content=ONE, headers=TURTLE)
    for method in (client.put, client.post):
        refused = method(address, content=f'{ONE}\n<a> <b> "unclosed .', headers=TURTLE)
        assert refused.status_code == 400
        assert refused.json()["line"] == 2
    assert len(Graph().parse(data=client.get(address).text, format="turtle")) == 1


@pytest.mark.parametrize(
    ("kind", "body", "limit"),
    [
        ("text/turtle", "<urn:a> <urn:p> " + "[ <urn:p> " * 20_000 + "]" * 20_000, "nesting"),
        ("text/n3", "<urn:a> <urn:p> " + "( " * 20_000 + ")" * 20_000, "nesting"),
        ("application/n-triples", f'<urn:a> <urn:p> "{"x" * (2 << 20)}" .', "literal"),
    ],
)
def test_a_document_beyond_the_bounds_is_refused_and_says_which(
    client: httpx.Client, address: str, kind: str, body: str, limit: str
) -> None:
    answer = client.put(address, content=body, headers={"Content-Type": kind})
    assert (answer.status_code, answer.json()["limit"]) == (413, limit)
    assert client.get(address).status_code == 404


def test_multipart_is_one_commit_each_part_by_its_own_type(
    client: httpx.Client, address: str
) -> None:
    good = ("a.ttl", b"<urn:a> <urn:p> 1 .", "text/turtle")
    plain = ("b.nt", b'<urn:b> <urn:p> "2" .\n', "application/n-triples")
    bad = ("c.ttl", b"rubbish", "text/turtle")
    refused = client.post(address, files=[("f", good), ("g", bad)])
    assert refused.status_code == 400
    assert client.get(address).status_code == 404
    assert client.post(address, files=[("f", good), ("g", plain)]).status_code == 201
    assert len(Graph().parse(data=client.get(address).text, format="turtle")) == 2


def test_a_post_without_a_name_makes_a_graph_and_says_where(client: httpx.Client) -> None:
    made = client.post("/store", content=ONE, headers=TURTLE)
    assert made.status_code == 201
    assert client.get(made.headers["location"]).status_code == 200
    name = quote(made.headers["location"], safe="")
    assert client.get(f"/store?graph={name}").status_code == 200


def test_the_direct_address_is_the_name_exactly_as_sent(
    server: RunningServer, client: httpx.Client
) -> None:
    unique = uuid.uuid4()
    client.put(f"/store/{unique}/1.ttl", content=ONE, headers=TURTLE)
    assert ask(client, f"ASK {{ GRAPH <{server.url}/store/{unique}/1.ttl> {{ ?s ?p ?o }} }}")
    assert client.get(f"/store/{unique}/1.ttl").status_code == 200


def test_relative_iris_of_a_body_are_resolved_against_the_graph(
    client: httpx.Client,
) -> None:
    name = f"http://example.org/{uuid.uuid4()}"
    client.put(f"/store?graph={name}", content="<other> <#p> <> .", headers=TURTLE)
    expected = f"<http://example.org/other> <{name}#p> <{name}>"
    assert ask(client, f"ASK {{ GRAPH <{name}> {{ {expected} }} }}")


def test_the_whole_dataset_comes_as_quads(client: httpx.Client, address: str) -> None:
    client.put(address, content=ONE, headers=TURTLE)
    answer = client.get("/store", headers={"Accept": "application/n-quads"})
    quads = list(pyoxigraph.parse(answer.content, pyoxigraph.RdfFormat.N_QUADS))
    assert f"<{unquote(address.partition('=')[2])}>" in {str(q.graph_name) for q in quads}


def test_quads_are_posted_into_their_graphs(client: httpx.Client) -> None:
    name = f"http://example.org/{uuid.uuid4()}"
    quads = f"<urn:s> <urn:p> <urn:o> <{name}> .\n"
    kind = {"Content-Type": "application/n-quads"}
    assert client.post("/store", content=quads, headers=kind).status_code == 204
    assert ask(client, f"ASK {{ GRAPH <{name}> {{ <urn:s> <urn:p> <urn:o> }} }}")
    assert client.post(f"/store?graph={name}", content=quads, headers=kind).status_code == 400


def test_the_default_graph_is_what_was_put_there(client: httpx.Client) -> None:
    client.put("/store?default", content=ONE, headers=TURTLE)
    graph = Graph().parse(data=client.get("/store?default").text, format="turtle")
    assert len(graph) == 1
    assert client.delete("/store?default").status_code == 204
    assert len(Graph().parse(data=client.get("/store?default").text, format="turtle")) == 0


def test_preconditions_stop_lost_updates(client: httpx.Client, address: str) -> None:
    new = {**TURTLE, "If-None-Match": "*"}
    assert client.put(address, content=ONE, headers=new).status_code == 201
    assert client.put(address, content=ONE, headers=new).status_code == 412
    etag = client.get(address).headers["etag"]
    mine = {**TURTLE, "If-Match": etag}
    assert client.put(address, content="<urn:x> <urn:y> 1 .", headers=mine).status_code == 204
    assert client.put(address, content=ONE, headers=mine).status_code == 412
    same = client.get(address).headers["etag"]
    assert client.get(address, headers={"If-None-Match": same}).status_code == 304


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ("/store?graph=relative", 400),
        ("/store?graph=", 400),
        ("/store?graph=urn:a&graph=urn:b", 400),
        ("/store?default&graph=urn:a", 400),
        ("/store?graph=urn:a&as_of=1", 400),
        ("/store?grpah=urn:a", 400),
        ("/store?graph=%3Cnot%20an%20iri%3E", 400),
    ],
)
def test_a_graph_that_is_not_named_rightly_is_refused(
    client: httpx.Client, target: str, status: int
) -> None:
    assert client.put(target, content=ONE, headers=TURTLE).status_code == status


def test_a_body_that_is_no_rdf_is_refused(client: httpx.Client, address: str) -> None:
    picture = {"Content-Type": "image/png"}
    assert client.put(address, content=b"x", headers=picture).status_code == 415
    assert client.get(address, headers={"Accept": "image/png"}).status_code in (404, 406)


def test_graphs_that_the_knowledge_base_keeps_are_read_only(client: httpx.Client) -> None:
    rows = client.get(
        "/sparql",
        params={
            "query": "SELECT DISTINCT ?g { GRAPH ?g {} FILTER(STRENDS(STR(?g), '/graph/meta')) }"
        },
    ).json()["results"]["bindings"]
    (meta,) = [row["g"]["value"] for row in rows]
    assert client.get(f"/store?graph={quote(meta, safe='')}").status_code == 200
    refused = client.put(f"/store?graph={quote(meta, safe='')}", content=ONE, headers=TURTLE)
    assert refused.status_code == 403
    assert refused.json()["graph"] == meta
