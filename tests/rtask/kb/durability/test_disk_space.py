"""A full disk: errors give place and room, and a reserve lets the folder be closed properly."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path

import pytest

import rtask
from rtask.errors import StorageFullError
from rtask.kb.durability import disk_space, folder, recovery
from rtask.kb.maintenance import backup as backup_module
from rtask.knowledge_base import KnowledgeBase


def opened(path: Path, mode: str = "rw") -> KnowledgeBase:
    found = rtask.open(path, mode=mode, ontologies=False, reason=False)
    assert isinstance(found, KnowledgeBase)
    return found


def full(*_: object, **__: object) -> None:
    # As the store's own errors: a text without a number.
    raise OSError("IO error: No space left on device: While appending to file")


def test_a_folder_on_a_full_disk_says_where_and_how_much_and_opens_for_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    monkeypatch.setattr(folder, "EmbeddedStore", full)
    with pytest.raises(StorageFullError, match=r"MB are free at .*mode='r'") as error:
        opened(tmp_path)
    assert error.value.details["path"] == str(tmp_path)
    assert error.value.details["free"] > 0
    monkeypatch.undo()
    with opened(tmp_path, "r") as kb:
        assert len(kb.match("urn:a")) == 1


def test_a_backup_that_finds_no_room_leaves_nothing_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(tmp_path / "kb") as kb:
        monkeypatch.setattr(backup_module, "_copy_journal", full)
        with pytest.raises(StorageFullError, match="for the backup") as error:
            kb.backup(tmp_path / "copy")
        assert (error.value.status, (tmp_path / "copy").exists()) == (507, False)
        monkeypatch.undo()
        assert kb.backup(tmp_path / "copy")["seq"] == 0


def test_the_reserve_lets_a_folder_be_closed_properly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = opened(tmp_path)
    reserve = tmp_path / "reserve"
    assert reserve.stat().st_size == disk_space.RESERVE_BYTES
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    real: Callable[..., None] = recovery.Checkpoint.save

    def save(self: recovery.Checkpoint, target: Path) -> None:
        if reserve.exists():
            raise OSError(errno.ENOSPC, "No space left on device")
        real(self, target)

    monkeypatch.setattr(recovery.Checkpoint, "save", save)
    kb.close()
    assert not reserve.exists()
    opened(tmp_path, "r").close()  # closed properly


def test_a_disk_without_room_to_spare_has_no_reserve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = type("Usage", (), {"free": disk_space.RESERVE_BYTES})
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: usage)
    with opened(tmp_path) as kb:
        assert not (tmp_path / "reserve").exists()
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 1 }").seq == 1
