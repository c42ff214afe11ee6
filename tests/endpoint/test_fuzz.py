"""Whatever is sent, the answer is no 500, and nobody's graph but the sender's is changed."""

from __future__ import annotations

import json
import string
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.http.messages import Request
from endpoint.rosbridge.services import NoEngine
from endpoint.rosbridge.session import Bridge, Session
from endpoint.settings import Config
from rtask.kb.commit.access import Access
from tests.servers import new_application

FEW = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
OTHERS = "urn:lab/graph/agent/nao-2"

QUERIES = [
    "SELECT ?s WHERE { ?s <urn:p> ?o . OPTIONAL { ?o <urn:q> ?z } FILTER(?o > 1) } LIMIT 5",
    "PREFIX x: <urn:> ASK { x:a (x:b|^x:c)*/x:d ?e . VALUES ?e { 1 'two'@en \"3\"^^x:t } }",
    "CONSTRUCT { ?s ?p [ <urn:q> ?o ] } WHERE { GRAPH ?g { ?s ?p ?o } MINUS { ?s a <urn:T> } }",
    "SELECT (COUNT(DISTINCT ?s) AS ?n) { { ?s ?p ?o } UNION { ?o ?p ?s } } GROUP BY ?p ORDER BY ?n",
    "DESCRIBE <urn:a> FROM <urn:g>",
]
UPDATES = [
    "INSERT DATA { <urn:a> <urn:b> 1 . GRAPH <urn:g> { <urn:a> <urn:b> 'x' } }",
    "DELETE { GRAPH ?g { ?s ?p ?o } } INSERT { ?s ?p 2 } WHERE { GRAPH ?g { ?s ?p ?o } }",
    f"WITH <{OTHERS}> DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}",
    f"COPY <urn:g> TO <{OTHERS}> ; CLEAR SILENT NAMED ; CREATE SILENT GRAPH <urn:h>",
    f"PREFIX g: <urn:lab/graph/> INSERT DATA {{ GRAPH <{OTHERS}> {{ g:a g:b g:c }} }}",
    "LOAD SILENT <file:///etc/passwd> ; DROP ALL",
]
PIECES = [
    *string.punctuation,
    *("{", "}", "<urn:x>", "?x", "GRAPH ?g", f"GRAPH <{OTHERS}>", "\\u0061", "#", "'''", '"""'),
    *("SELECT", "INSERT", "WHERE", ";", ".", "<<(", ")>>", "_:b", "1e999", "\x00", "\ud800"[:0]),
    *("é", "\u202e", "𝕊", " ", "\n", "BASE <x>", "SERVICE <http://127.0.0.1/>", "LOAD <file:///>"),
]


@st.composite
def mutated(draw: st.DrawFn, texts: list[str]) -> str:
    """A text in which some pieces were cut, doubled, swapped or put in."""
    text = draw(st.sampled_from(texts))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = draw(st.integers(start, min(len(text), start + 12)))
        piece = draw(st.sampled_from([*PIECES, text[start:end] * 2]))
        text = text[:start] + piece + text[end:]
    return text


class House:
    """An application with two robots, one of which has something to lose."""

    def __init__(self, tokens: TokenStore) -> None:
        self.kb = rtask.open(":memory:", base="urn:lab/", ontologies=False)
        text, _ = tokens.create("robot", agent="nao-1")
        tokens.create("robot", agent="nao-2")
        self.bearer = f"Bearer {text}"
        config = Config(rate=0.0, write_rate=0.0, max_queries=4, timeout_s=5.0)
        self.application = new_application(self.kb, NoEngine(), tokens, config)
        self.kb.update(f"INSERT DATA {{ GRAPH <{OTHERS}> {{ <urn:mine> <urn:is> 'mine' }} }}")
        self.before = self.foreign()

    def foreign(self) -> set[str]:
        """Return all statements that the robot may not touch, the records of commits aside."""
        own = {"urn:lab/graph/agent/nao-1", "urn:lab/graph/meta", "urn:lab/graph/provenance"}
        return {
            str(quad)
            for quad in self.kb.match()
            if getattr(quad.graph_name, "value", "") not in own
        }

    def send(self, method: str, path: str, query: str = "", body: bytes = b"", **more: str) -> int:
        """Send a request as the robot and return the status."""
        headers = {"host": "localhost", "authorization": self.bearer}
        headers.update({name.replace("_", "-"): value for name, value in more.items()})
        answer = self.application.handle(Request(method, path, query, headers, body))
        if answer.status >= 400:
            problem = json.loads(answer.body)
            assert problem["status"] == answer.status
            assert "Traceback" not in problem["detail"]
        return answer.status


@pytest.fixture(scope="module")
def house() -> Iterator[House]:
    with closing(TokenStore(None)) as tokens:
        made = House(tokens)
        yield made
        made.application.close()
        made.kb.close()


@FEW
@given(text=mutated(QUERIES))
def test_mutated_queries(house: House, text: str) -> None:
    body = text.encode("utf-8", "surrogatepass")
    status = house.send("POST", "/query", "", body, content_type="application/sparql-query")
    assert status in (200, 400, 403, 413, 422, 504)


@FEW
@given(text=mutated(UPDATES))
def test_mutated_updates_touch_nobody_elses_graph(house: House, text: str) -> None:
    body = text.encode("utf-8", "surrogatepass")
    status = house.send("POST", "/update", "", body, content_type="application/sparql-update")
    assert status in (204, 400, 403, 409, 413, 422, 504)
    assert house.foreign() == house.before


BODIES = [
    b"<urn:a> <urn:b> 'c' , [ <urn:d> ( 1 2 ) ] .",
    b'<urn:a> <urn:b> "c"@en <urn:lab/graph/agent/nao-2> .',
    b"GRAPH <urn:lab/graph/agent/nao-2> { <urn:a> <urn:b> 1 }",
    b'{"@id": "urn:a", "urn:b": {"@id": "urn:c"}, "@context": "http://127.0.0.1/"}',
    b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><rdf:RDF '
    b'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description/></rdf:RDF>',
]
TYPES = [
    "text/turtle",
    "application/n-quads",
    "application/trig",
    "application/ld+json",
    "application/rdf+xml",
    "multipart/form-data; boundary=x",
    "image/png",
    "",
]


@st.composite
def bodies(draw: st.DrawFn) -> bytes:
    body = draw(st.sampled_from(BODIES))
    start = draw(st.integers(0, len(body)))
    end = draw(st.integers(start, len(body)))
    return body[:start] + draw(st.binary(max_size=20)) + body[end:]


@FEW
@given(
    body=bodies(),
    media_type=st.sampled_from(TYPES),
    method=st.sampled_from(["PUT", "POST", "DELETE", "PATCH", "GET"]),
    target=st.sampled_from(
        ["", "default", f"graph={OTHERS}", "graph=urn:lab/graph/agent/nao-1", "graph=rel", "graph="]
    ),
    path=st.sampled_from(["/store", "/store/../x", "/store/%2e%2e/x", "/store/a/b%00"]),
)
def test_graph_store_requests(
    house: House, body: bytes, media_type: str, method: str, target: str, path: str
) -> None:
    status = house.send(method, path, target, body, content_type=media_type)
    assert status < 500 or status == 504
    assert house.foreign() == house.before


@FEW
@given(
    query=st.text(alphabet="%&=+;aquerytimoupdgh0123456789é\x00<> {}", max_size=60),
    accept=st.text(alphabet="*/;,q=0.1text/csvjson ", max_size=40),
    path=st.sampled_from(["/sparql", "/query", "/update", "/metrics", "/queries/x", "/engine/x"]),
    method=st.sampled_from(["GET", "HEAD", "POST", "OPTIONS", "DELETE", "FOO"]),
)
def test_addresses_and_headers(
    house: House, query: str, accept: str, path: str, method: str
) -> None:
    status = house.send(method, path, query, accept=accept, if_none_match=accept)
    assert status < 500 or status == 504


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=10),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3)
    ),
    max_leaves=8,
)
_OPS = ["call_service", "publish", "subscribe", "advertise", "unsubscribe", "search_object"]
_FIELDS = ["op", "id", "service", "args", "topic", "type", "msg", "data", "num", "total", "values"]


@pytest.mark.slow
@FEW
@given(
    message=st.dictionaries(st.sampled_from(_FIELDS), _JSON | st.sampled_from(_OPS), max_size=6),
    op=st.sampled_from(_OPS),
    cut=st.integers(0, 400),
)
def test_messages_of_robots(message: dict[str, Any], op: str, cut: int) -> None:
    bridge = Bridge(NoEngine())
    heard: list[str] = []
    session = Session(bridge, lambda text, topic="": heard.append(text), Access("nao-1", "robot"))
    try:
        text = json.dumps({**message, "op": op})
        for sent in (text, text[:cut], "[" * cut):
            session.feed(sent)
        assert not any("Traceback" in answer for answer in heard)
    finally:
        session.close()
        bridge.close()
