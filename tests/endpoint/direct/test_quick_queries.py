"""Queries that the protocol answers itself: admitted, answered, kept and counted like any other."""

from __future__ import annotations

import asyncio
import re
from contextlib import ExitStack, closing
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import pytest
import uvicorn
from uvicorn.server import ServerState

import endpoint
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.asgi import AsgiApplication
from endpoint.direct import DirectProtocol, QuickQueries
from endpoint.direct.exchange import Exchange
from endpoint.direct.heads import DECIDING, RELEVANT
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.point_lines import PointLines
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from rtask.sparql.slow_shapes import SlowShapes
from tests.endpoint.http.test_server_protocol import FakeTransport
from tests.servers import new_application

TEXT = "SELECT ?r { <urn:thing> <urn:p> ?o . ?o <urn:q> ?r }"
FIELD = f"query={quote(TEXT, safe='')}"
HOST = "Host: localhost"


class Recorded:
    """A connection that records what it is to send."""

    shared = b""
    loop = None

    def __init__(self):
        self.sent, self.resumed = [], []

    def send(self, exchange, data):
        self.sent.append(data)
        return True

    def resume(self, exchange, job, outcome):
        self.resumed.append(job)


@pytest.fixture(scope="module")
def kb():
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        kb.update(
            "INSERT DATA { GRAPH <urn:g> { <urn:thing> <urn:p> <urn:o> . <urn:o> <urn:q> 1 }}"
        )
        kb.readers.start()
        yield kb


@pytest.fixture
def tokens():
    with closing(TokenStore(None)) as store:
        yield store


@pytest.fixture
def made(kb, tokens):
    """Return a function that makes an application, and what answers small queries for it."""
    with ExitStack() as stack:

        def make(**settings):
            application = new_application(
                kb, NoEngine(), tokens, Config(**settings), clock=lambda: 100.0
            )
            stack.callback(application.close)
            # No readers: a query comes back at once, to be asked in a thread.
            return application, QuickQueries(
                application, PointLines(None, lambda: None, SlowShapes())
            )

        yield make


def take(queries, token, query=FIELD, path=b"/query", **fields):
    """Ask a query by GET; return what its connection recorded, or None if it was not taken."""
    channel = Recorded()
    exchange = Exchange(None, True, "GET", path, query.encode())
    headers = {"host": "localhost", "authorization": f"Bearer {token}", **fields}
    encoded = [(name.replace("_", "-").encode(), text.encode()) for name, text in headers.items()]
    origin = ("GET", path, "http", "127.0.0.1")
    return channel if queries.take(exchange, origin, encoded, channel) else None


def test_rates_hold(made, tokens):
    _, queries = made(rate=4.0)
    token = tokens.create("reader")[0]
    taken = [take(queries, token) is not None for _ in range(9)]
    assert taken == [True] * 8 + [False]


def test_so_many_of_a_caller_are_in_progress_at_once(made, tokens):
    application, queries = made(rate=0.0, max_in_flight=2)
    token = tokens.create("reader")[0]
    first = take(queries, token)
    assert take(queries, token) is not None
    assert take(queries, token) is None
    [job] = first.resumed
    application.end(job)
    assert take(queries, token) is not None


@pytest.mark.parametrize("how", ["revoked", "expired"])
def test_a_caller_is_known_until_its_token_is_void(made, tokens, how):
    _, queries = made(rate=0.0)
    text, token = tokens.create("reader")
    assert take(queries, text) is not None
    if how == "revoked":
        tokens.revoke(token.id)
    else:
        tokens.expire(token.id, timedelta(seconds=-1))
    assert take(queries, text) is None


def test_who_reads_without_a_token_is_known_until_one_is_limited_to_some_graphs(made, tokens):
    _, queries = made(rate=0.0)
    assert take(queries, tokens.create("reader")[0]) is not None
    channel = Recorded()
    ask = (("GET", b"/query", "http", "127.0.0.1"), [(b"host", b"localhost")], channel)
    assert queries.take(Exchange(None, True, "GET", b"/query", FIELD.encode()), *ask)
    limited = tokens.create("reader", rights=("read:urn:graph",))[0]
    assert not queries.take(Exchange(None, True, "GET", b"/query", FIELD.encode()), *ask)
    assert take(queries, limited) is None


@pytest.mark.parametrize(
    "fields",
    [
        {"if_none_match": "*"},
        {"cookie": "x=y"},
        {"origin": "http://localhost"},
        {"rtask_request_id": "12345678"},
        {"rtask_min_version": "x:1"},
        {"x_forwarded_for": "10.0.0.1"},
        {"idempotency_key": "1"},
        {"host": "evil.example"},
        {"accept": "application/sparql-results+xml"},
        {"accept": "image/png"},
        {"authorization": "Bearer rtk_0123456789ab_0123456789abcdef0123456789abcdef"},
        {"authorization": "Basic eDp5"},
    ],
)
def test_headers_that_need_a_closer_look_are_left_alone(made, tokens, fields):
    _, queries = made()
    assert take(queries, tokens.create("reader")[0], **fields) is None


@pytest.mark.parametrize(
    "text",
    [
        "SELECT * { ?s ?p ?o }",
        "SELECT ?o FROM <urn:g> { <urn:thing> <urn:p> ?o . ?o <urn:q> ?r }",
        "SELECT ?o { <urn:thing> <urn:p> ?o . SERVICE <urn:rtask:text> { ?o ?q ?r } }",
        "CONSTRUCT { <urn:thing> <urn:p> ?o } WHERE { <urn:thing> <urn:p> ?o . ?o ?q ?r }",
        "INSERT DATA { <urn:thing> <urn:p> 1 }",
        "SELECT ?o { <urn:thing> <urn:p> 'x\x00' }",
        "SELECT ?o { <urn:thing> <urn:p> ?o",
        "",
    ],
)
def test_what_is_no_small_query_is_not_taken_and_counts_nothing(made, tokens, text):
    _, queries = made(rate=0.5)  # one request
    token = tokens.create("reader")[0]
    assert take(queries, token, f"query={quote(text, safe='')}") is None
    assert take(queries, token) is not None


@pytest.mark.parametrize(
    "query", ["query=ASK%zz", f"{FIELD}&timeout=1", f"x=1&{FIELD}", "query=%ff", "query=a b", ""]
)
def test_what_is_not_one_escaped_field_is_not_taken(made, tokens, query):
    _, queries = made()
    assert take(queries, tokens.create("reader")[0], query) is None


def test_a_query_like_one_that_was_slow_is_not_taken(made, tokens):
    application, queries = made()
    token = tokens.create("reader")[0]
    application.router.asked.slow.note(TEXT.replace("urn:thing", "urn:hub"))
    assert take(queries, token) is None
    other = quote(TEXT.replace("?r", "?x"), safe="")
    assert take(queries, token, f"query={other}") is not None


def test_a_query_that_no_reader_takes_is_admitted_once(made, tokens):
    application, queries = made(rate=0.5, max_in_flight=1)
    token = tokens.create("reader")[0]
    channel = take(queries, token)
    [job] = channel.resumed
    assert channel.sent == []
    assert job.plan.lane == "point"
    assert application.run(job).status == 200
    assert take(queries, token) is None
    application.end(job)
    assert len(application.context.queries) == 0


_READ = re.compile(
    r"""(?:header\(|headers(?:\.get\(|\[))\s*"([\w-]+)"|"([\w-]+)" (?:not )?in (?:\w+\.)?headers"""
    r"""|^HEADER = "([\w-]+)\"""",
    re.MULTILINE,
)


def test_each_field_that_the_server_reads_is_known_here():
    """A field that no source reads changes no answer."""
    root = Path(endpoint.__file__).parent
    sources = [file.read_text("utf-8") for file in root.rglob("*.py") if "pages" not in file.parts]
    found = {name.lower().encode() for text in sources for m in _READ.findall(text) for name in m}
    assert {b"accept", b"if-none-match", b"rtask-min-version", b"idempotency-key"} <= found
    read = found - {b"", b"content-length", b"content-disposition", b"cache-control"}
    assert {n for n in read - RELEVANT - DECIDING if not n.startswith(b"rtask-")} == set()
    assert not RELEVANT & DECIDING


def test_a_field_that_the_server_does_not_read_may_differ_each_time(made, tokens):
    _, queries = made()
    token = tokens.create("reader")[0]
    for fields in ({"x_step": "1"}, {"x_step": "2"}, {"traceparent": "00-1"}, {"my_robot": "x"}):
        assert take(queries, token, **fields) is not None
    assert len(queries._heads._known) == 1


# Over the protocol, beside the one that leaves everything to the application


class Served:
    """A connection to an application, direct or by the application alone."""

    def __init__(self, application, direct):
        asgi = AsgiApplication(application, _NOTHING, SimpleNamespace(wsgi_app=None))
        self._points = asgi.points
        options = {}
        if direct:
            options = {"asgi": asgi, "queries": QuickQueries(application, asgi.points)}
        kind = DirectProtocol if direct else GuardedProtocol
        config = uvicorn.Config(
            asgi, http=kind, lifespan="off", log_config=None, proxy_headers=False
        )
        config.load()
        self.protocol = kind(config=config, server_state=ServerState(), app_state={}, **options)
        self.transport = FakeTransport()
        self.transport.get_extra_info = lambda name, default=None: {
            "peername": ("127.0.0.1", 5000), "sockname": ("127.0.0.1", 80)
        }.get(name, default)  # fmt: skip
        self.protocol.connection_made(self.transport)

    async def ask(self, *pieces):
        """Send pieces of a request; return the whole answer without what differs each time."""
        before = len(self.transport.written)
        for piece in pieces:
            self.protocol.data_received(piece)
            await asyncio.sleep(0)
        for _ in range(3_000):
            answer = b"".join(self.transport.written[before:])
            if _is_whole(answer):
                break
            await asyncio.sleep(0.01)
        return _steady(answer)

    def close(self):
        """End the connection, and give its readers back."""
        self.protocol.connection_lost(None)
        self._points.close()


class _Nothing:
    def __getattr__(self, name):
        return lambda *args, **options: None


_NOTHING = _Nothing()


def _is_whole(answer):
    head, end, body = answer.partition(b"\r\n\r\n")
    if not end:
        return False
    if b"content-length: " in head:
        length = head.split(b"content-length: ")[1].split(b"\r\n")[0]
        return len(body) >= int(length)
    return body.endswith(b"0\r\n\r\n") or b"304" in head[:12]


def _steady(answer):
    head, _, body = answer.partition(b"\r\n\r\n")
    lines = head.split(b"\r\n")
    varies = (b"rtask-request-id", b"date")
    rest = sorted(line for line in lines[1:] if not line.startswith(varies))
    body = b"" if b'"instance"' in body else body  # it holds the request's id
    return lines[0], rest, body


def get(query=FIELD, *lines, path="/query"):
    """Return a request by GET."""
    return "\r\n".join((f"GET {path}?{query} HTTP/1.1", HOST, *lines, "", "")).encode()


def post(body, media_type, *lines, path="/query"):
    """Return a request by POST."""
    fields = (f"Content-Type: {media_type}", f"Content-Length: {len(body)}", *lines)
    return "\r\n".join((f"POST {path} HTTP/1.1", HOST, *fields, "", body)).encode()


JSON = "Accept: application/sparql-results+json"
REQUESTS = {
    "by GET": get(),
    "at /sparql": get(path="/sparql"),
    "as JSON": get(FIELD, JSON, "User-Agent: x"),
    "as CSV": get(FIELD, "Accept: text/csv"),
    "as XML": get(FIELD, "Accept: application/sparql-results+xml"),
    "in no format": get(FIELD, "Accept: image/png"),
    "with an id": get(FIELD, "RTASK-Request-Id: 12345678"),
    "not modified": get(FIELD, "If-None-Match: *"),
    "with a limit of time": get(f"{FIELD}&timeout=3"),
    "no parameter": get(f"{FIELD}&nonsense=3"),
    "broken": get("query=SELECT%20x"),
    "many rows": get("query=SELECT%20*%20%7B%3Fs%20%3Fp%20%3Fo%7D"),
    "a wrong token": get(FIELD, "Authorization: Bearer x"),
    "a wrong host": get().replace(b"localhost", b"evil.example"),
    "as the body": post(TEXT, "application/sparql-query"),
    "as the body of /sparql": post(TEXT, "application/sparql-query", path="/sparql"),
    "as a form": post(FIELD, "application/x-www-form-urlencoded"),
    "in another charset": post(TEXT, "application/sparql-query; charset=utf-16"),
    "of no type": post(TEXT, "text/plain"),
    "an update": post("update=CLEAR%20ALL", "application/x-www-form-urlencoded"),
    "closing": get(FIELD, "Connection: close"),
    "zipped": get(FIELD, "Accept-Encoding: gzip"),
}


@pytest.mark.parametrize("name", REQUESTS)
def test_an_answer_is_the_same_as_that_of_the_application(made, name):
    application, _ = made(cache=False)

    async def answers():
        both = [Served(application, direct) for direct in (True, False)]
        try:
            return [await served.ask(REQUESTS[name]) for served in both]
        finally:
            for served in both:
                served.close()

    direct, other = asyncio.run(answers())
    assert direct == other
    assert direct[0].startswith(b"HTTP/1.1 ")


def test_an_answer_from_the_cache_is_the_one_that_was_kept(made):
    application, _ = made()

    async def answers():
        served = Served(application, True)
        try:
            return [await served.ask(get()) for _ in range(4)]
        finally:
            served.close()

    first, *others = asyncio.run(answers())
    assert others == [first] * 3
    text = application.context.metrics.text({}).decode()
    assert 'rtask_answer_cache_total{outcome="hit"} 2.0' in text
    assert 'rtask_query_total{form="SELECT",outcome="ok"} 4.0' in text


@pytest.mark.parametrize("cut", [10, -30, -1])
def test_a_request_that_comes_in_pieces_is_answered(made, cut):
    application, _ = made()

    async def answer(request):
        served = Served(application, True)
        try:
            return await served.ask(request[:cut], request[cut:])
        finally:
            served.close()

    for request in (get(), post(TEXT, "application/sparql-query")):
        status, _, body = asyncio.run(answer(request))
        assert status == b"HTTP/1.1 200 OK"
        assert b'"value":"1"' in body


def test_requests_sent_at_once_are_answered_in_order(made):
    application, _ = made()

    async def answers():
        served = Served(application, True)
        try:
            texts = [TEXT, TEXT.replace("?r", "?x"), "SELECT * { ?s ?p ?o }"]
            asked = [get(f"query={quote(text, safe='')}") for text in texts]
            served.protocol.data_received(b"".join(asked))
            for _ in range(3_000):
                written = b"".join(served.transport.written)
                if written.count(b"HTTP/1.1 200") == 3 and written.endswith((b"}", b"0\r\n\r\n")):
                    break
                await asyncio.sleep(0.01)
            return written
        finally:
            served.close()

    first, second, third = asyncio.run(answers()).split(b"HTTP/1.1 200 OK")[1:]
    assert b'"vars":["r"]' in first
    assert b'"vars":["x"]' in second
    assert b'"s"' in third


def test_a_query_ends_when_its_client_leaves(made):
    application, _ = made()

    async def leave():
        served = Served(application, True)
        served.protocol._queries._points.ask = lambda query: None  # never answered
        served.protocol.data_received(get())
        [running] = application.context.queries._running.values()
        served.close()
        return running.stopped

    assert asyncio.run(leave())
