"""Repeated headers pass the same rules of admission, and their answers are kept and counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import timedelta
from typing import Any
from urllib.parse import quote

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application, Job
from endpoint.direct import HeadQueries
from endpoint.direct.head_queries import HeadQuery
from endpoint.direct.heads import RepeatedHead, learn
from endpoint.http.messages import Request
from endpoint.point_lines import Instead, PointLines
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

VALUE = quote("SELECT ?r { <urn:thing> <urn:p> ?o . ?o <urn:q> ?r }", safe="").encode()
BLOCK = b"host: localhost\r\n\r\n"
Known = Callable[..., tuple[Application, HeadQueries]]


class Recorded:
    """A connection that records what it is to send."""

    date = b""
    loop: Any = None

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.resumed: list[Job] = []

    def send(self, query: HeadQuery, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def resume(self, query: HeadQuery, job: Job, found: Answer | ReaderStream | Instead) -> None:
        self.resumed.append(job)


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        yield kb


@pytest.fixture
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as store:
        yield store


@pytest.fixture
def known(kb: KnowledgeBase, tokens: TokenStore) -> Iterator[Known]:
    with ExitStack() as stack:

        def make(**settings: Any) -> tuple[Application, HeadQueries]:
            config = Config(**settings)
            application = new_application(kb, NoEngine(), tokens, config, clock=lambda: 100.0)
            stack.callback(application.close)
            # No readers: a query comes back at once, to be asked in a thread.
            return application, HeadQueries(application, PointLines(None, lambda: None))

        yield make


def head_of(application: Application, token: str, **fields: str) -> RepeatedHead | None:
    headers = {"host": "localhost", "authorization": f"Bearer {token}", **fields}
    request = Request("GET", "/query", f"query={VALUE.decode()}", headers, site="http://localhost")
    return learn(BLOCK, request, application)


def test_rates_hold(known: Known, tokens: TokenStore) -> None:
    application, queries = known(rate=4.0)
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    admitted = [queries.admit(head, VALUE) is not None for _ in range(9)]
    assert admitted == [True] * 8 + [False]


def test_so_many_of_a_caller_are_in_progress_at_once(known: Known, tokens: TokenStore) -> None:
    application, queries = known(rate=0.0, max_in_flight=3)
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    assert [queries.admit(head, VALUE) is not None for _ in range(4)] == [True, True, True, False]
    application.context.limiter.leave(head.caller)
    assert queries.admit(head, VALUE) is not None


@pytest.mark.parametrize("how", ["revoked", "expired", "other"])
def test_a_header_is_known_until_a_token_changes(
    known: Known, tokens: TokenStore, how: str
) -> None:
    application, queries = known()
    text, token = tokens.create("reader")
    head = head_of(application, text)
    assert head is not None
    assert queries.admit(head, VALUE) is not None
    if how == "revoked":
        tokens.revoke(token.id)
    elif how == "expired":
        tokens.expire(token.id, timedelta(seconds=-1))
    else:
        tokens.create("robot", agent="nao-1")
    assert queries.admit(head, VALUE) is None


def test_a_token_that_expires_by_itself_ends_what_is_known(
    known: Known, tokens: TokenStore
) -> None:
    application, queries = known()
    text = tokens.create("reader", lifetime=timedelta(hours=1))[0]
    head = head_of(application, text)
    assert head is not None
    assert head.caller.token is not None
    head.caller.token.__dict__["expires_at"] = 0.0
    assert queries.admit(head, VALUE) is None


@pytest.mark.parametrize(
    "fields",
    [
        {"if-none-match": "*"},
        {"cookie": "x=y"},
        {"origin": "http://localhost"},
        {"rtask-request-id": "12345678"},
        {"rtask-min-version": "x:1"},
        {"content-length": "0"},
        {"expect": "100-continue"},
        {"connection": "close"},
        {"accept": "application/sparql-results+xml"},
        {"accept": "image/png"},
        {"authorization": "Bearer rtk_0123456789ab_0123456789abcdef0123456789abcdef"},
    ],
)
def test_headers_that_need_a_closer_look_are_not_known(
    known: Known, tokens: TokenStore, fields: dict[str, str]
) -> None:
    application, _ = known()
    assert head_of(application, tokens.create("reader")[0], **fields) is None


def test_who_may_read_some_graphs_only_is_not_known(known: Known, tokens: TokenStore) -> None:
    application, _ = known()
    assert head_of(application, tokens.create("reader", rights=("read:urn:graph",))[0]) is None


@pytest.mark.parametrize(
    "text",
    [
        "SELECT * { ?s ?p ?o }",
        "SELECT ?o FROM <urn:g> { <urn:thing> <urn:p> ?o . ?o <urn:q> ?r }",
        "SELECT ?o { <urn:thing> <urn:p> ?o . SERVICE <urn:rtask:text> { ?o ?q ?r } }",
        "CONSTRUCT { <urn:thing> <urn:p> ?o } WHERE { <urn:thing> <urn:p> ?o . ?o ?q ?r }",
        "INSERT DATA { <urn:thing> <urn:p> 1 }",
        "SELECT ?o { <urn:thing> <urn:p> 'x\x00' }",
        "",
    ],
)
def test_what_is_no_small_query_is_not_admitted_and_counts_nothing(
    known: Known, tokens: TokenStore, text: str
) -> None:
    application, queries = known(rate=0.5)  # one request
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    assert queries.admit(head, quote(text, safe="").encode()) is None
    assert queries.admit(head, VALUE) is not None


@pytest.mark.parametrize("value", [b"ASK%zz", b"ASK&timeout=1", b"ASK{}", b"%ff", b"#", b"a b"])
def test_what_is_not_one_escaped_field_is_not_admitted(
    known: Known, tokens: TokenStore, value: bytes
) -> None:
    application, queries = known()
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    assert queries.admit(head, value) is None


def test_only_the_same_bytes_are_of_a_known_header(known: Known, tokens: TokenStore) -> None:
    application, _ = known()
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    whole = b"GET /query?query=ASK%20%7B%7D HTTP/1.1\r\n" + BLOCK
    assert head.value_in(whole) == b"ASK%20%7B%7D"
    for other in (
        whole.replace(b"/query?", b"/sparql?"),
        whole.replace(b"GET", b"PUT"),
        whole.replace(b"1.1", b"1.0"),
        whole.replace(b"localhost", b"otherhost"),
        whole[:-1],
        whole + b"\r\n",
    ):
        assert head.value_in(other) is None


def test_a_query_that_no_reader_takes_is_admitted_once(known: Known, tokens: TokenStore) -> None:
    application, queries = known(rate=0.5, max_in_flight=1)
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    query, channel = queries.admit(head, VALUE), Recorded()
    assert query is not None
    queries.answer(query, channel)
    [job] = channel.resumed
    assert channel.sent == []
    assert job.plan.lane == "point"
    assert application.run(job).status == 200
    assert not application.context.limiter.try_admit(head.caller)
    application.end(job)
    assert len(application.context.queries) == 0


def test_an_answer_that_is_kept_is_sent_at_once(known: Known, tokens: TokenStore) -> None:
    application, queries = known()
    head = head_of(application, tokens.create("reader")[0])
    assert head is not None
    request = replace(head.request, query_string=f"query={VALUE.decode()}")
    expected = [application.handle(request) for _ in range(2)][1]
    query, channel = queries.admit(head, VALUE), Recorded()
    assert query is not None
    queries.answer(query, channel)
    [sent] = channel.sent
    fields, _, body = sent.partition(b"\r\n\r\n")
    assert body == expected.body
    assert f"etag: {dict(expected.headers)['ETag']}".encode() in fields.split(b"\r\n")
    hit = 'rtask_answer_cache_total{outcome="hit"} 1.0'
    assert hit in application.context.metrics.text({}).decode()
    assert application.context.limiter.try_admit(head.caller)
