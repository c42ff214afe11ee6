"""Backup of an open knowledge base to a folder that can itself be opened, and restore."""

from __future__ import annotations

import datetime as dt
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pyoxigraph import Store

from rtask.errors import (
    NoStoreError,
    RtaskError,
    StoreError,
    StoreFormatError,
    StoreLockedError,
    UnsupportedError,
    UsageError,
)
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.blobs import BlobStore, copy_blob, sync_folder
from rtask.kb.durability.disk_space import full_disk, means_full
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.lock import FolderLock
from rtask.kb.durability.recovery import Checkpoint, Checkpoints, boot_id
from rtask.kb.durability.seal import seal
from rtask.kb.durability.settings import Settings, write_durably
from rtask.kb.proposals.register import Proposals
from rtask.kb.store.embedded import embedded_store

__all__ = ["backup", "discard_unfinished", "restore"]

_FILE = "backup.json"
_UNFINISHED = ".partial"


def backup(files: Files, writer: Writer, target: Path, blobs: bool = True) -> dict[str, Any]:
    """Copy an open knowledge base; writers wait briefly, readers are not affected.

    The copy is opened and its statements counted before it gets its name: until then it is beside
    it, with ``.partial`` at the end, where the next backup of that name replaces what a killed one
    left.

    Parameters
    ----------
    blobs
        Whether to copy byte strings, too.

    Returns
    -------
    ``seq`` (the last commit it holds), ``created``, ``store_id``, ``quads``.

    Raises
    ------
    UnsupportedError
        For a store in memory; dump it instead.
    UsageError
        If the target exists, or another process makes a backup of that name.
    """
    if files.folder is None or files.checkpoints is None:
        raise UnsupportedError(
            "backup needs a folder open for writing; export a store in memory instead"
        )
    if target.exists():
        raise UsageError(f"{target} exists{_what_it_is(target)}; name a new folder")
    try:
        with _named_once_whole(target) as partial:
            folder = files.folder if blobs else None
            return _copy(files, writer, folder, files.checkpoints, partial)
    except (OSError, RuntimeError, RtaskError) as error:
        if means_full(error):
            raise full_disk(
                target, "for the backup, of which nothing is left; name a folder on another disk"
            ) from error
        raise


@contextmanager
def _named_once_whole(target: Path) -> Iterator[Path]:
    """Make a folder that gets its name when the block ends, and nothing where it fails.

    A lock tells the folder of a running backup from what a killed one left.
    """
    partial = target.with_name(target.name + _UNFINISHED)
    partial.mkdir(parents=True, exist_ok=True)
    try:
        lock = FolderLock(partial)
    except StoreLockedError as error:
        raise UsageError(
            f"another process makes the backup {target}; name another folder"
        ) from error
    try:
        _empty(partial)
        yield partial
        _sync_tree(partial)
        try:
            partial.rename(target)
        except OSError as error:
            if target.exists():
                raise UsageError(f"{target} was made meanwhile; name a new folder") from error
            raise
        sync_folder(target.parent)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    finally:
        lock.release()


def discard_unfinished(folder: Path) -> int:
    """Remove what killed backups left in a folder of backups; return how many there were.

    Their links keep files of the store that it has long replaced. Those that are being made, and
    folders without a lock, which no backup made, stay.
    """
    left = 0
    for partial in folder.glob(f"*{_UNFINISHED}"):
        if not (partial / "lock").is_file():
            continue
        try:
            lock = FolderLock(partial)
        except (StoreLockedError, FileNotFoundError):
            continue
        try:
            shutil.rmtree(partial, ignore_errors=True)
        finally:
            lock.release()
        left += 1
    return left


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != "lock":
            path.unlink()


def _sync_tree(folder: Path) -> None:
    """Force a copy to the disk: a power cut must not leave a whole name with torn files."""
    for place, _, names in os.walk(folder):
        for name in names:
            handle = os.open(Path(place, name), os.O_RDONLY | os.O_CLOEXEC)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        sync_folder(Path(place))


def _what_it_is(target: Path) -> str:
    if (target / _FILE).exists():
        return " and is a backup"
    if (target / "kb.json").exists():
        return " and is a knowledge base, or a backup that was interrupted"
    return " and is a backup that was interrupted" if (target / "store").is_dir() else ""


def _copy(
    files: Files, writer: Writer, folder: Path | None, checkpoints: Checkpoints, target: Path
) -> dict[str, Any]:
    with writer.exclusive():
        seq = writer.committer.last_seq
        checkpoints.reserve.spend_on(lambda: checkpoints.make(seq))
        embedded_store(files.store, "a backup").raw.backup(str(target / "store"))
        _copy_journal(files.journal, target / "journal")
    for blob in sorted((folder / "blobs").glob("??/??/*")) if folder is not None else ():
        copy_blob(blob, target / "blobs" / blob.relative_to(blob.parents[2]))
    (target / "blobs" / "tmp").mkdir(parents=True, exist_ok=True)
    Proposals(files.folder).copy_to(target)
    files.settings.save(target)
    sealed = seal(JournalFile(target / "journal"))
    Checkpoint(seq, True, boot_id(), journal=sealed).save(target)
    created = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    record: dict[str, Any] = {"seq": seq, "created": created}
    record |= {"store_id": files.settings.store_id, "quads": _count(target)}
    write_durably(target / _FILE, json.dumps(record, indent=2) + "\n")
    return record


def _copy_journal(journal: object, target: Path) -> None:
    target.mkdir()
    if isinstance(journal, JournalFile):
        for segment in journal.segments():
            shutil.copyfile(segment, target / segment.name)


def _count(folder: Path) -> int:
    try:
        return len(Store.read_only(str(folder / "store")))
    except (OSError, RuntimeError) as error:
        raise StoreFormatError(f"the store in {folder} cannot be read: {error}") from error


def check(source: Path) -> dict[str, Any]:
    """Return the record of a backup after checking that its store, journal and blobs are complete.

    Raises
    ------
    StoreFormatError
        A part is missing or damaged; the error names it.
    """
    try:
        record: dict[str, Any] = json.loads((source / _FILE).read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise NoStoreError(f"{source} is not a complete backup: {_FILE} is missing") from error
    quad_count = _count(source)
    if quad_count != record.get("quads", quad_count):
        raise StoreFormatError(
            f"{source} is damaged: it holds {quad_count} statements instead of {record['quads']}"
        )
    blobs = BlobStore(source / "blobs", writable=False)
    for digest in blobs.digests():
        if not blobs.is_sound(digest):
            raise StoreFormatError(f"{source} is damaged: blob {digest} differs from its digest")
    journal = JournalFile(source / "journal")
    last = 0 if journal.segments() else record["seq"]
    try:
        for entry in journal.records():
            last = entry.seq
    except StoreError as error:
        raise StoreFormatError(f"{source}: {error}") from error
    if last != record["seq"]:
        raise StoreFormatError(f"{source}: its journal ends at {last}, not at {record['seq']}")
    return record


def restore(source: Path, target: Path) -> dict[str, Any]:
    """Create a knowledge base from a backup, with a new epoch and a record of its origin.

    Raises
    ------
    StoreFormatError
        If the source is not a complete, undamaged backup.
    UsageError
        If the target is not empty.
    """
    record = check(source)
    settings = Settings.load(source)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise UsageError(f"{target} is not empty; name a new folder")
    # The settings come last: without them, what a kill leaves of a copy is no knowledge base.
    ignored = shutil.ignore_patterns(_FILE, "kb.json")
    shutil.copytree(source, target, dirs_exist_ok=True, ignore=ignored)
    parent = f"{record['store_id']}@{record['seq']}"
    replace(settings, epoch=Settings.new().epoch, parent=parent).save(target)
    return record
