"""Reading beside a writer in another process: each read sees what the writer has committed.

The reader has a copy of a snapshot and the writer's journal. Before a read begins, the size of the
journal tells whether there are commits that the copy lacks; those are applied first.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.errors import ClosedError, RtaskError, StoreError
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.journal import SEGMENT_BYTES, JournalFile, Record, read_segment
from rtask.kb.durability.private_copy import PrivateCopy
from rtask.kb.durability.recovery import replay_all
from rtask.kb.feed.feed import Feed
from rtask.kb.feed.outage import Outage
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import LONG_AGO, GraphName

__all__ = ["Follower"]

_log = logging.getLogger(__name__)
_EVERY_S = 0.2
"""Interval (s) of checks for commits, of which a file system does not tell."""


@dataclass(frozen=True)
class _Place:
    """Position in the journal of the last record looked at, and its header."""

    segment: Path
    end: int = 0
    start: int = 0
    header: dict[str, Any] | None = None

    def is_there(self) -> bool:
        """Whether the record is still there: a writer takes one back that it could not store."""
        try:
            with self.segment.open("rb") as file:
                if os.fstat(file.fileno()).st_size < self.end:
                    return False
                file.seek(self.start)
                return self.header is None or json.loads(file.readline()) == self.header
        except (FileNotFoundError, ValueError):
            return False


class Follower:
    """The gate through which reads of a copy begin; see :class:`rtask.kb.store.graph_store.Gate`.

    Parameters
    ----------
    copy
        Folder of the copies of snapshots.
    store
        The copy that is read.
    journal
        The writer's journal, which is only read.
    writer, feed
        Of this process; the writer is closed.
    merged
        Whether the store holds the union of the named graphs.
    """

    def __init__(
        self,
        copy: PrivateCopy,
        store: EmbeddedStore,
        journal: JournalFile,
        writer: Writer,
        feed: Feed,
        merged: bool,
    ) -> None:
        self._copy = copy
        self._store = store
        self._journal = journal
        self._writer = writer
        self._feed = feed
        self._merged = merged
        self._lock = threading.RLock()
        self._is_looking = False
        self._gate = threading.Condition()
        self._inside = threading.local()
        self._beginning = 0
        self._is_excluding = False
        self._closed = threading.Event()
        self._place = self._place_of(writer.committer.last_seq)
        store.gate = self
        self._thread = threading.Thread(target=self._run, name="rtask-follow", daemon=True)
        self._thread.start()

    # The gate

    def concerns(self, graph: GraphName) -> bool:
        """Whether the content of a graph may not be complete."""
        return True

    @property
    def is_behind(self) -> bool:
        """Whether the writer has committed since the last look."""
        return self._has_news()

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Begin a read in this block that sees the commits made so far."""
        if getattr(self._inside, "is_on", False):
            yield  # part of a read that is beginning, and sees what that one sees
            return
        self.look()
        with self._gate:
            self._gate.wait_for(lambda: not self._is_excluding)
            self._beginning += 1
        self._inside.is_on = True
        try:
            yield
        finally:
            self._inside.is_on = False
            self._leave()

    @contextlib.contextmanager
    def reading_now(self) -> Iterator[bool]:
        """Begin a read in this block if no commits have to be applied first."""
        with self._gate:
            may_begin = not self._is_excluding and not self._has_news()
            self._beginning += may_begin
        try:
            yield may_begin
        finally:
            if may_begin:
                self._leave()

    def _leave(self) -> None:
        """End the beginning of a read."""
        with self._gate:
            self._beginning -= 1
            self._gate.notify_all()

    def flush(self) -> None:
        """Apply the commits made so far."""
        self.look()

    @contextlib.contextmanager
    def excluding(self) -> Iterator[None]:
        """Let no read begin in the block; it is entered when those that begin have begun."""
        with self._gate:
            self._is_excluding = True
            self._gate.wait_for(lambda: not self._beginning)
        try:
            yield
        finally:
            with self._gate:
                self._is_excluding = False
                self._gate.notify_all()

    # Following

    def look(self) -> None:
        """Apply the writer's commits since the last look."""
        with self._lock:
            if self._is_looking or not self._has_news():
                return
            self._is_looking = True  # for the reads that applying commits needs
            try:
                self._take_in()
                if self._has_news():  # what came after a snapshot
                    self._take_in()
            finally:
                self._is_looking = False
        self._writer.announce()

    def _has_news(self) -> bool:
        try:
            size = self._place.segment.stat().st_size
        except FileNotFoundError:
            return bool(self._journal.segments())
        return size != self._place.end or (
            size >= SEGMENT_BYTES and self._next_segment() is not None
        )

    def _next_segment(self) -> Path | None:
        here = self._place.segment.name
        return next((p for p in self._journal.segments() if p.name > here), None)

    def _place_of(self, seq: int) -> _Place:
        """Return the place of the record of a commit."""
        segments = [p for p in self._journal.segments() if int(p.stem) <= max(seq, 1)]
        if not segments:
            return _Place(self._journal.folder / f"{1:016d}.log")
        place = _Place(segments[-1])
        for record, end in read_segment(segments[-1], torn_end=True):
            if record.seq > seq:
                break
            place = _Place(segments[-1], end, place.end, record.header)
        return place

    def _records(self) -> Iterator[tuple[Record, _Place]]:
        """Yield the records that were not looked at, each with its place."""
        segment: Path | None = self._place.segment
        start = self._place.end
        while segment is not None and segment.exists():
            for record, end in read_segment(segment, torn_end=True, start=start):
                yield record, _Place(segment, end, start, record.header)
                start = end
            start, following = 0, self._journal.segments()
            segment = next((path for path in following if path.name > segment.name), None)

    def _take_in(self) -> None:
        if not self._place.is_there():
            if not self._restart_from_snapshot(0):
                raise StoreError(
                    "the writer has taken back a commit that was read here, and has published no "
                    "snapshot to go on with; open the knowledge base again"
                )
            return
        last = self._writer.committer.last_seq
        records: list[Record] = []
        place = self._place
        for record, its_place in self._records():
            if record.header.get("partial") or record.seq != last + 1:
                self._apply(records, place)
                self._restart_from_snapshot(record.seq)
                return
            records.append(record)
            last, place = record.seq, its_place
        self._apply(records, place)

    def _apply(self, records: list[Record], place: _Place) -> None:
        if records:
            replay_all(self._store, records, self._merged)
            self._advance(records[-1].seq)
            self._writer.take_in([self._feed.read(record) for record in records])
        self._place = place

    def _restart_from_snapshot(self, at_least: int) -> bool:
        """Go on with the newest snapshot, if it has a commit; return whether it has."""
        taken = self._copy.take(at_least)
        if taken is None:
            return False
        path, seq = taken
        before, old = self._writer.committer.last_seq, self._store.path
        self._store.move(path)
        if old is not None:
            self._copy.discard(Path(old))
        self._store.tell(Writes(is_replacement=True))
        passed = [record for record, _ in self._records() if before < record.seq <= seq]
        self._advance(seq)
        self._place = self._place_of(seq)
        self._writer.take_in([self._feed.read(record) for record in passed])
        _log.info("went on with the snapshot after commit %d", seq)
        return True

    def _advance(self, seq: int) -> None:
        committer = self._writer.committer
        committer.last_seq = seq
        committer.catalogue.refresh()
        committer.last_time = committer.catalogue.last_time() or LONG_AGO
        if committer.inference is not None:
            committer.inference.take_in(None)

    def _run(self) -> None:
        outage = Outage(_log, "the writer's commits cannot be followed")
        while not self._closed.wait(_EVERY_S):
            try:
                self.look()
                outage.ended()
            except ClosedError:
                return
            except (RtaskError, OSError, RuntimeError) as error:
                outage.failed(error)

    def close(self) -> None:
        """Stop following."""
        self._closed.set()
        if self._thread is not threading.current_thread():
            self._thread.join()
