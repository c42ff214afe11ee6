"""Queries in processes of their own: ended at their deadline, isolated, never stale."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import (
    BusyError,
    ClosedError,
    DataError,
    ForbiddenError,
    QuerySyntaxError,
    QueryTimeout,
    QueryTooExpensive,
    TooLargeError,
    UsageError,
)
from rtask.kb.readers.pool import ReaderLimits
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.results import Solutions, Triples

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="readers are forked")

_ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
_COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
_JSON = "application/sparql-results+json"
_PAIRS = "SELECT * { ?s ?p ?o . ?a ?b ?c }"


def _is_alive(pid: int) -> bool:
    """Whether a process is there, a zombie included."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def _wait_until(condition: Callable[[], bool], within_s: float = 20.0) -> None:
    end = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def _fill(kb: KnowledgeBase, count: int = 2_000) -> None:
    with kb.transaction() as tx:
        for number in range(count):
            tx.add(f"urn:thing:{number}", "urn:number", number)


@pytest.fixture(params=["memory", "folder", "snapshot"])
def kb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KnowledgeBase]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with rtask.open(target, reason=False, ontologies=False, flush="os") as opened:
        if request.param == "snapshot":
            opened.readers.limits = ReaderLimits(replica_max=0)
        _fill(opened)
        yield opened


@pytest.fixture
def memory() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", reason=False, ontologies=False) as opened:
        _fill(opened)
        yield opened


@pytest.mark.slow
def test_a_query_is_ended_at_its_deadline_and_the_next_one_works(kb: KnowledgeBase) -> None:
    kb.warm_up()
    started = time.monotonic()
    with pytest.raises(QueryTimeout, match="within 1 s"):
        kb.query(_ENDLESS, timeout_s=1.0)
    # the margin is for a machine under load; without a kill it takes hours
    assert 1.0 <= time.monotonic() - started < 10.0
    readers = kb.stats()["readers"]
    assert readers["running"] == 0
    assert readers["killed"] == 1
    assert kb.query("ASK { <urn:thing:1> <urn:number> 1 }", timeout_s=30.0) is True


def test_a_killed_reader_leaves_no_process_and_no_zombie(memory: KnowledgeBase) -> None:
    memory.warm_up()
    keeper, reader = memory.stats()["readers"]["processes"]
    with pytest.raises(QueryTimeout):
        memory.query(_ENDLESS, timeout_s=0.2)
    _wait_until(lambda: not _is_alive(reader))
    assert _is_alive(keeper)


def _read_all(kb: KnowledgeBase, seen: set[int]) -> None:
    with kb.stream(_PAIRS, timeout_s=0.2) as stream:
        for _ in stream:
            seen.update(kb.stats()["readers"]["processes"])


@pytest.mark.slow
def test_thirty_deadlines_in_a_row_leave_nothing(tmp_path: Path) -> None:
    seen: set[int] = set()
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        kb.readers.limits = ReaderLimits(replica_max=0)
        _fill(kb)
        for number in range(30):
            with pytest.raises(QueryTimeout):
                _read_all(kb, seen)
            with kb.transaction() as tx:
                tx.add("urn:a", "urn:b", number)
        # under load the time may be over before there is a reader to kill
        assert kb.stats()["readers"]["killed"] >= 1
        assert len(list((tmp_path / "kb" / "snapshots").iterdir())) <= 1
    assert not (tmp_path / "kb" / "snapshots").exists()
    _wait_until(lambda: not any(map(_is_alive, seen)))


def test_closing_ends_every_process_and_every_query(memory: KnowledgeBase) -> None:
    memory.warm_up()
    stream = memory.stream(_PAIRS)
    next(stream)
    processes = memory.stats()["readers"]["processes"]
    assert len(processes) == 2
    memory.close()
    _wait_until(lambda: not any(map(_is_alive, processes)))
    with pytest.raises(ClosedError):
        list(stream)
    with pytest.raises(ClosedError):
        memory.query(_COUNT, timeout_s=1.0)


def test_readers_do_not_outlive_a_killed_owner() -> None:
    script = str(Path(__file__).with_name("reader_owner.py"))
    owner = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE)
    assert owner.stdout is not None
    with owner.stdout:
        processes = list(map(int, owner.stdout.readline().split()))
        assert len(processes) >= 2
        owner.send_signal(signal.SIGKILL)
        owner.wait()
    _wait_until(lambda: not any(map(_is_running, processes)))


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


@pytest.mark.parametrize(
    "text",
    [
        "SELECT ?s ?o { ?s <urn:number> ?o } ORDER BY ?o LIMIT 50",
        "SELECT ?o ?never { VALUES ?o { <urn:a> 'x'@de 1.50 true <<( <urn:a> <urn:b> 1 )>> } }",
        "ASK { ?s ?p ?o }",
        "CONSTRUCT { ?s <urn:p> ?o } WHERE { ?s <urn:number> ?o FILTER(?o < 9) }",
        "DESCRIBE <urn:thing:1>",
        "SELECT * { ?s ?p 'nothing' }",
    ],
)
def test_both_ways_give_the_same_answer(memory: KnowledgeBase, text: str) -> None:
    here, there = memory.query(text), memory.query(text, timeout_s=30.0)
    assert type(here) is type(there)
    if isinstance(here, Solutions) and isinstance(there, Solutions):
        assert there.variables == here.variables
        assert [tuple(row) for row in there] == [tuple(row) for row in here]
    elif isinstance(here, Triples) and isinstance(there, Triples):
        assert set(there) == set(here)
    else:
        assert here == there


def test_datasets_and_bases_reach_the_reader(memory: KnowledgeBase) -> None:
    memory.update("INSERT DATA { GRAPH <urn:g> { <urn:only> <urn:here> 1 } }")
    options = {"default_graphs": ["urn:g"], "timeout_s": 30.0}
    assert len(memory.select("SELECT * { ?s ?p ?o }", **options)) == 1
    assert memory.query("ASK { <only> <here> 1 }", base="urn:", timeout_s=30.0) is True
    assert len(memory.select("SELECT * FROM <urn:g> { ?s ?p ?o }", timeout_s=30.0)) == 1


def test_an_answer_comes_in_pieces_that_grow(memory: KnowledgeBase) -> None:
    with memory.stream(_PAIRS + " LIMIT 20000", _JSON) as stream:
        pieces = list(stream)
    sizes = [len(piece) for piece in pieces]
    assert sizes[0] <= 16 << 10
    assert max(sizes) >= 256 << 10
    assert stream.kind == "rows"
    assert len(json.loads(b"".join(pieces))["results"]["bindings"]) == 20_000


def test_a_packed_answer_says_so_and_a_small_one_is_not_packed(memory: KnowledgeBase) -> None:
    text = "SELECT * { ?s ?p ?o }"
    packed = memory.stream(text, _JSON, gzip=True)
    data = packed.read()
    assert packed.gzip
    plain = zlib.decompress(data, 31)
    assert len(data) < len(plain)
    assert len(json.loads(plain)["results"]["bindings"]) >= 2_000
    small = memory.stream("ASK { ?s ?p ?o }", _JSON, gzip=True)
    assert json.loads(small.read())["boolean"] is True
    assert not small.gzip


def test_a_client_that_stops_reading_stops_the_reader(memory: KnowledgeBase) -> None:
    stream = memory.stream(_PAIRS)
    next(stream)
    reader = memory.stats()["readers"]["processes"][-1]

    def written() -> int:
        lines = Path(f"/proc/{reader}/io").read_text("ascii").splitlines()
        return int(dict(line.split(": ") for line in lines)["wchar"])

    with contextlib.suppress(PermissionError):
        _wait_until(lambda: written() == (time.sleep(0.3), written())[1])
        assert written() < 8 << 20  # a pipe of 1 MiB and a few pieces; the answer has 600 MB
    started = time.monotonic()
    stream.close()
    _wait_until(lambda: not _is_alive(reader))
    assert time.monotonic() - started < 10.0
    assert memory.query("ASK {}", timeout_s=30.0) is True


def test_a_stream_is_closed_from_another_thread(memory: KnowledgeBase) -> None:
    memory.warm_up()
    seen: list[BaseException] = []
    streams = []

    def read() -> None:
        try:
            streams.append(memory.stream(_PAIRS))
            for _ in streams[0]:
                pass
        except ClosedError as error:
            seen.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    _wait_until(lambda: bool(streams))
    streams[0].close()
    thread.join(timeout=20.0)
    assert len(seen) == 1


def test_a_forgotten_stream_gives_its_place_back(memory: KnowledgeBase) -> None:
    memory.readers.limits = ReaderLimits(count=1, queue=0)
    stream = memory.stream(_PAIRS)
    next(stream)
    with pytest.raises(BusyError, match="too many queries are waiting"):
        memory.query("ASK {}", timeout_s=5.0)
    del stream
    assert memory.query("ASK {}", timeout_s=30.0) is True


def test_waiting_for_a_reader_counts(memory: KnowledgeBase) -> None:
    memory.readers.limits = ReaderLimits(count=1)
    with memory.stream(_PAIRS) as stream:
        next(stream)
        with pytest.raises(QueryTimeout, match="spent waiting for a reader"):
            memory.query("ASK {}", timeout_s=0.2)


@pytest.mark.slow
def test_a_deadline_can_be_moved_while_an_answer_is_read(memory: KnowledgeBase) -> None:
    memory.readers.start()
    with memory.stream(_PAIRS, timeout_s=1.0) as stream:
        next(stream)
        assert stream.extend(60.0)
        time.sleep(1.2)
        for _ in range(20):
            next(stream)
        assert stream.extend(0.1)
        with pytest.raises(QueryTimeout, match=r"0\.1 s"):
            stream.read()
        assert not stream.extend(60.0)


def test_short_queries_do_not_wait_behind_long_ones(memory: KnowledgeBase) -> None:
    memory.readers.limits = ReaderLimits(count=3, reserved=2)
    with memory.stream(_PAIRS) as stream:
        next(stream)
        with pytest.raises(QueryTimeout, match="spent waiting for a reader"):
            memory.query(_COUNT, timeout_s=0.2)
        assert memory.query("ASK { <urn:thing:1> <urn:number> 1 }", timeout_s=30.0) is True


def test_a_folder_is_read_from_a_snapshot_while_its_replica_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.kb.readers.pool._SMALL", -1)
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        _fill(kb)
        for number in range(5):
            kb.update(f"INSERT DATA {{ <urn:last> <urn:is> {number} }}")
            asked = f"ASK {{ <urn:last> <urn:is> {number} }}"
            assert kb.query(asked, timeout_s=30.0) is True
        kb.readers.start()
        assert kb.readers.stats()["kind"] == "replica"
        kb.update("INSERT DATA { <urn:last> <urn:is> 9 }")
        assert kb.query("ASK { <urn:last> <urn:is> 9 }", timeout_s=30.0) is True


def test_memory_is_limited_and_the_text_is_remembered(memory: KnowledgeBase) -> None:
    memory.readers.limits = ReaderLimits(memory_bytes=64 << 20)
    greedy = "SELECT * { ?a ?b ?c . ?d ?e ?f } ORDER BY ?f ?e LIMIT 3000000"
    with pytest.raises(QueryTooExpensive, match="memory"):
        memory.query(greedy, timeout_s=120.0)
    before = memory.readers.stats()
    with pytest.raises(QueryTooExpensive, match="refused"):
        memory.query(greedy, timeout_s=120.0)
    after = memory.readers.stats()
    assert after["killed"] == before["killed"]  # no reader tried it a second time
    assert after["answered"] == before["answered"]
    assert memory.query("ASK {}", timeout_s=30.0) is True


def test_rows_and_bytes_are_limited(memory: KnowledgeBase) -> None:
    assert len(memory.stream("SELECT * { ?s <urn:number> ?o } LIMIT 10", max_rows=10).read()) > 0
    for form in (_JSON, "application/sparql-results+xml", "text/csv", "text/tab-separated-values"):
        with pytest.raises(TooLargeError, match="rows") as caught:
            memory.stream("SELECT * { ?s <urn:number> ?o } LIMIT 11", form, max_rows=10)
        assert caught.value.details["allowed"] == 10
    stream = memory.stream(_PAIRS, max_bytes=100_000)  # the first piece is sent by then
    with pytest.raises(TooLargeError, match="bytes"):
        stream.read()
    assert memory.query("ASK {}", timeout_s=30.0) is True


@pytest.mark.parametrize(
    ("text", "form", "error", "message"),
    [
        ("SELECT * {\n ?x", None, QuerySyntaxError, "2:"),
        ("SELECT (<urn:f>(1) AS ?x) {}", None, DataError, "urn:f"),
        ("SELECT * { SERVICE <urn:x> {} }", None, ForbiddenError, "SERVICE"),
        ("CONSTRUCT WHERE { ?s ?p ?o }", "text/csv", UsageError, "cannot represent triples"),
        ("SELECT * { ?s ?p ?o }", "image/png", UsageError, "cannot represent rows"),
        ("ASK " + "{" * 10_000, None, TooLargeError, "nesting"),
    ],
)
def test_errors_come_before_the_first_piece(
    memory: KnowledgeBase, text: str, form: str | None, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        memory.stream(text, form, timeout_s=30.0)
    assert memory.query("ASK {}", timeout_s=30.0) is True


def test_readers_do_not_share_chance(memory: KnowledgeBase) -> None:
    text = "SELECT (RAND() AS ?r) (STRUUID() AS ?u) {}"
    with memory.stream(text) as one, memory.stream(text) as two:
        assert one.read() != two.read()


@pytest.mark.slow
def test_a_folder_open_for_reading_is_read_by_readers(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        _fill(kb)
    with rtask.open(tmp_path / "kb", mode="r") as kb:
        kb.readers.limits = ReaderLimits(replica_max=0)
        [row] = kb.query("SELECT (COUNT(*) AS ?n) { ?s <urn:number> ?o }", timeout_s=30.0)  # type: ignore[misc]
        assert row.value("n") == 2_000  # type: ignore[union-attr]
        assert kb.stats()["readers"]["kind"] == "snapshot"
    with rtask.open(tmp_path / "kb") as kb:
        assert len(kb.match(predicate="urn:number")) == 2_000


def test_where_no_process_can_be_started_queries_run_here(
    memory: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory.readers, "_possible", False)
    assert memory.query("ASK { ?s ?p ?o }", timeout_s=1.0) is True
    assert memory.stream("SELECT * { ?s ?p ?o } LIMIT 1").read().startswith(b"{")
    assert memory.stats()["readers"]["processes"] == []
