"""SPARQL clients that people use: httpx, curl, SPARQLWrapper, rdflib."""

from __future__ import annotations

import json
import shutil
import subprocess

import httpx
import pytest
from click.testing import CliRunner
from rdflib import Graph, Literal, URIRef
from rdflib.plugins.stores.sparqlstore import SPARQLStore, SPARQLUpdateStore
from SPARQLWrapper import CSV, JSON, POST, TURTLE, SPARQLExceptions, SPARQLWrapper

import ontology
import rtask
from rtask.cli.asking.ask import ask
from tests.servers import RunningServer

MUG = "http://example.org/mug"
LABEL = "http://www.w3.org/2000/01/rdf-schema#label"


def insert(client: httpx.Client, graph: str, triples: str) -> None:
    """Replace a graph by a few triples."""
    text = f"DROP SILENT GRAPH <{graph}> ; INSERT DATA {{ GRAPH <{graph}> {{ {triples} }} }}"
    answer = client.post("/update", data={"update": text})
    assert answer.status_code == 204, answer.text


def test_httpx_query_by_get_and_post(client: httpx.Client) -> None:
    insert(client, "http://example.org/httpx", f'<{MUG}> <{LABEL}> "Tässchen + 🤖 & %"')
    query = f"SELECT ?label {{ GRAPH <http://example.org/httpx> {{ <{MUG}> <{LABEL}> ?label }} }}"
    by_get = client.get("/sparql", params={"query": query})
    by_form = client.post("/sparql", data={"query": query})
    direct = client.post(
        "/query", content=query, headers={"Content-Type": "application/sparql-query"}
    )
    for answer in (by_get, by_form, direct):
        (row,) = answer.json()["results"]["bindings"]
        assert row["label"]["value"] == "Tässchen + 🤖 & %"


@pytest.mark.parametrize(
    ("accept", "start"),
    [
        ("text/csv", "value\r\n1"),
        ("text/tab-separated-values", "?value\n1"),
        ("application/sparql-results+xml", "<?xml"),
        ("application/json", '{"head"'),
    ],
)
def test_every_result_format_is_written(client: httpx.Client, accept: str, start: str) -> None:
    query = {"query": "SELECT (1 AS ?value) {}"}
    answer = client.get("/sparql", params=query, headers={"Accept": accept})
    assert answer.status_code == 200
    assert answer.text.startswith(start)


def test_an_update_says_what_it_did_when_json_is_wanted(client: httpx.Client) -> None:
    answer = client.post(
        "/update",
        data={"update": "INSERT DATA { GRAPH <urn:g:counted> { <urn:s> <urn:p> 1, 2 } }"},
        headers={"Accept": "application/json"},
    )
    assert answer.status_code == 200
    assert answer.json()["added"] == 2
    assert answer.json()["seq"] > 0


def test_what_is_inserted_is_reasoned_about_and_marked(client: httpx.Client) -> None:
    effector, of = f"{ontology.NS}hasEndEffector", f"{ontology.NS}endEffectorOf"
    insert(client, "urn:g:reasoned", f"<urn:r:1> <{effector}> <urn:r:1/hand>")
    question = f"ASK {{ <urn:r:1/hand> <{of}> <urn:r:1> }}"
    with_inferred = client.get("/sparql", params={"query": question}).json()["boolean"]
    without = client.get("/sparql", params={"query": question, "inferred": "0"}).json()["boolean"]
    assert (with_inferred, without) == (True, False)


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_curl_as_the_documentation_shows_it(server: RunningServer) -> None:
    command = ["curl", "-s", f"{server.url}/sparql", "-H", "Accept: text/csv"]
    query = "query=SELECT (1 + 1 AS ?two) {}"
    done = subprocess.run([*command, "--data-urlencode", query], capture_output=True, check=True)
    assert done.stdout == b"two\r\n2\r\n"


def test_sparqlwrapper_queries_updates_and_reports_errors(server: RunningServer) -> None:
    wrapper = SPARQLWrapper(f"{server.url}/sparql")
    wrapper.setMethod(POST)
    wrapper.setQuery(f'INSERT DATA {{ GRAPH <urn:g:wrapper> {{ <{MUG}> <{LABEL}> "mug"@en }} }}')
    wrapper.query()

    wrapper = SPARQLWrapper(f"{server.url}/sparql")
    wrapper.setReturnFormat(JSON)
    wrapper.setQuery(f"SELECT ?l {{ GRAPH <urn:g:wrapper> {{ <{MUG}> <{LABEL}> ?l }} }}")
    (row,) = wrapper.query().convert()["results"]["bindings"]
    assert row["l"] == {"type": "literal", "value": "mug", "xml:lang": "en"}

    wrapper.setReturnFormat(CSV)
    assert wrapper.query().convert() == b"l\r\nmug\r\n"

    wrapper = SPARQLWrapper(f"{server.url}/sparql", returnFormat=TURTLE)
    wrapper.setQuery("CONSTRUCT { ?s ?p ?o } WHERE { GRAPH <urn:g:wrapper> { ?s ?p ?o } }")
    graph = Graph().parse(data=wrapper.query().convert(), format="turtle")
    assert (URIRef(MUG), URIRef(LABEL), Literal("mug", lang="en")) in graph

    wrapper = SPARQLWrapper(f"{server.url}/sparql", returnFormat=JSON)
    wrapper.setQuery("SELECT ?x WHERE { ?x ")
    with pytest.raises(SPARQLExceptions.QueryBadFormed):
        wrapper.query()


def test_rdflib_reads_and_writes_through_its_stores(server: RunningServer) -> None:
    triple = (URIRef(MUG), URIRef(LABEL), Literal("rdflib's mug"))
    store = SPARQLUpdateStore(
        query_endpoint=f"{server.url}/query", update_endpoint=f"{server.url}/update"
    )
    graph = Graph(store, identifier=URIRef("http://example.org/rdflib"))
    graph.add(triple)
    assert triple in graph

    reading = Graph(
        SPARQLStore(f"{server.url}/sparql"), identifier=URIRef("http://example.org/rdflib")
    )
    assert list(reading) == [triple]
    assert [str(row.o) for row in reading.query("SELECT ?o { ?s ?p ?o }")] == ["rdflib's mug"]

    graph.remove((None, None, None))
    assert len(graph) == 0


def test_rdflib_collects_many_changes_into_one_update(server: RunningServer) -> None:
    """Without autocommit rdflib sends one operation for each statement, joined by semicolons."""
    store = SPARQLUpdateStore(
        f"{server.url}/query", f"{server.url}/update", autocommit=False, dirty_reads=True
    )
    graph = Graph(store, identifier=URIRef("http://example.org/collected"))
    for number in range(400):
        graph.add((URIRef(f"http://example.org/{number}"), URIRef(LABEL), Literal(number)))
    store.commit()
    assert len(graph) == 400


def test_another_pages_fetch_gets_no_permission_without_cors(client: httpx.Client) -> None:
    answer = client.get(
        "/sparql", params={"query": "ASK {}"}, headers={"Origin": "http://evil.example"}
    )
    assert "access-control-allow-origin" not in answer.headers


def test_a_health_check_tells_live_and_ready(client: httpx.Client) -> None:
    health = client.get("/health").json()
    assert (health["live"], health["ready"], health["failing"]) == (True, True, [])
    assert client.get("/health/live").json() == {"live": True}
    assert client.get("/health/ready").status_code == 200


def test_the_service_description_names_the_endpoint_as_the_client_wrote_it(
    server: RunningServer, client: httpx.Client
) -> None:
    answer = client.get("/sparql", headers={"Accept": "text/turtle"})
    graph = Graph().parse(data=answer.text, format="turtle")
    sd = "http://www.w3.org/ns/sparql-service-description#"
    endpoints = [str(o) for o in graph.objects(None, URIRef(sd + "endpoint"))]
    assert endpoints == [f"{server.url}/sparql"]
    assert URIRef(sd + "UnionDefaultGraph") in set(graph.objects(None, URIRef(sd + "feature")))


def test_a_problem_is_json_that_programs_can_read(client: httpx.Client) -> None:
    answer = client.get("/sparql", params={"query": "SELECT ?x WHERE {\n  ?x ?p }"})
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    details = json.loads(answer.text)
    assert details["type"] == "/errors/query-syntax"
    assert details["line"] == 2


def test_a_question_in_words_is_answered_by_the_client_and_by_the_command(
    client: httpx.Client, server: RunningServer
) -> None:
    insert(client, "urn:g:words", f"<urn:c:1> a <{ontology.NS}Cup> ; <{ontology.NS}name> 'red cup'")
    question = "which cups are there?"
    with rtask.connect(server.url) as connected:
        assert connected.answer(question)["sentence"] == "Cups: red cup."
    printed = CliRunner().invoke(ask, [question, "--server", server.url])
    assert printed.exit_code == 0, printed.output
    assert "Cups: red cup." in printed.stdout
