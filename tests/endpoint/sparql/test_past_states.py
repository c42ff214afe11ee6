"""Earlier states of the graph are queried by commit or time, and nothing of them stays behind."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.http.messages import Request, Response
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.sparql import past_states
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

VALUES = "SELECT ?o { <urn:mug> <urn:mass> ?o } ORDER BY ?o"


@dataclass
class Lab:
    """A served folder; three commits set one value after the other."""

    kb: KnowledgeBase
    application: Application
    seqs: list[int]

    def ask(self, as_of: object, text: str = VALUES) -> Response:
        return self.application.handle(_request(as_of, text))

    def values(self, as_of: object) -> list[str]:
        response = self.ask(as_of)
        assert response.status == 200, response.body
        [_, *rows] = csv.reader(io.StringIO(response.body.decode()))
        return [row[0] for row in rows]


def _request(as_of: object, text: str) -> Request:
    query = urlencode({"query": text, "as_of": str(as_of)})
    headers = {"host": "localhost", "accept": "text/csv"}
    return Request("GET", "/sparql", query, headers, site="http://localhost")


def _copies(kb: KnowledgeBase) -> list[Path]:
    assert kb.folder is not None
    return sorted((kb.folder / "followers").glob("*"))


def _lab(stack: ExitStack, target: Any) -> Lab:
    kb = stack.enter_context(rtask.open(target, ontologies=False, reason=False, flush="os"))
    tokens = stack.enter_context(closing(TokenStore(None)))
    application = new_application(kb, NoEngine(), tokens, Config(rate=0, write_rate=0))
    stack.callback(application.close)
    seqs = []
    for mass in (1, 2, 3):
        kb.update(
            "DELETE { <urn:mug> <urn:mass> ?o } INSERT { <urn:mug> <urn:mass> "
            f"{mass} }} WHERE {{ OPTIONAL {{ <urn:mug> <urn:mass> ?o }} }}"
        )
        seqs.append(kb.seq)
    return Lab(kb, application, seqs)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with ExitStack() as stack:
        yield _lab(stack, tmp_path_factory.mktemp("past") / "kb")


def test_a_state_is_named_by_its_commit(lab: Lab) -> None:
    assert [lab.values(seq) for seq in lab.seqs] == [["1"], ["2"], ["3"]]
    assert lab.values(f"{lab.kb.epoch}:{lab.seqs[0]}") == ["1"]
    assert lab.values(lab.seqs[0] - 1) == []
    answer = lab.ask(lab.seqs[1])
    headers = dict(answer.headers)
    assert headers["RTASK-As-Of"] == f"{lab.kb.epoch}:{lab.seqs[1]}"
    assert headers["RTASK-Version"] == f"{lab.kb.epoch}:{lab.seqs[2]}"
    assert "ETag" not in headers


def test_a_state_is_named_by_a_time(lab: Lab) -> None:
    times = {entry.seq: entry.time for entry in lab.kb.history("urn:mug")}
    for seq, mass in zip(lab.seqs, "123", strict=True):
        assert lab.values(times[seq]) == [mass]
    assert lab.values("2000-01-01T00:00:00Z") == []
    assert lab.values("2999-01-01T00:00:00+02:00") == ["3"]


@pytest.mark.parametrize(
    ("as_of", "status"),
    [
        ("soon", 400),
        ("-1", 400),
        ("2026-01-02T03:04:05", 400),
        ("1:2:3", 400),
        ("999999", 400),
        ("0123abcd:1", 410),
    ],
)
def test_what_names_no_state_is_refused(lab: Lab, as_of: str, status: int) -> None:
    assert lab.ask(as_of).status == status


def test_an_earlier_state_takes_no_update_and_calls_no_other_server(lab: Lab) -> None:
    assert lab.ask(lab.seqs[0], "ASK { SERVICE <http://x/> { ?s ?p ?o } }").status == 400
    form = urlencode({"update": "CLEAR ALL", "as_of": "1"}).encode()
    headers = {"host": "localhost", "content-type": "application/x-www-form-urlencoded"}
    update = Request("POST", "/sparql", "", headers, form, site="http://localhost")
    assert lab.application.handle(update).status == 400


def test_few_states_are_open_at_a_time(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    for seq in (*lab.seqs, *lab.seqs):
        lab.values(seq)
    assert len(_copies(lab.kb)) <= 2
    monkeypatch.setattr(past_states, "_MAX_UNDONE", 1)
    lab.application.router.asked.past._close_idle(0.0)
    assert _copies(lab.kb) == []
    assert lab.ask(lab.seqs[0]).status == 413


def test_a_state_that_is_being_read_stays_open(lab: Lab) -> None:
    many = " ".join(str(number) for number in range(400))
    text = f"SELECT * {{ VALUES ?x {{ {many} }} VALUES ?y {{ {many} }} }}"
    request = _request(lab.seqs[0], text)
    caller = lab.application.context.auth.identify(request, limited=True)
    answer = lab.application.router.plan(request, caller, "/sparql").run()
    assert answer.chunks is not None
    for seq in lab.seqs[1:]:
        lab.values(seq)
    lab.application.router.asked.past._close_idle(0.0)
    assert len(_copies(lab.kb)) == 1
    whole = answer.body + b"".join(answer.chunks)
    answer.chunks.close()
    assert len(whole.splitlines()) == 160_001


def test_a_server_that_closes_leaves_no_copy(tmp_path: Path) -> None:
    with ExitStack() as stack:
        lab = _lab(stack, tmp_path / "kb")
        assert lab.values(lab.seqs[0]) == ["1"]
        assert len(_copies(lab.kb)) == 1
        lab.application.close()
        assert _copies(lab.kb) == []


def test_a_graph_in_memory_has_no_earlier_states() -> None:
    with ExitStack() as stack:
        lab = _lab(stack, ":memory:")
        assert lab.ask(lab.seqs[0]).status == 501
