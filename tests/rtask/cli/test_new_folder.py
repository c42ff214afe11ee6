"""A folder is as before after a command that failed, whatever was in it or above it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.cli.changing import new_folder
from rtask.cli.changing.new_folder import NewFolder, open_or_make
from rtask.kb.durability.lock import FolderLock


class _FailedError(Exception):
    """What ends a command."""


def _fail_in(folder: Path, update: str = "", *, stores: bool = True) -> None:
    """Run a command that stores what it is given and then fails."""
    with open_or_make(folder, stores=stores, ontologies=False, reason=False) as kb:
        assert folder.is_dir()
        if update:
            kb.update(update)
        raise _FailedError


def _fill(folder: Path) -> None:
    """Write files and a folder, as a store does."""
    (folder / "store").mkdir(parents=True)
    (folder / "store" / "1.sst").write_text("x")
    (folder / "settings").write_text("x")


def test_a_new_folder_goes_with_the_parents_made_for_it(tmp_path: Path) -> None:
    folder = tmp_path / "stays" / "a" / "b"
    (tmp_path / "stays").mkdir()
    with NewFolder(folder):
        _fill(folder)
    assert list(tmp_path.rglob("*")) == [tmp_path / "stays"]


def test_a_parent_into_which_others_wrote_stays(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    with NewFolder(folder):
        _fill(folder)
        (tmp_path / "a" / "of_others").write_text("x")
    assert list(tmp_path.rglob("*")) == [tmp_path / "a", tmp_path / "a" / "of_others"]


def test_an_empty_folder_that_was_there_is_emptied_and_stays(tmp_path: Path) -> None:
    folder = tmp_path / "empty"
    folder.mkdir()
    with NewFolder(folder):
        _fill(folder)
    assert list(tmp_path.rglob("*")) == [folder]


def test_a_folder_in_use_before_loses_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("x")
    with NewFolder(tmp_path):
        _fill(tmp_path)
    assert len(list(tmp_path.rglob("*"))) == 4


def test_a_folder_that_is_kept_stays(tmp_path: Path) -> None:
    with NewFolder(tmp_path / "a") as new:
        _fill(tmp_path / "a")
        new.keep()
    assert (tmp_path / "a" / "store" / "1.sst").exists()


def test_a_file_in_the_place_of_the_folder_stays(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with NewFolder(tmp_path / "file"):
        pass
    assert (tmp_path / "file").read_text() == "x"


def test_a_folder_that_was_never_made_is_no_failure(tmp_path: Path) -> None:
    with NewFolder(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_somebody_holds_stays_whole(tmp_path: Path) -> None:
    with NewFolder(tmp_path / "a"):
        _fill(tmp_path / "a")
        lock = FolderLock(tmp_path / "a")
    lock.release()
    assert (tmp_path / "a" / "store" / "1.sst").exists()


def test_the_folder_is_held_until_it_is_empty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[Path] = []

    class Lock(FolderLock):
        def __init__(self, folder: Path) -> None:
            super().__init__(folder)
            taken.append(folder)

        def release(self) -> None:
            assert not (tmp_path / "a" / "settings").exists()
            taken.append(tmp_path / "released")
            super().release()

    monkeypatch.setattr("rtask.kb.durability.lock.FolderLock", Lock)
    with NewFolder(tmp_path / "a"):
        _fill(tmp_path / "a")
    assert taken == [tmp_path / "a", tmp_path / "released"]
    assert not (tmp_path / "a").exists()


def test_a_relative_folder_is_removed_though_the_process_went_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with NewFolder(Path("a")):
        _fill(tmp_path / "a")
        (tmp_path / "elsewhere").mkdir()
        monkeypatch.chdir(tmp_path / "elsewhere")
    assert list(tmp_path.iterdir()) == [tmp_path / "elsewhere"]


def test_what_failed_before_it_stored_anything_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(_FailedError):
        _fail_in(tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("stores", [True, False])
def test_what_failed_after_it_stored_something_keeps_it(tmp_path: Path, stores: bool) -> None:
    with pytest.raises(_FailedError):
        _fail_in(tmp_path / "a", "INSERT DATA { <urn:a> <urn:p> 1 }", stores=stores)
    with rtask.open(tmp_path / "a", mode="r") as kb:
        assert kb.query("ASK { <urn:a> <urn:p> 1 }")


@pytest.mark.parametrize("stores", [True, False])
def test_a_command_without_changes_leaves_a_folder_only_if_it_stores(
    tmp_path: Path, stores: bool
) -> None:
    with open_or_make(tmp_path / "a", stores=stores, ontologies=False, reason=False):
        pass
    assert (tmp_path / "a").exists() is stores


def test_a_folder_that_may_not_be_listed_counts_as_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Path) -> Iterator[Path]:
        raise PermissionError

    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", refuse)
        assert new_folder._is_used(tmp_path)
        new = NewFolder(tmp_path)
    with new:
        _fill(tmp_path)
    assert (tmp_path / "settings").exists()
