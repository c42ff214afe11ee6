"""The answer cache: never a stale answer, whatever is written between two equal questions."""

from __future__ import annotations

import gzip
import json
import random
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.http.messages import Request, Response
from endpoint.monitoring.metrics import Metrics
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.sparql import answer_cache
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

GRAPHS = ("urn:graph:0", "urn:graph:1")
TEXTS = (
    "SELECT ?o { <urn:thing> <urn:p> ?o } ORDER BY ?o",
    "SELECT ?p ?o { <urn:thing> ?p ?o }",
    "ASK { ?s a <urn:Container> }",
    "SELECT ?o { <urn:thing> <urn:p> ?o . ?o <urn:q> ?r }",
    "SELECT (COUNT(*) AS ?n) { ?s <urn:p> ?o }",
    f"SELECT ?o FROM <{GRAPHS[0]}> {{ ?s <urn:p> ?o }} ORDER BY ?o",
    "CONSTRUCT WHERE { <urn:thing> <urn:p> ?o }",
    "SELECT ?o { <#thing> <urn:p> ?o }",
)
FIELDS: tuple[dict[str, str], ...] = (
    {},
    {"inferred": "0"},
    {"default-graph-uri": GRAPHS[0]},
    {"default-graph-uri": GRAPHS[1]},
    {"named-graph-uri": GRAPHS[0]},
)


@dataclass
class Pair:
    """Two applications on one graph: one that keeps answers and one that does not."""

    kb: KnowledgeBase
    cached: Application
    plain: Application
    tokens: dict[str, str]

    @property
    def hits(self) -> int:
        """Number of answers found in the cache."""
        counters = self.cached.context.metrics.text({}).decode()
        line = 'rtask_answer_cache_total{outcome="hit"} '
        found = [text for text in counters.splitlines() if text.startswith(line)]
        return int(float(found[0].removeprefix(line))) if found else 0


@pytest.fixture(params=["memory", "folder"])
def pair(request: pytest.FixtureRequest, tmp_path: Any) -> Iterator[Pair]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with ExitStack() as stack:
        kb = stack.enter_context(rtask.open(target, ontologies=False, flush="os"))
        store = stack.enter_context(closing(TokenStore(None)))
        tokens = {
            "reader": store.create("reader")[0],
            "robot": store.create("robot", agent="nao-1")[0],
            "admin": store.create("admin")[0],
        }
        kb.update(
            f"INSERT DATA {{ GRAPH <{GRAPHS[0]}> {{ <urn:Cup> "
            "<http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:Container> } }"
        )
        applications = [
            new_application(kb, NoEngine(), store, Config(rate=0, write_rate=0, cache=cache))
            for cache in (True, False)
        ]
        yield Pair(kb, *applications, tokens)
        for application in applications:
            application.close()


def _ask(fields: dict[str, str], headers: dict[str, str], method: str = "GET") -> Request:
    headers = {"host": "localhost", "rtask-request-id": "always-the-same", **headers}
    return Request(method, "/query", urlencode(fields), headers, client="10.0.0.7",
                   site=f"http://{headers['host']}")  # fmt: skip


def _bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


def _shown(response: Response) -> tuple[Any, ...]:
    """Return what a client can tell apart; the order of rows and triples may differ."""
    header = {name.lower(): value for name, value in response.headers}
    body = response.body
    if header.get("content-encoding") == "gzip":
        body = gzip.decompress(body)
    lines: Any = sorted(body.split(b"\n"))
    if response.media_type.endswith("json") and body and b'"bindings"' in body:
        lines = sorted(json.dumps(row) for row in json.loads(body)["results"]["bindings"])
    names = ("etag", "rtask-version", "content-encoding", "vary", "cache-control")
    return response.status, response.media_type, lines, *(header.get(name) for name in names)


def _write(pair: Pair, chance: random.Random) -> None:
    graph, number = chance.choice(GRAPHS), chance.randrange(4)
    text = chance.choice(
        [
            f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:thing> <urn:p> {number} }} }}",
            f"DELETE DATA {{ GRAPH <{graph}> {{ <urn:thing> <urn:p> {number} }} }}",
            f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:thing> <urn:p> <urn:x{number}> . "
            f"<urn:x{number}> <urn:q> {number} }} }}",
            f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:cup{number}> a <urn:Cup> }} }}",
            f"DELETE {{ GRAPH <{graph}> {{ ?s a <urn:Cup> }} }} "
            f"WHERE {{ GRAPH <{graph}> {{ ?s a <urn:Cup> }} }}",
            f"INSERT DATA {{ GRAPH <{GRAPHS[0]}> {{ <http://localhost/query#thing> <urn:p> 7 }} }}",
            f"CLEAR GRAPH <{GRAPHS[1]}>",
        ]
    )
    headers = _bearer(pair.tokens["admin"])
    body = urlencode({"update": text}).encode()
    headers |= {"content-type": "application/x-www-form-urlencoded", "host": "localhost"}
    writer = chance.choice((pair.cached, pair.plain))
    assert writer.handle(Request("POST", "/update", "", headers, body)).status == 204


@pytest.mark.slow
def test_random_writes_between_reads_never_give_a_stale_answer(pair: Pair) -> None:
    """Dataset, inference, rights, types, compression, host, HEAD and conditions at random."""
    chance = random.Random(5)
    etags: list[str] = ["*"]
    for step in range(250):
        if chance.random() < 0.15:
            _write(pair, chance)
        fields = {"query": chance.choice(TEXTS[: 4 + 4 * (step % 2)]), **chance.choice(FIELDS)}
        headers = _bearer(chance.choice(list(pair.tokens.values())))
        if chance.random() < 0.3:
            headers["accept"] = chance.choice(("text/csv", "application/sparql-results+xml", "*/*"))
        if chance.random() < 0.2:
            headers["accept-encoding"] = "gzip"
        if chance.random() < 0.2:
            headers["if-none-match"] = chance.choice(etags[-20:])
        if chance.random() < 0.1:
            headers["host"] = "localhost:81"
        method = "HEAD" if chance.random() < 0.1 else "GET"
        asked = [_ask(fields, headers, method) for _ in range(chance.choice((1, 3)))]
        expected = _shown(pair.plain.handle(asked[0]))
        for request in asked:
            answer = pair.cached.handle(request)
            assert _shown(answer) == expected, (step, fields, headers)
        etags.append(dict(answer.headers).get("ETag", "*"))
    assert pair.hits > 50


def test_an_answer_is_kept_when_its_question_comes_for_the_second_time(pair: Pair) -> None:
    request = _ask({"query": TEXTS[0]}, _bearer(pair.tokens["reader"]))
    for expected in (0, 0, 1, 2):
        assert pair.cached.handle(request).status == 200
        assert pair.hits == expected
    pair.kb.update("INSERT DATA { <urn:thing> <urn:p> 99 }")
    assert b"99" in pair.cached.handle(request).body
    assert pair.hits == 2


def test_questions_in_the_body_are_told_apart(pair: Pair) -> None:
    headers = {**_bearer(pair.tokens["reader"]), "host": "localhost"}
    headers["content-type"] = "application/sparql-query"
    for text, expected in ((b"ASK {}", b"true"), (b"ASK { FILTER(false) }", b"false")) * 3:
        answer = pair.cached.handle(Request("POST", "/query", "", headers, text))
        assert expected in answer.body
    assert pair.hits == 2


def test_an_answer_that_a_commit_overtook_is_not_kept() -> None:
    """The commit comes while a query is evaluated, and another request sees it first."""
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        cache, access = answer_cache.AnswerCache(kb, Metrics()), Access(None, "reader")
        request, other = _ask({"query": TEXTS[0]}, {}), _ask({"query": TEXTS[1]}, {})
        answer = Response(200, b"answer")
        for is_overtaken in (True, False):
            cache.find(request, access)
            keep = cache.keeper(request, access, "SELECT", TEXTS[0], "etag")
            keep = keep or cache.keeper(request, access, "SELECT", TEXTS[0], "etag")
            assert keep is not None
            if is_overtaken:
                kb.update("INSERT DATA { <urn:thing> <urn:p> 99 }")
                cache.find(other, access)
            keep(answer)
            assert (cache.find(request, access) is None) is is_overtaken


@pytest.mark.slow
@pytest.mark.parametrize("call", ["NOW()", "RAND()", "UUID()", "STRUUID()", "BNODE()"])
def test_an_answer_that_differs_each_time_is_not_kept(pair: Pair, call: str) -> None:
    request = _ask({"query": f"SELECT ({call} AS ?x) {{}}"}, _bearer(pair.tokens["reader"]))
    for _ in range(4):
        assert pair.cached.handle(request).status == 200
    assert pair.hits == 0


def test_rights_and_rates_are_checked_before_the_cache_is_asked(tmp_path: Any) -> None:
    with ExitStack() as stack:
        kb = stack.enter_context(rtask.open(":memory:", ontologies=False, reason=False))
        store = stack.enter_context(closing(TokenStore(None)))
        token, record = store.create("reader")
        config = Config(host="0.0.0.0", rate=4.0)
        application = new_application(kb, NoEngine(), store, config, clock=lambda: 100.0)
        stack.callback(application.close)
        statuses = [
            application.handle(_ask({"query": TEXTS[0]}, _bearer(token))).status for _ in range(9)
        ]
        assert statuses == [200] * 8 + [429]
        assert application.handle(_ask({"query": TEXTS[0]}, {})).status == 401
        store.revoke(record.id)
        assert application.handle(_ask({"query": TEXTS[0]}, _bearer(token))).status == 401


def test_large_answers_are_not_kept_and_the_oldest_give_way(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers = _bearer(pair.tokens["reader"])
    long = "x" * 70_000
    pair.kb.update(f'INSERT DATA {{ <urn:long> <urn:p> "{long}" }}')
    for _ in range(4):
        pair.cached.handle(_ask({"query": "SELECT ?o { <urn:long> <urn:p> ?o }"}, headers))
    assert pair.hits == 0
    monkeypatch.setattr(answer_cache, "MAX_BYTES", 8_000)
    requests = [
        _ask({"query": f"SELECT ?o {{ <urn:thing:{n}> <urn:p> ?o }}"}, headers) for n in range(20)
    ]
    for request in requests * 2:
        pair.cached.handle(request)
    before = pair.hits
    pair.cached.handle(requests[0])
    assert pair.hits == before
    pair.cached.handle(requests[19])
    assert pair.hits == before + 1


def test_a_time_limit_that_a_role_shortens_is_named_each_time(pair: Pair) -> None:
    fields = {"query": TEXTS[0], "timeout": "500"}
    for role, expected in (("admin", None), ("admin", None), ("reader", "30")) * 2:
        answer = pair.cached.handle(_ask(fields, _bearer(pair.tokens[role])))
        assert dict(answer.headers).get("RTASK-Timeout") == expected
