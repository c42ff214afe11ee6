"""No sequence of reads tells whether the notes of a commit were stored with it or later."""

from __future__ import annotations

import errno
import random
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pyoxigraph as ox
import pytest

import rtask
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import Checkpoint, replay
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.late_notes import LateNotes
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import iri

_RT = "https://w3id.org/rtask-kg/ns#"
_COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"
_NOTES = f"SELECT ?g ?n {{ ?g <{_RT}commitNumber> ?n }}"


def _open(folder: Path | str, **options: object) -> KnowledgeBase:
    return rtask.open(folder, ontologies=False, **options)


def _early(kb: KnowledgeBase) -> EmbeddedStore:
    """Return a store in which every commit of the journal has its notes at once."""
    store = EmbeddedStore(ox.Store())
    assert kb.folder is not None
    for record in JournalFile(kb.folder / "journal").records():
        replay(store, record, merged=True)
    return store


def _quads(store: EmbeddedStore, graph: ox.NamedNode | None = None) -> set[ox.Quad]:
    return set(store.quads_for_pattern(None, None, None, graph))


def _rows(store: EmbeddedStore, text: str) -> set[str]:
    return set(map(str, store.query(text)))


def _solutions(found: object) -> set[str]:
    return {str(sorted(map(str, row.values()))) for row in found}  # type: ignore[attr-defined]


READS: dict[str, Callable[[KnowledgeBase, EmbeddedStore], bool]] = {
    "everything": lambda kb, early: _quads(kb.store) == _quads(early),
    "meta": lambda kb, early: set(kb.match(graph=kb.graphs.meta)) == _quads(early, kb.graphs.meta),
    "provenance": lambda kb, early: (
        set(kb.match(graph=kb.graphs.provenance)) == _quads(early, kb.graphs.provenance)
    ),
    "numbers": lambda kb, early: (
        set(kb.match(None, _RT + "commitNumber"))
        == set(early.quads_for_pattern(None, iri(_RT + "commitNumber"), None, None))
        - set(early.quads_for_pattern(None, iri(_RT + "commitNumber"), None, ox.DefaultGraph()))
    ),
    "query": lambda kb, early: _rows(kb.store, _NOTES) == _rows(early, _NOTES),
    "count": lambda kb, early: _rows(kb.store, _COUNT) == _rows(early, _COUNT),
    "size": lambda kb, early: len(kb.store) == len(early),
    "graphs": lambda kb, early: set(kb.store.named_graphs()) == set(early.named_graphs()),
    "graph": lambda kb, early: (
        kb.store.contains_named_graph(kb.graphs.meta) == early.contains_named_graph(kb.graphs.meta)
    ),
    "count of a graph": lambda kb, early: (
        kb.store.count(kb.graphs.provenance) == early.count(kb.graphs.provenance)
    ),
    "one": lambda kb, early: all(quad in kb.store for quad in _quads(early, kb.graphs.meta)),
    "another process": lambda kb, early: (
        int(kb.select(_COUNT, timeout_s=60.0)[0].value("n"))  # type: ignore[call-overload]
        == len(list(early.quads_for_pattern(None, None, None, ox.DefaultGraph())))
    ),
    "statistics": lambda kb, early: (
        kb.stats()["graphs"][kb.graphs.provenance.value] == early.count(kb.graphs.provenance)
    ),
    "verify": lambda kb, early: kb.verify(parts=("union", "catalogue")) == [],
    "update": lambda kb, early: _by_update(kb, early),
}


def _by_update(kb: KnowledgeBase, early: EmbeddedStore) -> bool:
    """Let an update read the notes, and a transaction in which something is pending already."""
    expected = len(
        list(early.quads_for_pattern(None, iri(_RT + "tripleCount"), None, kb.graphs.meta))
    )
    where = f"GRAPH <{kb.graphs.meta.value}> {{ ?g <{_RT}tripleCount> ?n }}"
    with kb.transaction() as tx:
        tx.update(f"INSERT {{ ?g <urn:first> ?n }} WHERE {{ {where} }}")
        first = tx.counts()[0]
        tx.update(f"INSERT {{ ?g <urn:second> ?n }} WHERE {{ {where} }}")
        second = tx.counts()[0] - first
        tx.update(
            "DELETE { ?g ?p ?n } WHERE { ?g ?p ?n FILTER(?p IN (<urn:first>, <urn:second>)) }"
        )
    return (first, second) == (expected, expected)


def _commit(kb: KnowledgeBase, rng: random.Random) -> None:
    graph = f"urn:g{rng.randrange(4)}"
    number = rng.randrange(30)
    match rng.randrange(8):
        case 0:
            kb.update(f"DELETE WHERE {{ GRAPH <{graph}> {{ <urn:s{number}> ?p ?o }} }}")
        case 1:
            kb.update(f"DROP SILENT GRAPH <{graph}>")
        case 2:
            kb.update(f"CREATE SILENT GRAPH <urn:empty{number}>", note="a note")
        case 3:  # the words of the notes themselves
            activity = kb.catalogue.activity(max(1, kb.seq - rng.randrange(3))).value
            action = rng.choice(("INSERT", "DELETE"))
            kb.update(
                f"{action} DATA {{ GRAPH <{graph}> {{ <{activity}> a <{_RT}WriteActivity> }} }}"
            )
        case 4:
            kb.update(f"INSERT DATA {{ <urn:s{number}> <urn:p> {number} }}", agent="nao-1")
        case _:
            kb.update(f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:s{number}> <urn:p> {number} }} }}")


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.deep) for seed in (1, 2))]
)
def test_no_sequence_of_reads_tells_late_from_early(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    folder = tmp_path / "kb"
    kb = _open(folder)
    try:
        for step in range(60):
            for _ in range(rng.randrange(1, 4)):
                _commit(kb, rng)
            if rng.random() < 0.5:
                name = rng.choice(list(READS))
                assert READS[name](kb, _early(kb)), (step, name)
            if rng.random() < 0.06:
                if rng.random() < 0.5:
                    kb.close()
                else:  # as after a kill: no checkpoint, and what waits is lost
                    _end_like_a_kill(kb)
                kb = _open(folder)
                assert READS["everything"](kb, _early(kb)), step
    finally:
        kb.close()


def _end_like_a_kill(kb: KnowledgeBase) -> None:
    kb._writer.committer.interrupted = True
    kb.close()


def test_a_burst_stores_its_notes_in_one_step(tmp_path: Path) -> None:
    with _open(tmp_path) as kb:
        steps: list[int] = []
        kb.store.followers.append(lambda writes: steps.append(len(writes.added)))
        kb.update("INSERT DATA { <urn:a> <urn:p> 0 }")
        steps.clear()
        for number in range(1, 11):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        assert steps == [2] * 10  # the statement and its copy in the union
        assert kb.seq == 11
        assert kb.catalogue.revision(kb.graphs.shared) == 11
        assert kb.catalogue.triple_count(kb.graphs.shared) == 11
        assert len(steps) == 10  # all of that was known without a look
        assert len(kb.match(None, _RT + "commitNumber", 11)) == 3
        assert len(steps) == 11


def test_notes_are_stored_after_many_commits_and_after_a_pause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.kb.store.late_notes._MAX_COMMITS", 5)
    with _open(tmp_path) as kb:
        late = kb._writer.committer.late
        assert late is not None
        kb.update("INSERT DATA { <urn:a> <urn:p> 0 }")
        for number in range(1, 6):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        assert not late._is_behind
        kb.update("INSERT DATA { <urn:a> <urn:p> 7 }")
        end = time.monotonic() + 60
        while late._is_behind:
            assert time.monotonic() < end, "nothing was stored in the pause"
            time.sleep(0.02)


def test_backups_snapshots_and_checkpoints_have_the_notes(tmp_path: Path) -> None:
    with _open(tmp_path / "kb") as kb:
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        kb.backup(tmp_path / "backup")
        kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
        kb.update("INSERT DATA { <urn:a> <urn:p> 4 }")
        kb.checkpoint()
        kb.store.raw.backup(str(tmp_path / "copy"))
        assert _numbers(ox.Store.read_only(str(tmp_path / "backup" / "store"))) == {1, 2, 3}
        with kb.as_of(4) as past:
            assert _numbers(past.store.raw) == {1, 2, 3, 4}
    assert _numbers(ox.Store.read_only(str(tmp_path / "copy"))) == {1, 2, 3, 4, 5}


def _numbers(store: ox.Store) -> set[int]:
    found = store.query(f"SELECT ?n {{ ?a a <{_RT}WriteActivity> ; <{_RT}commitNumber> ?n }}")
    return {int(row["n"].value) for row in found}


LOST = f"""
SELECT ?n {{ <urn:counter> <urn:is> ?n
    FILTER NOT EXISTS {{ ?a a <{_RT}WriteActivity> ; <{_RT}commitNumber> ?n }} }}
"""


@pytest.mark.slow
@pytest.mark.parametrize("timeout_s", [None, 60.0], ids=["this process", "another process"])
def test_reads_beside_a_writer_see_each_commit_with_its_notes(
    tmp_path: Path, timeout_s: float | None
) -> None:
    with _open(tmp_path, flush="os", reason=False) as kb:
        stop = threading.Event()

        def write() -> None:
            while not stop.is_set():
                kb.update(
                    f"DELETE DATA {{ <urn:counter> <urn:is> {kb.seq} }} ; "
                    f"INSERT DATA {{ <urn:counter> <urn:is> {kb.seq + 1} }}"
                )
                time.sleep(0.0005)

        writer = threading.Thread(target=write)
        writer.start()
        try:
            while kb.seq < 300:
                assert writer.is_alive()
                assert list(kb.select(LOST, timeout_s=timeout_s)) == []
        finally:
            stop.set()
            writer.join()


def test_reading_goes_on_while_notes_cannot_be_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with _open(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.setattr("rtask.kb.store.late_notes.apply", full)
        assert len(kb.match("urn:a", graph=kb.graphs.shared)) == 2
        assert len(kb.select("SELECT * { <urn:a> ?p ?o }")) == 2
        monkeypatch.undo()
        assert READS["everything"](kb, _early(kb))
        kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
        assert kb.verify() == []


def test_statements_of_a_commit_that_the_journal_lost_are_counted_and_closed(
    tmp_path: Path,
) -> None:
    """After a machine stops, the store may be ahead of the journal, by a commit without notes."""
    mug, thing = iri("urn:Mug"), iri("urn:Thing")
    kind = iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
    with _open(tmp_path) as kb:
        kb.update(
            "INSERT DATA { <urn:Mug> <http://www.w3.org/2000/01/rdf-schema#subClassOf> "
            "<urn:Thing> }"
        )
        shared = kb.graphs.shared
    ahead = ox.Store(str(tmp_path / "store"))
    for graph in (shared, ox.DefaultGraph()):
        ahead.add(ox.Quad(iri("urn:m"), kind, mug, graph))
    ahead.flush()
    del ahead
    Checkpoint(1, clean=False, boot="before it stopped").save(tmp_path)
    with _open(tmp_path) as kb:
        assert kb.catalogue.triple_count(shared) == 2
        assert [quad.object for quad in kb.match("urn:m", graph=kb.graphs.inferred)] == [thing]
        assert kb.verify() == []


def test_a_store_in_memory_has_late_notes_too() -> None:
    with _open(":memory:") as kb:
        assert isinstance(kb.store.gate, LateNotes)
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        assert _numbers(kb.store.raw) == {1}
        assert len(kb.select(_NOTES)) == 6
        assert _numbers(kb.store.raw) == {1, 2, 3}
