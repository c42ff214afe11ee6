"""Requests that are no requests get a 4xx with its reason, whatever they hold."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.http.form_data import array_from_npy
from endpoint.http.messages import Request, Response
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from rtask.errors import UsageError
from tests.servers import new_application

BASE = "urn:lab/"
NAN = '"NaN"^^<http://www.w3.org/2001/XMLSchema#double>'
HALF = rb'"\ud800"'


@pytest.fixture(scope="module")
def application() -> Iterator[Application]:
    with (
        closing(TokenStore(None)) as tokens,
        rtask.open(":memory:", base=BASE) as kb,
        Engine(kb) as engine,
    ):
        kb.update(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> INSERT DATA { <urn:lab/object/1> "
            f'a rt:ManipulableObject ; rt:objectId "1" ; rt:name "mug" ; rt:mass {NAN} }}'
        )
        made = new_application(kb, engine, tokens, Config())
        yield made
        made.close()


def ask(
    application: Application,
    method: str,
    address: str,
    body: bytes = b"",
    media_type: str = "application/json",
    **headers: str,
) -> Response:
    path, _, query = address.partition("?")
    sent = {"host": "localhost", "content-type": media_type}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    return application.handle(Request(method, path, query, sent, body))


def strict(body: bytes) -> Any:
    """Parse JSON as JavaScript does, which knows no NaN."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    return json.loads(body, parse_constant=refuse)


@pytest.mark.parametrize(
    "iri", ["http://x:port/", "http://[/", "http://a/%zz", "urn:a#b#c", "mailto:%", "http://a b/"]
)
@pytest.mark.parametrize("method", ["GET", "PUT", "DELETE"])
def test_a_graph_needs_an_iri(application: Application, method: str, iri: str) -> None:
    escaped = "".join(f"%{byte:02X}" for byte in iri.encode())
    turtle = b"<urn:a> <urn:b> 1 ."
    answer = ask(application, method, f"/store?graph={escaped}", turtle, "text/turtle")
    assert answer.status == 400
    assert "not an absolute IRI" in json.loads(answer.body)["detail"]


def test_the_address_itself_may_be_no_iri(application: Application) -> None:
    assert ask(application, "GET", "/store/%zz").status == 400


def test_a_service_is_described_under_a_sound_address_only() -> None:
    with closing(TokenStore(None)) as tokens, rtask.open(":memory:", ontologies=False) as kb:
        text, _ = tokens.create("reader")
        config = Config(host="0.0.0.0")
        with closing(new_application(kb, NoEngine(), tokens, config)) as served:
            headers = {"host": "a%zz", "authorization": f"Bearer {text}"}
            request = Request("GET", "/query", "", headers, site=config.site("http", "a%zz"))
            assert served.handle(request).status == 400


@pytest.mark.parametrize(
    "query",
    [
        f"limit={'9' * 5000}",
        f"cursor={base64.urlsafe_b64encode(b'[' * 20_000).decode()}",
    ],
)
def test_parameters_of_a_list_are_bounded(application: Application, query: str) -> None:
    assert ask(application, "GET", f"/api/robots?{query}").status == 400


@pytest.mark.parametrize(
    ("address", "body"),
    [
        ("/mcp", b'{"jsonrpc": "2.0", "method": "ping", "id": %s}' % HALF),
        ("/mcp", b'{"jsonrpc": "2.0", "id": 1, "method": %s}' % HALF),
        ("/reasoner/entails", b'{"text": %s}' % HALF),
        ("/engine/recall_grasps", b'{"object": %s}' % HALF),
        ("/engine/recall_grasps", b'{"object": "\xed\xa0\x80"}'),
        ("/datasets/a/B/merge", b'{"source": %s}' % HALF),
    ],
)
def test_half_of_a_surrogate_pair_is_no_text(
    application: Application, address: str, body: bytes
) -> None:
    answer = ask(application, "POST", address, body)
    assert answer.status == 400
    strict(answer.body)


def test_a_whole_surrogate_pair_is(application: Application) -> None:
    body = rb'{"jsonrpc": "2.0", "method": "ping", "id": "\ud83d\ude00"}'
    assert json.loads(ask(application, "POST", "/mcp", body).body)["id"] == "\U0001f600"


def test_an_error_about_half_of_a_surrogate_pair_is_told_all_the_same(
    application: Application,
) -> None:
    refused = application.refused(UsageError("no \ud800"), Request("GET", "/x"))
    assert strict(application.run(refused).body)["detail"] == "no \ud800"


@pytest.mark.parametrize("id_", [b"NaN", b"[1]", b"1.5"])
def test_an_agent_names_its_requests_by_text_or_number(
    application: Application, id_: bytes
) -> None:
    body = b'{"jsonrpc": "2.0", "method": "ping", "id": %s}' % id_
    answer = strict(ask(application, "POST", "/mcp", body).body)
    assert (answer["id"], answer["error"]["code"]) == (None, -32600)


def test_what_json_cannot_carry_is_null(application: Application) -> None:
    listed = strict(ask(application, "GET", "/api/objects").body)
    assert listed["items"][0]["mass_kg"] is None
    browser = create_app(application).test_client()
    page = browser.get("/object.json?iri=urn:lab/object/1", base_url="http://localhost")
    assert strict(page.data)["mass"] is None


@pytest.mark.parametrize(
    "header",
    [
        "{[]: 1}",
        "((((",
        "{'descr': (), 'fortran_order': False, 'shape': (1,)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (True,)}",
        "  x\n y",
        "-" * 9_000 + "1",
    ],
)
def test_a_file_of_numbers_with_a_strange_header_is_none(header: str) -> None:
    head = header.encode()
    file = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(8)
    assert array_from_npy(file) is None


@pytest.mark.parametrize("text", ["bytes=5-2", f"bytes=0-{'9' * 5000}"])
def test_a_range_that_is_none_stands_for_the_whole(application: Application, text: str) -> None:
    kb = application.context.kb
    assert isinstance(kb, rtask.KnowledgeBase)
    name = kb.blobs.put(b"0123456789").sha256
    answer = ask(application, "GET", f"/api/blobs/{name}", range=text)
    assert (answer.status, answer.body) == (200, b"0123456789")


def test_a_compressed_request_keeps_its_id(application: Application) -> None:
    body = gzip.compress(b"INSERT DATA { <urn:a> <urn:b> 1 }")
    update = "application/sparql-update"
    answer = ask(application, "POST", "/update", body, update, content_encoding="gzip")
    assert answer.status == 204
    kb = application.context.kb
    assert isinstance(kb, rtask.KnowledgeBase)
    (entry,) = kb.history(since=kb.seq - 1)
    assert entry.note == f"request {dict(answer.headers)['RTASK-Request-Id']}"


@pytest.mark.parametrize("address", ["/api/historyfoo", "/api/history/1"])
def test_the_audit_trail_is_at_one_address(application: Application, address: str) -> None:
    assert ask(application, "GET", address).status == 404


def test_a_page_names_the_methods_that_it_takes(application: Application) -> None:
    browser = create_app(application).test_client()
    answer = browser.delete("/feedback", base_url="http://localhost")
    assert answer.status_code == 405
    assert answer.headers["Allow"] == "GET, HEAD, OPTIONS, POST"
