"""Queries in processes of their own: ended at their deadline, isolated, never stale."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import (
    ClosedError,
    QueryTimeout,
)
from rtask.kb.readers.request import ReaderLimits
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.results import Solutions
from tests.commands import start_command
from tests.processes import is_alive, wait_until
from tests.rtask.kb.numbered_things import fill

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="readers are forked")

_ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
_COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
_PAIRS = "SELECT * { ?s ?p ?o . ?a ?b ?c }"


@pytest.fixture(params=["memory", "folder", "snapshot"])
def kb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KnowledgeBase]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with rtask.open(target, reason=False, ontologies=False, flush="os") as opened:
        if request.param == "snapshot":
            opened.readers.limits = ReaderLimits(replica_max=0)
        fill(opened)
        yield opened


@pytest.mark.slow
def test_a_query_is_ended_at_its_deadline_and_the_next_one_works(kb: KnowledgeBase) -> None:
    kb.warm_up()
    with pytest.raises(QueryTimeout, match="within 1 s"):
        kb.query(_ENDLESS, timeout_s=1.0)
    readers = kb.stats()["readers"]
    assert readers["running"] == 0
    assert readers["killed"] == 1
    assert kb.query("ASK { <urn:thing:1> <urn:number> 1 }", timeout_s=30.0) is True


def test_a_killed_reader_leaves_no_process_and_no_zombie(memory: KnowledgeBase) -> None:
    memory.warm_up()
    keeper, reader = memory.stats()["readers"]["processes"]
    with pytest.raises(QueryTimeout):
        memory.query(_ENDLESS, timeout_s=0.2)
    wait_until(lambda: not is_alive(reader))
    assert is_alive(keeper)


def _read_all(kb: KnowledgeBase, seen: set[int]) -> None:
    with kb.stream(_PAIRS, timeout_s=0.2) as stream:
        for _ in stream:
            seen.update(kb.stats()["readers"]["processes"])


@pytest.mark.slow
def test_ten_deadlines_in_a_row_leave_nothing(tmp_path: Path) -> None:
    seen: set[int] = set()
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        kb.readers.limits = ReaderLimits(replica_max=0)
        fill(kb)
        for number in range(10):
            with pytest.raises(QueryTimeout):
                _read_all(kb, seen)
            with kb.transaction() as tx:
                tx.add("urn:a", "urn:b", number)
        assert len(list((tmp_path / "kb" / "snapshots").iterdir())) <= 1
    assert not (tmp_path / "kb" / "snapshots").exists()
    wait_until(lambda: not any(map(is_alive, seen)))


def test_closing_ends_every_process_and_every_query(memory: KnowledgeBase) -> None:
    memory.warm_up()
    stream = memory.stream(_PAIRS)
    next(stream)
    processes = memory.stats()["readers"]["processes"]
    assert len(processes) == 2
    memory.close()
    wait_until(lambda: not any(map(is_alive, processes)))
    with pytest.raises(ClosedError):
        list(stream)
    with pytest.raises(ClosedError):
        memory.query(_COUNT, timeout_s=1.0)


def test_readers_do_not_outlive_a_killed_owner() -> None:
    script = Path(__file__).with_name("reader_owner.py").read_text("utf-8")
    owner = start_command(script, module="tests.program", stderr=subprocess.DEVNULL)
    assert owner.stdout is not None
    with owner.stdout:
        processes = list(map(int, owner.stdout.readline().split()))
        assert len(processes) >= 2
        owner.send_signal(signal.SIGKILL)
        owner.wait()
    wait_until(lambda: not any(map(_is_running, processes)))


def _is_running(pid: int) -> bool:
    """Whether a process is at work; one that nobody waits for may stay in the table."""
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text("ascii")
    except OSError:
        return False


@pytest.mark.slow
def test_every_acknowledged_commit_is_seen(kb: KnowledgeBase) -> None:
    for number in range(20):
        kb.update(f"INSERT DATA {{ <urn:last> <urn:is> {number} }}")
        asked = f"ASK {{ <urn:last> <urn:is> {number} }}"
        assert kb.query(asked, timeout_s=30.0) is True


def test_commits_are_seen_from_many_threads(memory: KnowledgeBase) -> None:
    missed: list[int] = []

    def work(worker: int) -> None:
        for number in range(15):
            with memory.transaction() as tx:
                tx.add(f"urn:worker:{worker}", "urn:did", number)
            asked = f"ASK {{ <urn:worker:{worker}> <urn:did> {number} }}"
            if not memory.query(asked, timeout_s=60.0):
                missed.append(number)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert missed == []


_TERMS = [
    "<urn:a>",
    '"text \\" with \\n marks"',
    '"01"^^<http://www.w3.org/2001/XMLSchema#int>',
    '"hallo"@de',
    '"x"^^<urn:own>',
    "<<( <urn:a> <urn:p> <<( <urn:b> <urn:p> 255 )>> )>>",
    "[]",
    "[ <urn:p> [] ]",
    "255",
    "1.5e300",
]


def _random_update(chance: random.Random) -> str:
    graph = f"<urn:graph:{chance.randrange(3)}>"
    terms = " , ".join(chance.sample(_TERMS, 3))
    return chance.choice(
        [
            f"INSERT DATA {{ GRAPH {graph} {{ <urn:{chance.randrange(5)}> <urn:p> {terms} }} }}",
            f"INSERT DATA {{ GRAPH {graph} {{ <urn:{chance.randrange(5)}> <urn:p> {terms} }} }}",
            "DELETE { GRAPH ?g { ?s ?p ?o } } WHERE { GRAPH ?g { ?s ?p ?o } "
            "FILTER(ISBLANK(?o) && STRSTARTS(STR(?g), 'urn:graph')) }",
            f"DELETE {{ GRAPH {graph} {{ ?s ?p ?o }} }} INSERT {{ GRAPH {graph} {{ ?o ?p ?s }} }} "
            f"WHERE {{ GRAPH {graph} {{ ?s ?p ?o FILTER(ISBLANK(?o) || ISIRI(?o)) }} }}",
            f"DROP SILENT GRAPH {graph}",
            f"CREATE SILENT GRAPH {graph}",
            f"COPY SILENT {graph} TO <urn:graph:2>",
            f"DROP SILENT GRAPH {graph} ; INSERT DATA {{ GRAPH {graph} {{ <urn:x> <urn:p> 1 }} }}",
        ]
    )


def _state(rows: object) -> set[str]:
    assert isinstance(rows, Solutions)
    return {" ".join(map(str, row)) for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_replica_equals_the_store_after_random_commits(memory: KnowledgeBase, seed: int) -> None:
    _compare_random_commits(memory, seed)


def test_a_replica_of_a_view_equals_it_too() -> None:
    with rtask.open(":memory:", union="view", reason=False, ontologies=False) as kb:
        _compare_random_commits(kb, 7)


def _compare_random_commits(memory: KnowledgeBase, seed: int) -> None:
    chance = random.Random(seed)
    everything = "SELECT * { { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }"
    graphs = "SELECT ?g { GRAPH ?g {} }"
    for step in range(40):
        memory.update(_random_update(chance))
        if step % 5 == 4:
            for text in (everything, graphs):
                assert _state(memory.query(text, timeout_s=60.0)) == _state(memory.query(text))
        if step == 20:  # one that is built while there is much to copy
            memory.readers.invalidate()


def test_a_reader_killed_between_commits_loses_none(memory: KnowledgeBase) -> None:
    memory.warm_up()
    for number in range(10):
        with memory.transaction() as tx:
            for at in range(500):
                tx.add(f"urn:burst:{number}", "urn:at", at)
        keeper, *others = memory.stats()["readers"]["processes"]
        for victim in others if number % 3 else [keeper, *others]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
        asked = f"SELECT (COUNT(*) AS ?n) {{ <urn:burst:{number}> ?p ?o }}"
        [row] = memory.query(asked, timeout_s=60.0)  # type: ignore[misc]
        assert row.value("n") == 500  # type: ignore[union-attr]
    assert memory.query(_COUNT, timeout_s=60.0)[0] == memory.query(_COUNT)[0] or _equal(memory)


def _equal(kb: KnowledgeBase) -> bool:
    asked, known = kb.query(_COUNT, timeout_s=60.0), kb.query(_COUNT)
    assert isinstance(asked, Solutions)
    assert isinstance(known, Solutions)
    return asked.to_dicts() == known.to_dicts()


@pytest.mark.slow
def test_a_reader_killed_in_the_middle_of_a_commit_loses_none(memory: KnowledgeBase) -> None:
    memory.warm_up()
    _, reader = memory.stats()["readers"]["processes"]
    os.kill(reader, signal.SIGSTOP)  # its socket fills up, so that a commit is sent in part
    for number in range(80):
        with memory.transaction() as tx:
            for at in range(100):
                tx.add(f"urn:burst:{number}", f"urn:at:{at}", "x" * 100)
    time.sleep(0.5)
    os.kill(reader, signal.SIGKILL)
    rows = memory.select("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }", timeout_s=60.0)
    assert rows.to_dicts() == memory.select("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }").to_dicts()


def test_a_reader_that_reads_nothing_is_waited_for_half_of_the_time_of_a_query(
    memory: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory.warm_up()
    _, reader = memory.stats()["readers"]["processes"]
    waits: list[float] = []

    def wait_for(descriptor: int, event: int, timeout_s: float) -> bool:
        waits.append(timeout_s)
        return False  # as if the time had passed

    monkeypatch.setattr("rtask.kb.readers.keeper.wait_for", wait_for)
    os.kill(reader, signal.SIGSTOP)
    for number in range(80):
        with memory.transaction() as tx:
            for at in range(100):
                tx.add(f"urn:burst:{number}", f"urn:at:{at}", "x" * 100)
    rows = memory.select("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }", timeout_s=20.0)
    assert rows.to_dicts() == memory.select("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }").to_dicts()
    # Commits are passed on without any wait, and the query leaves time for another reader.
    assert all(wait <= 10.0 for wait in waits)


def test_a_bulk_load_is_seen(memory: KnowledgeBase) -> None:
    memory.warm_up()
    quads = (
        ox.Quad(ox.NamedNode(f"urn:{n}"), ox.NamedNode("urn:bulk"), ox.Literal(n))
        for n in range(300)
    )
    from rtask.kb.commit.commit import Request

    graph = memory.graphs.imported("bulk")
    named = (ox.Quad(q.subject, q.predicate, q.object, graph) for q in quads)
    memory.bulk_add(named, graph, Request(memory.access()))
    [row] = memory.query("SELECT (COUNT(*) AS ?n) { ?s <urn:bulk> ?o }", timeout_s=30.0)  # type: ignore[misc]
    assert row.value("n") == 300  # type: ignore[union-attr]
