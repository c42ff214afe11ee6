"""Journal: each commit as text, written to disk before the commit is acknowledged.

A record is a JSON line followed by ``D`` (deleted) and ``A`` (added) lines, each with one N-Quads
statement and the store's own blank node labels. Segments are named after the first commit they
hold. The union in the default graph is left out; replaying computes it.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import errno
import itertools
import json
import os
import threading
import zlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from pyoxigraph import Quad, RdfFormat, parse, serialize

from rtask.errors import StorageFullError, StoreError
from rtask.kb.durability.blobs import sync_folder
from rtask.kb.durability.journal_marks import JournalMarks
from rtask.kb.store.quads import InGraph, parts_of
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DefaultGraph, GraphName, iri

__all__ = [
    "CommitRecord",
    "Journal",
    "JournalFile",
    "JournalWithHistory",
    "NoJournal",
    "Record",
    "body_of",
]

Piece = bytes | memoryview
SEGMENT_BYTES = 64 << 20
_RETAINED_BYTES = 1 << 30
"""Size alone decides what goes: after a clock was set ahead, the newest segments would look old."""
_BLOCK = 10_000
"""Number of statements that are turned into text at a time."""


@dataclass(frozen=True)
class CommitRecord:
    """Facts about a commit that is to be written.

    Parameters
    ----------
    seq
        Number of the commit, from 1, without gaps.
    started, ended
        UTC; never earlier than the previous commit.
    agent
        Name of the author, or ``None``.
    role
        Role of the author.
    note
        Free text, or ``None``.
    is_partial
        Whether the commit counts statements that were stored before it, by a bulk load.
    """

    seq: int
    started: dt.datetime
    ended: dt.datetime
    agent: str | None
    role: str
    note: str | None = None
    is_partial: bool = False

    def header(self) -> dict[str, Any]:
        """Return what the header of its record in a journal says of every commit."""
        header = {
            "seq": self.seq,
            "time": self.ended.isoformat(),
            "agent": self.agent,
            "note": self.note,
            "kind": "delta",
        }
        return {**header, "partial": True} if self.is_partial else header


@dataclass(frozen=True)
class Record:
    """A commit read from the journal.

    Parameters
    ----------
    header
        ``seq, time, agent, note, kind, removed, added, created, dropped, bytes, crc32``; and
        ``partial`` if the commit counts statements that were stored without a record.
    body
        The ``D`` and ``A`` lines.
    """

    header: dict[str, Any]
    body: bytes

    @property
    def seq(self) -> int:
        """Number of the commit."""
        return int(self.header["seq"])

    def removed(self) -> list[Quad]:
        """Return the statements that the commit withdrew."""
        return self._removed

    def added(self) -> list[Quad]:
        """Return the statements that the commit asserted or derived."""
        return self._added

    @cached_property
    def _removed(self) -> list[Quad]:
        return self._quads(b"D ")

    @cached_property
    def _added(self) -> list[Quad]:
        return self._quads(b"A ")

    def graphs(self, key: str) -> list[GraphName]:
        """Return the graphs that the commit ``created`` or ``dropped``."""
        return [iri(name) for name in self.header.get(key, ())]

    def _quads(self, mark: bytes) -> list[Quad]:
        lines = [line[2:] for line in self.body.splitlines() if line.startswith(mark)]
        return list(parse(b"\n".join(lines), format=RdfFormat.N_QUADS))


class Journal(Protocol):
    """Interface of journals."""

    def append(self, record: CommitRecord, change: Writes) -> None:
        """Write the record of a commit, not yet durably."""

    def withdraw(self) -> None:
        """Remove the last record, after storing its commit failed."""

    def sync(self, seq: int) -> None:
        """Wait until the record of this commit is durable."""


class JournalWithHistory(Journal, Protocol):
    """A journal that can be read."""

    def records(self, since: int = 0) -> Iterator[Record]:
        """Yield the records of commits after ``since``, oldest first."""

    def oldest(self) -> int | None:
        """Return the number of the oldest commit with a record; ``None`` without any."""

    def close(self) -> None:
        """Release what the journal holds."""


class NoJournal:
    """Journal of a store in memory, which records nothing."""

    def append(self, record: CommitRecord, change: Writes) -> None:
        """Do nothing."""

    def withdraw(self) -> None:
        """Do nothing."""

    def sync(self, seq: int) -> None:
        """Do nothing."""


class JournalFile:
    """Journal of a folder, in segments.

    Parameters
    ----------
    folder
        Folder of the segments.
    durable
        Whether :meth:`sync` calls fsync. Otherwise commits survive the end of the process but not
        a power cut.

    Attributes
    ----------
    marks
        Where each record begins, read when it is needed.
    """

    def __init__(self, folder: Path, durable: bool = True) -> None:
        folder.mkdir(exist_ok=True)
        self._folder = folder
        self._durable = durable
        self._syncing = threading.Lock()
        self._handle = -1
        self._size = self._before = 0
        self._written = self._written_before = self._synced = 0
        self._path: Path | None = None
        self.written_bytes = 0
        self.marks = JournalMarks(self.segments)

    @property
    def folder(self) -> Path:
        """Folder of the segments."""
        return self._folder

    @property
    def written(self) -> int:
        """Number of the last record that this process wrote; 0 before the first."""
        return self._written

    def append(self, record: CommitRecord, change: Writes) -> None:
        """Write the record of a commit, not yet durably.

        Raises
        ------
        StorageFullError
            The disk is full; nothing of the record is kept.
        """
        self._append(_encode(record, change), record.seq)

    def append_record(self, data: bytes, seq: int) -> None:
        """Write an encoded record."""
        self._append([data], seq)

    def _append(self, pieces: Sequence[Piece], seq: int) -> None:
        """Write the pieces of an encoded record; a large one is never put together."""
        self._open(seq)
        self._before, self._written_before = self._size, self._written
        try:
            for piece in pieces:
                view = memoryview(piece)
                # A single call may write less, as when a signal arrives or the disk is almost full.
                while view:
                    view = view[os.write(self._handle, view) :]
        except BaseException as error:
            self.withdraw()
            if not isinstance(error, OSError):
                raise
            if error.errno == errno.ENOSPC:
                raise StorageFullError(
                    f"the disk is full: the journal in {self._folder} cannot grow"
                ) from error
            raise StoreError(f"the journal in {self._folder} cannot be written: {error}") from error
        size = sum(map(len, pieces))
        self._size += size
        self.written_bytes += size
        self._written = seq

    def withdraw(self) -> None:
        """Remove the last record, whose number is then reused."""
        with self._syncing:
            # The number is used again, so no reader may ever meet a record that was taken back.
            os.ftruncate(self._handle, self._before)
            if self._path is not None:
                # What was noted of places in the file lies beyond its end now.
                self.marks.forget(self._path.name, self._before)
            self._size = self._before
            self._written = self._written_before
            self._synced = min(self._synced, self._written)

    def sync(self, seq: int) -> None:
        """Wait until the record of this commit is durable; threads share one fsync."""
        if not self._durable:
            return
        with self._syncing:
            # Another thread's call has already covered this commit.
            if self._synced >= seq or self._handle < 0:
                return
            # Read before the call: what is appended meanwhile may not be on the disk after it.
            written = self._written
            try:
                os.fdatasync(self._handle)
            except OSError as error:
                raise StoreError(
                    f"the journal in {self._folder} cannot be forced to disk: {error}"
                ) from error
            self._synced = max(written, self._synced)

    def _open(self, seq: int) -> None:
        if self._handle >= 0 and self._size < SEGMENT_BYTES:
            return
        last = self.segments()[-1:]
        # A segment that a crash left short is continued; its torn end was cut at opening.
        if self._handle < 0 and last and last[0].stat().st_size < SEGMENT_BYTES:
            path = last[0]
        else:
            path = self._folder / f"{seq:016d}.log"
        with self._syncing:
            self._close_segment()
            self._path = path
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC)
            self._size = os.fstat(self._handle).st_size
        # The data of a new file can be durable while its name in the folder is not.
        sync_folder(self._folder)

    def _close_segment(self) -> None:
        if self._handle < 0:
            return
        # Before the next one begins, or a later commit would be durable before an earlier one.
        os.fdatasync(self._handle)
        self._synced = self._written
        os.close(self._handle)
        self._handle = -1

    def close(self) -> None:
        """Force everything to disk and close the file."""
        with self._syncing:
            self._close_segment()

    def segments(self) -> list[Path]:
        """Return the segments, oldest first."""
        return sorted(self._folder.glob("*.log"))

    def records(self, since: int = 0) -> Iterator[Record]:
        """Yield the records of commits after ``since``, oldest first.

        Raises
        ------
        StoreError
            A record is damaged, other than one torn at the end of the journal.
        """
        segments = self.segments()
        for at, path in enumerate(segments):
            following = segments[at + 1] if at + 1 < len(segments) else None
            # All its records are older: a segment is named after its first.
            if following is not None and int(following.stem) <= since + 1:
                continue
            for record, _ in read_segment(path, torn_end=following is None):
                if record.seq > since:
                    yield record

    def oldest(self) -> int | None:
        """Return the number of the oldest commit with a record; ``None`` without any."""
        segments = self.segments()
        return int(segments[0].stem) if segments else None

    def records_from(self, segment: str, start: int) -> Iterator[Record]:
        """Yield the record at an offset of a segment, and all after it.

        Parameters
        ----------
        segment, start
            As returned by :meth:`place_of`.
        """
        paths = [path for path in self.segments() if path.name >= segment]
        if not paths or paths[0].name != segment:
            raise StoreError(f"the journal in {self._folder} has no segment {segment}")
        for path in paths:
            torn_end = path == paths[-1]
            for record, _ in read_segment(path, torn_end, start if path == paths[0] else 0):
                yield record

    def place_of(self, seq: int) -> tuple[str, int, list[Any]] | None:
        """Return where the record of a commit is, and what tells it from another one.

        Returns
        -------
        Name of the segment, offset, and number, time and checksum of the record; ``None`` if the
        journal does not hold the commit.
        """
        # The last record of this process needs no reading from the start.
        if self._path is not None and self._written == seq and self._before < self._size:
            segments, start = [self._path], self._before
        else:
            segments, start = self.segments()[-1:], 0
        for path in segments:
            for record, end in read_segment(path, torn_end=True, start=start):
                if record.seq == seq:
                    header = record.header
                    return path.name, start, [seq, header.get("time"), header.get("crc32")]
                start = end
        return None

    def cut_torn_end(self) -> None:
        """Remove an incomplete record that a crash left at the end."""
        for path in self.segments()[-1:]:
            ends = [end for _, end in read_segment(path, torn_end=True)]
            end = ends[-1] if ends else 0
            if end < path.stat().st_size:
                with path.open("rb+") as file:
                    # Else the record of the next commit would follow a half one, and neither could
                    # be read.
                    file.truncate(end)
                    os.fsync(file.fileno())

    def prune(self, checkpoint: int) -> None:
        """Delete the oldest segments beyond 1 GiB; all since the last checkpoint stay."""
        segments = self.segments()
        total = sum(path.stat().st_size for path in segments)
        for path, following in itertools.pairwise(segments):
            # The store itself is durable only up to the checkpoint; what follows may have to be
            # replayed.
            if total <= _RETAINED_BYTES or int(following.stem) > checkpoint:
                return
            total -= path.stat().st_size
            path.unlink()


def _encode(record: CommitRecord, change: Writes) -> list[Piece]:
    header = record.header()
    header |= {"removed": len(change.removed), "added": len(change.added)}
    for key, graphs in (("created", change.created), ("dropped", change.dropped)):
        # Names, since an empty graph has no statement that would show it.
        if graphs:
            header[key] = [getattr(graph, "value", "") for graph in graphs]
    body = [*_pieces(b"D ", change.removed), *_pieces(b"A ", change.added)]
    return [_header(header, body), *body]


def body_of(removed: Collection[Quad], added: Collection[Quad]) -> bytes:
    """Return the lines of a record."""
    return b"".join((*_pieces(b"D ", removed), *_pieces(b"A ", added)))


def encode(header: dict[str, Any], body: bytes) -> bytes:
    """Return the bytes of a record."""
    return _header(header, [body]) + body


def _header(header: dict[str, Any], body: Iterable[Piece]) -> bytes:
    size = crc32 = 0
    for piece in body:
        size, crc32 = size + len(piece), zlib.crc32(piece, crc32)
    whole = {**header, "bytes": size, "crc32": crc32}
    return json.dumps(whole, ensure_ascii=False).encode() + b"\n"


def _pieces(mark: bytes, quads: Collection[Quad]) -> Iterator[Piece]:
    """Yield the lines of quads, each with a mark before it."""
    for part in parts_of(quads):
        triples = part.text() if isinstance(part, InGraph) and len(part) > _BLOCK else None
        if triples:
            assert isinstance(part, InGraph)
            graph = b"" if isinstance(part.graph, DefaultGraph) else f" {part.graph}".encode()
            # Marked by one replacement, not line by line: such a text has thousands of lines.
            yield mark
            yield memoryview(triples.replace(b" .\n", graph + b" .\n" + mark))[: -len(mark)]
            continue
        rest = iter(part)
        while block := list(itertools.islice(rest, _BLOCK)):
            text = serialize(block, format=RdfFormat.N_QUADS)
            assert text is not None
            yield mark
            yield memoryview(text.replace(b"\n", b"\n" + mark))[: -len(mark)]


def read_segment(path: Path, torn_end: bool, start: int = 0) -> Iterator[tuple[Record, int]]:
    """Yield each record of a segment and the offset of its end.

    Parameters
    ----------
    torn_end
        Whether the last record may be incomplete, in which case it is left out.
    start
        Offset of the first record to read.
    """
    with path.open("rb") as file:
        file.seek(start)
        while line := file.readline():
            record = None
            with contextlib.suppress(ValueError, KeyError, TypeError):
                header = json.loads(line)
                body = file.read(int(header["bytes"]))
                if zlib.crc32(body) == header["crc32"] and len(body) == header["bytes"]:
                    record = Record(header, body)
            if record is None:
                # A killed process may leave a half record, but only at the very end.
                if torn_end:
                    return
                raise StoreError(f"{path} has a damaged record before its end; restore a backup")
            yield record, file.tell()
