"""Copies of a knowledge base that follow the journal of another process, commit by commit.

A follower's folder is like any other, with ``follow.json`` beside it that names whom it follows.
The records that it applies are those of the writer, derived statements and notes included, so it
needs no closure, and its own journal is the same as the writer's.
"""

from __future__ import annotations

import io
import json
import shutil
import tarfile
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO
from weakref import WeakKeyDictionary

from rtask.errors import StoreError, UnsupportedError, UsageError
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, Record, encode, read_segment
from rtask.kb.durability.recovery import replay_all
from rtask.kb.durability.settings import Settings, write_durably
from rtask.kb.feed.feed import Feed
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import NetChange, Overlay
from rtask.rdf.terms import GraphName, moment

__all__ = [
    "JournalTail",
    "apply_records",
    "followed_by",
    "install_snapshot",
    "mark_following",
    "promote",
    "write_snapshot",
]

_MARK = "follow.json"
_INCOMING = "incoming"
_REPLACED = (
    "store", "journal", "checkpoint.json", "published", "snapshots", "past", "loading.json",
)  # fmt: skip
_PIECE = 1 << 20


def followed_by(folder: Path) -> str | None:
    """Return the address that a folder follows; ``None`` if it follows nobody."""
    try:
        mark: dict[str, Any] = json.loads((folder / _MARK).read_text("utf-8"))
    except FileNotFoundError:
        return None
    return str(mark["url"])


def is_complete(folder: Path) -> bool:
    """Whether a follower's folder holds a whole copy."""
    try:
        mark: dict[str, Any] = json.loads((folder / _MARK).read_text("utf-8"))
    except FileNotFoundError:
        return False
    return bool(mark["complete"]) and (folder / "kb.json").exists()


def mark_following(folder: Path, url: str, complete: bool) -> None:
    """Note whom a folder follows, and whether it holds a whole copy to go on from."""
    write_durably(folder / _MARK, json.dumps({"url": url, "complete": complete}) + "\n")


def write_snapshot(backup: Path, out: BinaryIO) -> None:
    """Write a backup as a tar file, without byte strings, which a follower fetches one by one."""
    with tarfile.open(fileobj=out, mode="w|") as tar:
        for name in ("kb.json", "checkpoint.json", "store", "journal"):
            tar.add(backup / name, name)


def install_snapshot(folder: Path, source: BinaryIO, url: str) -> None:
    """Replace the copy in a folder by a snapshot; killed meanwhile, the next start does it again.

    Raises
    ------
    StoreError
        The snapshot broke off.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mark_following(folder, url, complete=False)
    incoming = folder / _INCOMING
    shutil.rmtree(incoming, ignore_errors=True)
    incoming.mkdir()
    try:
        with tarfile.open(fileobj=source, mode="r|") as tar:
            tar.extractall(incoming, filter="data")
    except (tarfile.TarError, OSError, EOFError) as error:
        raise StoreError(f"the snapshot of {url} broke off: {error}") from error
    for name in _REPLACED:
        _remove(folder / name)
    for old in (*folder.glob("closure-*"), *folder.glob("index.sqlite*")):
        _remove(old)
    for part in ("store", "journal", "checkpoint.json", "kb.json"):
        (incoming / part).rename(folder / part)
    shutil.rmtree(incoming, ignore_errors=True)
    mark_following(folder, url, complete=True)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def promote(folder: Path) -> Settings:
    """Turn a follower's folder into a knowledge base of its own, with a new epoch.

    The folder must have been recovered and closed. Other followers start over from it.

    Raises
    ------
    UsageError
        The folder follows nobody, or holds no whole copy.
    """
    if followed_by(folder) is None:
        raise UsageError(f"{folder} follows nobody; it can be served as it is")
    if not is_complete(folder):
        raise UsageError(f"{folder} holds no whole copy of what it follows; promote another one")
    settings = replace(Settings.load(folder), epoch=Settings.new().epoch)
    settings.save(folder)
    (folder / _MARK).unlink()
    return settings


@dataclass
class _LastRead:
    """The piece of a journal that was read last, and where reading goes on after it."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    after: int = -1
    asked: int = -1
    upto: int = -1
    data: bytes = b""
    segment: Path | None = None
    offset: int = 0


_last_read: WeakKeyDictionary[JournalFile, _LastRead] = WeakKeyDictionary()


class JournalTail:
    """Reads the records of a journal after a commit as they are written, in their own bytes.

    Parameters
    ----------
    after
        Number of the last commit that the reader has.
    """

    def __init__(self, files: Files, after: int) -> None:
        if not isinstance(files.journal, JournalFile):
            raise UnsupportedError("followers need a writer with a folder and its journal")
        self._journal = files.journal
        self.after = after
        self._segment: Path | None = None
        self._offset = 0
        self._last = _last_read.setdefault(files.journal, _LastRead())

    def read(self, upto: int) -> bytes:
        """Return whole records up to a commit that is durable, about a megabyte at most.

        Nothing means that the journal no longer holds the next one. What one reader has read is
        kept for the others: those that follow live all read the same.
        """
        last = self._last
        if not last.lock.acquire(blocking=False):  # another one reads a large piece
            return self._read(upto)
        try:
            if (last.after, last.asked) == (self.after, upto):
                self.after, self._segment, self._offset = last.upto, last.segment, last.offset
                return last.data
            after = self.after
            data = self._read(upto)
            last.after, last.asked, last.upto, last.data = after, upto, self.after, data
            last.segment, last.offset = self._segment, self._offset
            return data
        finally:
            last.lock.release()

    def _read(self, upto: int) -> bytes:
        out = io.BytesIO()
        while self.after < upto and out.tell() < _PIECE:
            if not self._read_segment(out, upto):
                break
        return out.getvalue()

    def _read_segment(self, out: BinaryIO, upto: int) -> bool:
        """Read on in the segment of the next commit; return whether anything was found."""
        segments = self._journal.segments()
        started = [path for path in segments if int(path.stem) <= self.after + 1]
        if not started:
            return False
        if started[-1] != self._segment:
            self._segment, self._offset = started[-1], 0
        before = self.after
        for record, end in read_segment(self._segment, torn_end=True, start=self._offset):
            if record.seq > upto or out.tell() >= _PIECE:
                break
            self._offset = end
            if record.seq > self.after:
                out.write(encode(_own(record.header), record.body))
                self.after = record.seq
        return self.after > before


def _own(header: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in header.items() if name not in ("bytes", "crc32")}


def apply_records(writer: Writer, files: Files, feed: Feed, records: Sequence[Record]) -> None:
    """Store the commits of another process, many in one step, and announce them.

    Raises
    ------
    StoreError
        A commit is missing before the first one.
    """
    journal, committer = files.journal, writer.committer
    assert isinstance(journal, JournalFile)
    with writer.exclusive():
        expected = committer.last_seq + 1
        if records[0].seq != expected:
            raise StoreError(f"commit {expected} is missing: the next record is {records[0].seq}")
        for record in records:
            if record.seq > journal.written:  # an earlier attempt may have failed after this
                journal.append_record(encode(_own(record.header), record.body), record.seq)
        journal.sync(records[-1].seq)
        replay_all(committer.store, records, files.settings.is_merged)
        committer.catalogue.apply(_notes(committer.store, records, committer.graphs.meta))
        for record in records:
            for graph in record.graphs("dropped"):
                committer.catalogue.forget(graph)
        committer.last_seq = records[-1].seq
        committer.last_time = moment(records[-1].header["time"])
        writer.take_in([feed.read(record) for record in records])
    writer.announce()
    writer.checkpoint_if_due()


def _notes(store: GraphStore, records: Iterable[Record], meta: GraphName) -> Overlay:
    """Return the change that several commits together make to the catalogue."""
    total = NetChange()
    for record in records:
        change = Overlay(store)
        change.removed.update((q, None) for q in record.removed() if q.graph_name == meta)
        change.added.update((q, None) for q in record.added() if q.graph_name == meta)
        total.join(change)
    return Overlay(store, total.removed, total.added)
