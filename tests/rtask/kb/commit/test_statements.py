"""Statements about statements, their expiry, and the past."""

from __future__ import annotations

import datetime as dt
import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.errors import (
    ClosedError,
    DataError,
    ForbiddenError,
    UnsupportedError,
    UsageError,
)
from rtask.kb.commit.commit import Request
from rtask.kb.commit.expiry import Expiry
from rtask.kb.commit.statements import INVALIDATED
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Literal, NamedNode, Quad

pytestmark = pytest.mark.slow

_ON = ("urn:mug", "urn:on", NamedNode("urn:table"))
_RT = "https://w3id.org/rtask-kg/ns#"


@pytest.fixture(params=["memory", "folder"])
def kb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KnowledgeBase]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with rtask.open(target, flush="os") as opened:
        yield opened


def _later(seconds: float) -> dt.datetime:
    return dt.datetime.now(dt.UTC) + dt.timedelta(seconds=seconds)


def test_a_statement_carries_confidence_validity_and_source(kb: KnowledgeBase) -> None:
    until = _later(3600)
    with kb.transaction(agent="nao-1") as tx:
        tx.add(*_ON, confidence=0.8, valid_until=until, source="urn:image:1")
        tx.add("urn:mug", "urn:plain", 1)
    [said] = kb.annotations(*_ON)
    assert said.confidence == 0.8
    assert said.valid_until == until
    assert said.source == NamedNode("urn:image:1")
    assert said.graph == kb.graphs.agent("nao-1")
    assert kb.annotations("urn:mug", "urn:plain", 1) == []
    asked = f"SELECT ?c {{ << <urn:mug> <urn:on> ?where >> <{_RT}confidence> ?c }}"
    assert [row.value("c") for row in kb.select(asked)] == [0.8]


def test_saying_it_again_replaces_what_was_said(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        tx.add(*_ON, confidence=0.5)
        tx.add(*_ON, confidence=0.6)
    with kb.transaction() as tx:
        tx.add(*_ON, confidence=0.7)
    assert [said.confidence for said in kb.annotations(*_ON)] == [0.7]
    with kb.transaction(agent="nao-1") as tx:  # another graph says something else
        tx.add(*_ON, confidence=0.1)
    assert {said.confidence for said in kb.annotations(*_ON)} == {0.7, 0.1}
    with pytest.raises(UsageError, match="confidence"), kb.transaction() as tx:
        tx.add(*_ON, confidence=1.5)
    with pytest.raises(UsageError, match="is not a time"), kb.transaction() as tx:
        tx.add(*_ON, valid_until="tomorrow")


def test_only_the_owner_retracts_and_others_need_a_reason(kb: KnowledgeBase) -> None:
    with kb.transaction(agent="nao-1") as tx:
        tx.add(*_ON, confidence=0.8)
    with pytest.raises(ForbiddenError, match="retract"):
        kb.retract(*_ON, agent="nao-2", reason="I see it elsewhere")
    with pytest.raises(UsageError, match="reason"):
        kb.retract(*_ON)
    commit = kb.retract(*_ON, reason="the mug fell")
    assert kb.match(*_ON) == []
    [said] = kb.annotations(*_ON)
    assert said.invalidated is not None
    assert said.confidence == 0.8
    last = kb.history("urn:mug")[-1]
    assert (last.seq, last.note, len(last.removed)) == (commit.seq, "the mug fell", 1)
    with pytest.raises(DataError, match="no graph states"):
        kb.retract(*_ON, reason="again")


def test_an_owner_retracts_without_a_reason(kb: KnowledgeBase) -> None:
    with kb.transaction(agent="nao-1") as tx:
        tx.add(*_ON)
    kb.retract(*_ON, agent="nao-1")
    assert kb.match(*_ON) == []
    with kb.transaction(agent="nao-1") as tx:
        tx.add("urn:m", "http://www.w3.org/1999/02/22-rdf-syntax-ns#type", NamedNode(_RT + "Mug"))
    derived = ("urn:m", "http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
    with pytest.raises(ForbiddenError):  # what follows goes with its reason only
        kb.retract(*derived, NamedNode(_RT + "Container"), agent="nao-1")


def _wait_until_gone(kb: KnowledgeBase, *pattern: Any, within_s: float = 60.0) -> None:
    end = time.monotonic() + within_s
    while kb.match(*(pattern or _ON)):
        assert time.monotonic() < end, "it did not expire"
        time.sleep(0.02)


def test_a_statement_expires_as_a_commit_of_its_own(kb: KnowledgeBase) -> None:
    with kb.transaction(agent="nao-1") as tx:
        tx.add(*_ON, valid_until=_later(0.3))
        tx.add("urn:pen", "urn:on", NamedNode("urn:table"), valid_until=_later(3600))
    _wait_until_gone(kb)
    assert len(kb.match("urn:pen", "urn:on")) == 1
    assert kb.history("urn:mug")[-1].note == "expired"
    assert len(kb.match(predicate=INVALIDATED)) == 1


def test_what_expired_while_closed_goes_at_the_next_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    began = dt.datetime.now(dt.UTC)
    with monkeypatch.context() as patch:
        # Time stands still until it is closed, however long that takes.
        patch.setattr(Expiry, "clock", lambda _: began)
        with rtask.open(tmp_path / "kb", ontologies=False) as kb, kb.transaction() as tx:
            tx.add(*_ON, valid_until=began + dt.timedelta(milliseconds=1))
    with rtask.open(tmp_path / "kb", mode="r") as kb:
        assert len(kb.match(*_ON)) == 1
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        _wait_until_gone(kb)


def test_a_renewed_statement_stays(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        tx.add(*_ON, valid_until=_later(0.3))
    with kb.transaction() as tx:
        tx.add(*_ON, valid_until=_later(3600))
        tx.add("urn:pen", "urn:on", NamedNode("urn:table"), valid_until=_later(0.4))
    _wait_until_gone(kb, "urn:pen", "urn:on")  # which was to expire after the mug
    assert len(kb.match(*_ON)) == 1


def test_history_is_filtered_by_agent_graph_and_time(kb: KnowledgeBase) -> None:
    start = dt.datetime.now(dt.UTC)
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", agent="nao-1")
    middle = dt.datetime.now(dt.UTC)
    kb.update("INSERT DATA { <urn:a> <urn:p> 2 }", agent="nao-2")
    seq = kb.seq

    def found(**options: object) -> list[int]:
        return [entry.seq for entry in kb.history("urn:a", **options)]  # type: ignore[arg-type]

    assert found() == [seq - 1, seq]
    assert found(agent="nao-2") == [seq]
    assert found(graph=kb.graphs.agent("nao-1")) == [seq - 1]
    assert found(start=start, end=middle) == [seq - 1]
    assert found(start=middle.isoformat()) == [seq]
    assert found(since=seq - 1) == [seq]
    assert found(upto=seq - 1) == [seq - 1]


def _everything(kb: KnowledgeBase) -> set[Quad]:
    return set(kb.store.quads_for_pattern(None, None, None, None))


@pytest.mark.parametrize("options", [{}, {"union": "view"}, {"plain": True}], ids=str)
def test_the_past_is_as_it_was(tmp_path: Path, options: dict[str, Any]) -> None:
    chance = random.Random(2)
    with rtask.open(tmp_path / "kb", ontologies=False, flush="os", **options) as kb:
        then: dict[int, set[Quad]] = {kb.seq: _everything(kb)}
        for _ in range(25):
            graph, number = f"<urn:g{chance.randrange(2)}>", chance.randrange(4)
            kb.update(
                chance.choice(
                    [
                        f"INSERT DATA {{ GRAPH {graph} {{ <urn:{number}> <urn:p> [] }} }}",
                        f"INSERT DATA {{ GRAPH {graph} {{ <urn:{number}> a <urn:C> }} }}",
                        f"DELETE WHERE {{ GRAPH {graph} {{ <urn:{number}> ?p ?o }} }}",
                        f"DROP SILENT GRAPH {graph}",
                        f"CREATE SILENT GRAPH {graph}",
                    ]
                )
            )
            then[kb.seq] = _everything(kb)
        for seq in chance.sample(sorted(then), 6):
            with kb.as_of(seq) as past:
                assert _everything(past) == then[seq]
                assert past.seq == seq
                with pytest.raises(ClosedError):
                    past.update("INSERT DATA { <urn:x> <urn:y> 1 }")
        with pytest.raises(UsageError, match="no commit"):
            kb.as_of(kb.seq + 1)


def test_the_past_before_a_load_in_bulk_is_refused(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        seq = kb.seq
        graph = kb.graphs.imported("bulk")
        quads = [Quad(NamedNode("urn:s"), NamedNode("urn:p"), Literal(n), graph) for n in range(9)]
        kb.bulk_add(quads, graph, Request(kb.access()))
        with pytest.raises(UnsupportedError, match="bulk"):
            kb.as_of(seq)
        with kb.as_of(kb.seq) as past:
            assert len(past.match(graph=graph)) == 9
    with rtask.open(":memory:") as kb, pytest.raises(UnsupportedError, match="journal"):
        kb.as_of(kb.seq)


def test_the_past_is_found_by_time(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        for mass in (1, 2):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {mass} }}")
        first, second = kb.history("urn:a")
        with kb.as_of(first.time) as past:
            assert (past.seq, len(past.match("urn:a"))) == (first.seq, 1)
        assert kb.commit_at(second.time) == second.seq
        assert kb.commit_at("2000-01-01T00:00:00Z") == 0
        with kb.as_of("2000-01-01T00:00:00Z") as past:
            assert past.match() == []
        assert kb.changed_since(first.seq) > 0
        assert kb.changed_since(kb.seq) == 0
