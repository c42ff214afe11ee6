"""Answers of reader processes: the same as in this process, in pieces, within limits."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import select
import threading
import time
import zlib
from pathlib import Path

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
from rtask.kb.readers.keeper import wait_for
from rtask.kb.readers.pool import Readers
from rtask.kb.readers.request import ReaderLimits
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.results import Solutions, Triples
from tests.processes import is_alive, wait_until
from tests.rtask.kb.numbered_things import fill

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="readers are forked")

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
_JSON = "application/sparql-results+json"
_PAIRS = "SELECT * { ?s ?p ?o . ?a ?b ?c }"


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
        wait_until(lambda: written() == (time.sleep(0.3), written())[1])
        assert written() < 8 << 20  # a pipe of 1 MiB and a few pieces; the answer has 600 MB
    stream.close()
    wait_until(lambda: not is_alive(reader))
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
    wait_until(lambda: bool(streams))
    streams[0].close()
    thread.join(timeout=60.0)
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
    with memory.stream(_PAIRS, timeout_s=60.0) as stream, memory.stream(_PAIRS) as later:
        next(stream)
        next(later)
        assert stream.extend(3.0)  # no less: it is moved again before the end
        assert later.extend(3.0)
        assert stream.extend(60.0)
        with pytest.raises(QueryTimeout):  # its limit is behind the one that was moved
            later.read()
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
    monkeypatch.setattr("rtask.kb.readers.supply._SMALL", -1)
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        fill(kb)
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
        ("SELECT * {\n ?x .", None, QuerySyntaxError, "1:10: this '{' is never closed"),
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
        fill(kb)
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
    monkeypatch.setattr(Readers, "possible", False)
    assert memory.query("ASK { ?s ?p ?o }", timeout_s=30.0) is True
    assert memory.stream("SELECT * { ?s ?p ?o } LIMIT 1").read().startswith(b"{")
    assert memory.stats()["readers"]["processes"] == []


def _now(kb: KnowledgeBase, text: str) -> bytes | None:
    """Return an answer that is asked for without waiting, as an event loop would."""
    payload = kb.encode_query(text, _JSON)
    assert payload is not None
    line = kb.readers.open_line()
    if line is None:
        return None
    try:
        if not kb.readers.send(line, payload, text):
            return None
        while (answer := line.take()) is None:
            line.receive()
        return answer.body
    finally:
        line.close(is_reusable=True)


def test_what_is_asked_without_waiting_sees_every_commit_with_its_notes(tmp_path: Path) -> None:
    notes = "SELECT ?a { ?a <http://www.w3.org/ns/prov#wasAssociatedWith> ?who }"
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False, flush="os") as kb:
        kb.warm_up()
        asked = 0
        for number in range(20):
            for part in range(3):  # the second one after a read leaves its notes waiting
                statement = f"<urn:last:{number}> <urn:is> {part}"
                kb.update(f"INSERT DATA {{ {statement} }}", agent="nao-1")
            value = f"SELECT ?o {{ <urn:last:{number}> <urn:is> ?o }}"
            for text, expected in ((notes, 3 * (number + 1)), (value, 3)):
                found = _now(kb, text)
                if found is None:  # the notes wait: a thread stores them, and asks
                    found = kb.serialize(text, _JSON)
                    assert _now(kb, text) is not None
                asked += 1
                assert len(json.loads(found)["results"]["bindings"]) == expected
        assert asked == 40


def test_a_pipe_is_waited_for_whatever_its_number() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 2_000:
        pytest.skip("this machine allows too few open files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2_000), hard))
    reading, writing = os.pipe()
    high = fcntl.fcntl(reading, fcntl.F_DUPFD_CLOEXEC, 1_500)
    try:
        assert not wait_for(high, select.POLLIN, 0.0)
        os.write(writing, b"x")
        assert wait_for(high, select.POLLIN)
    finally:
        for descriptor in (reading, writing, high):
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
