"""What the SPARQL protocol answers about stored text, and about updates without effect."""

from __future__ import annotations

import gzip
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import closing
from urllib.parse import urlencode

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.http.messages import Request, Response
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from tests.servers import new_application

TEXT = "a\r\nb\x07" + "x" * 5_000
FORM = {"content-type": "application/x-www-form-urlencoded", "host": "localhost"}


@pytest.fixture(scope="module")
def served() -> Iterator[Application]:
    with (
        rtask.open(":memory:", reason=False, ontologies=False) as kb,
        closing(TokenStore(None)) as tokens,
    ):
        with kb.transaction() as tx:
            tx.add("urn:s", "urn:p", TEXT)
        kb.update("INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:q> 1 } }")
        with closing(new_application(kb, NoEngine(), tokens, Config())) as application:
            yield application


def ask(served: Application, headers: dict[str, str], **fields: str) -> Response:
    body = urlencode(fields).encode()
    return served.handle(Request("POST", "/sparql", "", {**FORM, **headers}, body))


@pytest.mark.parametrize("coding", ["gzip", "identity"])
@pytest.mark.parametrize(
    "query", ["SELECT ?p ?o { <urn:s> ?p ?o }", "SELECT ?o { <urn:s> <urn:p> ?o . ?s ?p ?o }"]
)
def test_xml_is_well_formed_and_keeps_line_ends(
    served: Application, query: str, coding: str
) -> None:
    headers = {"accept": "application/sparql-results+xml", "accept-encoding": coding}
    answer = ask(served, headers, query=query)
    assert answer.status == 200
    body = answer.body + b"".join(answer.chunks or ())
    if ("Content-Encoding", "gzip") in answer.headers:
        body = gzip.decompress(body)
    texts = {node.text for node in ET.fromstring(body).iter()}
    assert TEXT.replace("\x07", "\ufffd") in texts


def test_an_update_that_misses_statements_of_other_graphs_says_so(served: Application) -> None:
    update = "DELETE WHERE { ?s <urn:q> ?o }"
    plain = ask(served, {}, update=update)
    assert plain.status == 204
    assert "GRAPH ?g" in dict(plain.headers)["RTASK-Remark"]
    counted = ask(served, {"accept": "application/json"}, update=update)
    assert "GRAPH ?g" in json.loads(counted.body)["remark"]
    effective = ask(served, {}, update="DELETE WHERE { GRAPH ?g { ?s <urn:q> ?o } }")
    assert "RTASK-Remark" not in dict(effective.headers)


@pytest.mark.parametrize("method", ["POST", "PUT"])
def test_a_document_that_makes_two_things_one_says_so(method: str) -> None:
    headers = {"content-type": "text/turtle", "host": "localhost"}
    document = b"<urn:a> <urn:key> 1 . <urn:b> <urn:key> 1 ."
    with (
        rtask.open(":memory:", ontologies=False) as kb,
        closing(TokenStore(None)) as tokens,
        closing(new_application(kb, NoEngine(), tokens, Config())) as application,
    ):
        inverse = "<http://www.w3.org/2002/07/owl#InverseFunctionalProperty>"
        kb.update(f"INSERT DATA {{ GRAPH <urn:o> {{ <urn:key> a {inverse} }} }}")
        request = Request(method, "/store", "graph=urn:g", headers, document)
        answer = application.handle(request)
    assert answer.status == 201
    assert "are one thing from now on, as both have" in dict(answer.headers)["RTASK-Remark"]
