"""Backups open by themselves; verify finds what is wrong."""

from __future__ import annotations

import functools
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

import rtask
from rtask.errors import StoreFormatError, UnsupportedError, UsageError
from rtask.kb.durability.lock import FolderLock
from rtask.kb.durability.settings import Settings
from rtask.kb.maintenance import backup as backup_module
from rtask.kb.maintenance.backup import discard_unfinished, restore
from rtask.knowledge_base import KnowledgeBase


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
    with pytest.raises(StoreFormatError, match="not a complete backup"):
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


def test_a_restored_copy_knows_where_it_comes_from(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        record = kb.backup(tmp_path / "copy")
        parent = f"{kb.settings.store_id}@1"
    assert record["quads"] > 5
    restore(tmp_path / "copy", tmp_path / "again")
    with _open(tmp_path / "again") as kb:
        assert kb.settings.parent == parent


def test_a_damaged_backup_is_not_restored(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        kb.backup(tmp_path / "copy")
    [blob] = (tmp_path / "copy" / "blobs").glob("??/??/*")
    blob.unlink()  # the copy shares its bytes with the original
    blob.write_bytes(b"other")
    with pytest.raises(StoreFormatError, match="differs from its digest"):
        restore(tmp_path / "copy", tmp_path / "again")
    blob.write_bytes(b"pixels")
    [segment] = (tmp_path / "copy" / "journal").glob("*.log")
    segment.write_bytes(segment.read_bytes()[:-5])
    with pytest.raises(StoreFormatError, match="journal ends"):
        restore(tmp_path / "copy", tmp_path / "again")
    assert not (tmp_path / "again").exists()


def test_an_interrupted_backup_is_named_so(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        kb.backup(tmp_path / "copy")
        (tmp_path / "copy" / "backup.json").unlink()
        with pytest.raises(UsageError, match="was interrupted"):
            kb.backup(tmp_path / "copy")
        (tmp_path / "copy" / "kb.json").unlink()
        with pytest.raises(UsageError, match="is a backup that was interrupted"):
            kb.backup(tmp_path / "copy")


def _kill(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize(
    "moment", ["_copy_journal", "copy_blob", "seal", "_count", "write_durably", "_sync_tree"]
)
def test_nothing_of_a_killed_backup_stands_under_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    _filled(tmp_path / "kb").close()
    with monkeypatch.context() as patched:
        patched.setattr(backup_module, moment, _kill)
        assert _killed(lambda: _open(tmp_path / "kb").backup(tmp_path / "copy"))
    assert [path.name for path in tmp_path.glob("copy*")] == ["copy.partial"]
    with pytest.raises(StoreFormatError):
        restore(tmp_path / "copy", tmp_path / "again")
    (tmp_path / "copy.partial" / "rest").write_text("of the killed one")
    with _open(tmp_path / "kb") as kb:
        kb.backup(tmp_path / "copy")
    assert [path.name for path in tmp_path.glob("copy*")] == ["copy"]
    assert not (tmp_path / "copy" / "rest").exists()
    restore(tmp_path / "copy", tmp_path / "again")
    with _open(tmp_path / "again") as kb:
        [quad] = kb.match("urn:view")
        assert kb.blobs.read(quad.object) == b"pixels"  # type: ignore[arg-type]
        assert kb.verify() == []


def test_what_killed_backups_left_is_removed_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _filled(tmp_path / "kb").close()
    backups = tmp_path / "backups"
    with monkeypatch.context() as patched:
        patched.setattr(backup_module, "seal", _kill)
        assert _killed(lambda: _open(tmp_path / "kb").backup(backups / "killed"))
    (backups / "running.partial").mkdir()
    running = FolderLock(backups / "running.partial")
    (backups / "somebodys.partial").mkdir()
    assert discard_unfinished(backups) == 1
    assert {path.name for path in backups.iterdir()} == {"running.partial", "somebodys.partial"}
    running.release()


def test_two_backups_of_one_name_at_a_time_are_refused(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        (tmp_path / "copy.partial").mkdir()
        other = FolderLock(tmp_path / "copy.partial")
        with pytest.raises(UsageError, match="another process makes the backup"):
            kb.backup(tmp_path / "copy")
        other.release()
        kb.backup(tmp_path / "copy")
        assert not (tmp_path / "copy.partial").exists()


@pytest.mark.parametrize("copied", [1, 6, None], ids=["one", "six", "all but the settings"])
def test_what_a_killed_restoring_leaves_is_no_knowledge_base(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, copied: int | None
) -> None:
    with _filled(tmp_path / "kb") as kb:
        kb.backup(tmp_path / "backup")
    done: list[str] = []

    def copy(source: str, target: str) -> None:
        if len(done) == copied:
            raise KeyboardInterrupt  # nothing is cleaned up after it, as after a kill
        done.append(shutil.copy2(source, target))

    def kill(*_: object) -> None:
        raise KeyboardInterrupt

    copytree = functools.partial(shutil.copytree, copy_function=copy)
    tools = SimpleNamespace(copytree=copytree, ignore_patterns=shutil.ignore_patterns)
    monkeypatch.setattr(backup_module, "shutil", tools)
    monkeypatch.setattr(Settings, "save", kill)
    with pytest.raises(KeyboardInterrupt):
        restore(tmp_path / "backup", tmp_path / "again")
    monkeypatch.undo()
    with pytest.raises(StoreFormatError, match="not a knowledge base"):
        _open(tmp_path / "again")
    with pytest.raises(UsageError, match="not empty"):
        restore(tmp_path / "backup", tmp_path / "again")
    restore(tmp_path / "backup", tmp_path / "whole")
    with _open(tmp_path / "whole") as kb:
        assert kb.verify() == []


def test_the_target_of_a_backup_may_be_a_knowledge_base_which_is_said(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        with pytest.raises(UsageError, match="kb exists and is a knowledge base"):
            kb.backup(tmp_path / "kb")
        kb.backup(tmp_path / "copy")
        with pytest.raises(UsageError, match="copy exists and is a backup;"):
            kb.backup(tmp_path / "copy")


@pytest.mark.slow
def test_a_backup_is_made_while_others_write(tmp_path: Path) -> None:
    with _filled(tmp_path / "kb") as kb:
        stop = threading.Event()

        def write() -> None:
            number = 0
            while not stop.is_set():
                number += 1
                kb.update(f"INSERT DATA {{ <urn:n{number}> <urn:p> {number} }}", "nao-1")

        writer = threading.Thread(target=write)
        writer.start()
        try:
            seqs = [kb.backup(tmp_path / f"copy{n}")["seq"] for n in range(3)]
        finally:
            stop.set()
            writer.join()
    assert seqs == sorted(seqs)
    for number, seq in enumerate(seqs):
        restore(tmp_path / f"copy{number}", tmp_path / f"again{number}")
        with _open(tmp_path / f"again{number}") as kb:
            assert kb.seq == seq
            assert len(kb.match(predicate="urn:p")) == seq - 1
            assert [f for f in kb.verify() if f.severity == "error"] == []


def test_bytes_that_nobody_names_are_collected_once_they_are_old(tmp_path: Path) -> None:
    with _filled(tmp_path) as kb:
        blob = kb.blobs.put(b"nobody names me")
        assert kb.collect_blobs() == 0
        os.utime(kb.blobs.path(blob.iri), (0, 0))
        assert kb.collect_blobs() == 1
        assert kb.verify() == []
        [quad] = kb.match("urn:view")
        assert kb.blobs.has(quad.object)  # type: ignore[arg-type]


def test_what_is_derived_is_repaired_from_the_graph(tmp_path: Path) -> None:
    with _filled(tmp_path) as kb:
        kb.update(
            "PREFIX s: <http://www.w3.org/2000/01/rdf-schema#> "
            "INSERT DATA { <urn:Mug> s:subClassOf <urn:Cup> . <urn:a> a <urn:Mug> }"
        )
        everything = set(map(str, kb.store.raw))
        for damage in (
            "DELETE WHERE { <urn:a> ?p ?o }",
            "INSERT DATA { <urn:x> <urn:y> <urn:z> }",
            f"DELETE WHERE {{ GRAPH {kb.graphs.inferred} {{ ?s ?p ?o }} }}",
        ):
            kb.store.raw.update(damage)
        assert {f.part for f in kb.verify()} >= {"union", "catalogue", "closure"}
        kb.verify(repair=True)
        assert kb.verify() == []
        facts = {line for line in everything if "/activity/" not in line}
        missing = facts - set(map(str, kb.store.raw))
        assert all("commitNumber" in line or "tripleCount" in line for line in missing)


def _killed(work: Callable[[], object], step: int = -1) -> bool:
    """Run work in a child that is killed, at its n-th step in the file system if one is given.

    False once it is whole.
    """
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    left = step

    def count(event: str, args: tuple[object, ...]) -> None:
        nonlocal left
        writes = event == "open" and args[1] not in ("r", "rb")
        left -= writes or event in ("os.mkdir", "os.rename", "os.link", "shutil.copyfile")
        if left == 0:
            left = -1  # the kill is an event as well
            os.kill(os.getpid(), signal.SIGKILL)

    code = 1
    try:
        sys.addaudithook(count)
        work()
        code = 0
    finally:
        os._exit(code)


@pytest.mark.deep
def test_backups_and_restores_killed_at_any_step_are_whole_or_refused(tmp_path: Path) -> None:
    original, copy, again = (tmp_path / name for name in ("kb", "copy", "again"))
    _filled(original).close()

    step = 1
    while _killed(lambda: _open(original).backup(copy), step):
        if copy.exists():
            assert restore(copy, again)["seq"] == 1
            shutil.rmtree(again)
            shutil.rmtree(copy)
        step += 1
    assert step > 15
    step = 1
    while _killed(lambda: restore(copy, again), step):
        if (again / "kb.json").exists():  # without it, nothing takes what is there for whole
            break
        shutil.rmtree(again, ignore_errors=True)
        step += 1
    assert step > 15
    with _open(again) as kb:
        assert (kb.seq, kb.verify()) == (1, [])
