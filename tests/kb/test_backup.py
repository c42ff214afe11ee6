"""Backups open by themselves; verify finds what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

import rtask
from rtask.errors import StoreFormatError, UnsupportedError, UsageError
from rtask.kb.backup import restore
from rtask.kb.knowledge_base import KnowledgeBase


def _open(path: Path) -> KnowledgeBase:
    return rtask.open(path, ontologies=False)


def _filled(path: Path) -> KnowledgeBase:
    kb = _open(path)
    with kb.transaction(agent="nao-1") as tx:
        tx.add("urn:view", "urn:image", tx.blob(b"pixels", "image/png"))
    return kb


def test_a_backup_holds_everything_and_is_apart(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        record = kb.backup(tmp_path / "copy")
        assert record["seq"] == kb.seq == 1
        kb.update("INSERT DATA { <urn:later> <urn:p> 1 }")
        epoch = kb.settings.epoch
        with pytest.raises(UsageError, match="exists"):
            kb.backup(tmp_path / "copy")
    restore(tmp_path / "copy", tmp_path / "again")
    with _open(tmp_path / "again") as kb:
        assert kb.seq == 1
        assert kb.match("urn:later") == []
        [quad] = kb.match("urn:view")
        assert kb.blobs.read(quad.object) == b"pixels"  # type: ignore[arg-type]
        assert kb.settings.epoch != epoch
        assert kb.verify() == []
        assert [entry.seq for entry in kb.history()] == [1]
    with pytest.raises(UsageError, match="not empty"):
        restore(tmp_path / "copy", tmp_path / "again")
    with pytest.raises(StoreFormatError, match="no complete backup"):
        restore(tmp_path / "kb", tmp_path / "other")


def test_memory_has_no_folder_to_back_up(tmp_path: Path) -> None:
    with (
        rtask.open(":memory:", ontologies=False) as kb,
        pytest.raises(UnsupportedError),
    ):
        kb.backup(tmp_path / "copy")


def test_verify_finds_lost_and_changed_bytes(tmp_path: Path) -> None:
    with _filled(tmp_path) as kb:
        kb.blobs.put(b"nobody names me")
        assert [(f.severity, f.part) for f in kb.verify()] == [("note", "blobs")]
        [quad] = kb.match("urn:view")
        path = kb.blobs.path(quad.object)  # type: ignore[arg-type]
        path.write_bytes(b"other")
        assert [f.severity for f in kb.verify()] == ["error", "note"]
        path.unlink()
        assert [f.detail.partition("is named")[1] for f in kb.verify()] == ["is named", ""]


def test_history_tells_who_did_what(tmp_path: Path) -> None:
    with _open(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:mug> <urn:mass> 0.3 }", "nao-1", note="weighed")
        kb.update("INSERT DATA { <urn:cup> <urn:mass> 0.2 }", "nao-2")
        kb.update("DELETE DATA { <urn:mug> <urn:mass> 0.3 }", "nao-1")
        first, last = kb.history("urn:mug")
        assert (first.seq, first.agent, first.note, len(first.added)) == (1, "nao-1", "weighed", 1)
        assert (last.seq, len(last.added), len(last.removed)) == (3, 0, 1)
        assert [e.seq for e in kb.history(agent="nao-2")] == [2]
        assert [e.seq for e in kb.history(graph=kb.graphs.agent("nao-1"), since=1)] == [3]
    with (
        rtask.open(":memory:", ontologies=False) as memory,
        pytest.raises(UnsupportedError, match="no journal"),
    ):
        memory.history()
