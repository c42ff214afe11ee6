"""Records of one knowledge base applied to another, many in one step."""

from __future__ import annotations

from pathlib import Path

import pytest

import rtask
from rtask.errors import ForbiddenError, StoreError
from rtask.kb.durability.journal import JournalFile
from rtask.kb.maintenance import replica
from rtask.knowledge_base import KnowledgeBase


def _open(folder: Path) -> KnowledgeBase:
    return rtask.open(folder, base="urn:lab/", ontologies=False, reason=False)


def test_a_batch_that_begins_with_new_graphs_leaves_the_same_store(tmp_path: Path) -> None:
    with _open(tmp_path / "writer") as kb:
        for number in range(6):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}", f"nao-{number % 2}")
        kb.update("DELETE DATA { <urn:a> <urn:p> 0 }", "nao-0")
        kb.update("INSERT DATA { GRAPH <urn:g> { <urn:b> <urn:p> [] } }")
        kb.update("DROP GRAPH <urn:g>")
        theirs = set(map(str, kb.store.quads_for_pattern(None, None, None)))
    records = list(JournalFile(tmp_path / "writer" / "journal").records())
    heard: list[int] = []
    with _open(tmp_path / "copy") as kb:
        kb.follow("http://writer")
        kb.on_commit(lambda change: heard.append(change.commit.seq))
        with pytest.raises(StoreError, match="commit 1 is missing"):
            kb.apply_records(records[3:])
        kb.apply_records(records[:4])
        kb.apply_records(records[4:])
        assert heard == list(range(1, 10)) == [record.seq for record in records]
        assert set(map(str, kb.store.quads_for_pattern(None, None, None))) == theirs
        with pytest.raises(ForbiddenError, match="follows http://writer"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 9 }")
    with _open(tmp_path / "copy") as kb:
        assert (kb.seq, kb.verify()) == (9, [])
        assert [entry.seq for entry in kb.history("urn:a")] == [1, 2, 3, 4, 5, 6, 7]


def test_records_are_journalled_once_when_storing_them_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _open(tmp_path / "writer") as kb:
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
    records = list(JournalFile(tmp_path / "writer" / "journal").records())

    def fail(*_: object) -> int:
        raise RuntimeError("no room")

    with _open(tmp_path / "copy") as kb:
        kb.follow("http://writer")
        with monkeypatch.context() as patch:
            patch.setattr(replica, "replay_all", fail)
            with pytest.raises(RuntimeError, match="no room"):
                kb.apply_records(records)
        kb.apply_records(records)
        assert len(kb.match("urn:a")) == 3
    kept = JournalFile(tmp_path / "copy" / "journal").records()
    assert [record.seq for record in kept] == [1, 2, 3]


def test_a_journal_that_was_pruned_gives_a_reader_nothing(tmp_path: Path) -> None:
    with _open(tmp_path / "writer") as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        tail = kb.journal_tail(0)
        [segment] = (tmp_path / "writer" / "journal").glob("*.log")
        segment.rename(segment.with_name(f"{5:016d}.log"))
        assert tail.read(1) == b""
        assert tail.after == 0
