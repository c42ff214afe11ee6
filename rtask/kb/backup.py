"""Backup and restore: a folder that can be opened by itself, made while others read and write."""

from __future__ import annotations

import datetime as dt
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from rtask.errors import StoreFormatError, UnsupportedError, UsageError
from rtask.kb.blobs import copy_blob
from rtask.kb.folder import Files
from rtask.kb.journal import JournalFile
from rtask.kb.recovery import Checkpoint, boot_id
from rtask.kb.settings import Settings, write_durably
from rtask.kb.writer import Writer

__all__ = ["backup", "restore"]

_FILE = "backup.json"


def backup(files: Files, writer: Writer, target: Path) -> dict[str, Any]:
    """Copy an open knowledge base; writers wait a moment, readers do not.

    Returns
    -------
    ``seq`` (the last commit it holds), ``created``, ``store_id``.

    Raises
    ------
    UnsupportedError
        For a store in memory; dump it instead.
    UsageError
        If the target exists.
    """
    if files.folder is None or files.checkpoints is None:
        raise UnsupportedError(
            "only a folder open for writing is backed up; export a store in memory"
        )
    if target.exists():
        raise UsageError(f"{target} exists; name a new folder")
    target.mkdir(parents=True)
    with writer.exclusive():
        seq = writer.committer.last_seq
        files.checkpoints.make(seq)
        files.store.raw.backup(str(target / "store"))
        _copy_journal(files.journal, target / "journal")
    for blob in sorted((files.folder / "blobs").glob("??/??/*")):
        copy_blob(blob, target / "blobs" / blob.relative_to(files.folder / "blobs"))
    (target / "blobs" / "tmp").mkdir(parents=True, exist_ok=True)
    files.settings.save(target)
    Checkpoint(seq, True, boot_id()).save(target)
    created = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    record = {"seq": seq, "created": created, "store_id": files.settings.store_id}
    write_durably(target / _FILE, json.dumps(record, indent=2) + "\n")
    return record


def _copy_journal(journal: object, target: Path) -> None:
    target.mkdir()
    if isinstance(journal, JournalFile):
        for segment in journal.segments():
            shutil.copyfile(segment, target / segment.name)


def restore(source: Path, target: Path) -> dict[str, Any]:
    """Make a knowledge base from a backup; it gets a new epoch.

    Raises
    ------
    StoreFormatError
        If the source is no complete backup.
    UsageError
        If the target is not empty.
    """
    try:
        record: dict[str, Any] = json.loads((source / _FILE).read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise StoreFormatError(f"{source} is no complete backup (no {_FILE})") from error
    settings = Settings.load(source)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise UsageError(f"{target} is not empty; name a new folder")
    shutil.copytree(source, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns(_FILE))
    replace(settings, epoch=Settings.new().epoch).save(target)
    return record
