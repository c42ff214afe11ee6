"""Pool of reader processes: assign queries, enforce deadlines and handle failures.

There are two kinds of readers: forks of a replica in memory, which follow each commit, and readers
that open a snapshot, used for stores too large for a replica and while the replica is being built.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.errors import (
    BusyError,
    ClosedError,
    QueryTimeout,
    QueryTooExpensive,
    UnsupportedError,
)
from rtask.kb.commit.apply import Writes
from rtask.kb.readers.keeper import CommitFrame, KeeperProcess, ReaderGone, ReaderProcess
from rtask.kb.readers.request import Question, ReaderLimits
from rtask.kb.readers.streams import Deadlines, ReaderStream
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.snapshots import Snapshot, Snapshots
from rtask.sparql.query_cost import is_quick

__all__ = ["ReaderLimits", "Readers"]

_log = logging.getLogger(__name__)
_REFUSE_S = 600.0
_HELLO_S = 60.0
_MAX_GROWTH = 256 << 20
_MAX_WAITING = 64 << 20
_SMALL = 50_000
_KILLED = (None, -signal.SIGKILL, -signal.SIGTERM)


@dataclass(frozen=True)
class _Asked:
    """A message to a reader, and its description in errors."""

    payload: bytes
    text: str
    kind: bytes = b"Q"
    what: str = "query"


class Readers:
    """Processes that answer the queries of one knowledge base; started by the first query.

    Parameters
    ----------
    store
        The quads.
    last_seq
        Number of the last commit.
    folder
        Folder of the knowledge base; ``None`` for one in memory.
    frozen
        Whether the store is never written while open.
    """

    def __init__(
        self,
        store: GraphStore,
        last_seq: Callable[[], int],
        folder: Path | None = None,
        frozen: bool = False,
    ) -> None:
        self.limits = ReaderLimits()
        self._store = store
        self._last_seq = last_seq
        self._snapshots: Snapshots | None = None
        if folder is not None:
            self._snapshots = Snapshots(store, folder, frozen, last_seq)
        self._changed = threading.Condition()
        self._starting = threading.Lock()
        self._replica: KeeperProcess | None = None
        self._opener: KeeperProcess | None = None
        self._idle: list[ReaderProcess] = []
        self._used: dict[int, Snapshot] = {}
        self._running: weakref.WeakSet[ReaderStream] = weakref.WeakSet()
        self._taken = self._heavy = self._updating = 0
        self._waiting = self._killed = self._answered = 0
        self._refused: dict[bytes, tuple[float, str]] = {}
        self._deadlines = Deadlines()
        self._closed = False
        self._possible = sys.platform != "win32" and hasattr(os, "fork") and bool(sys.executable)
        self._size = -1

    @property
    def possible(self) -> bool:
        """Whether this system supports reader processes."""
        return self._possible

    # Commits

    def stored(self, writes: Writes) -> None:
        """Forward a commit to the replica; called by the writer after each commit, in order."""
        replica = self._replica
        if replica is not None:
            replica.add(CommitFrame(writes))

    def invalidate(self) -> None:
        """Discard the replica after a change outside a commit; the next query builds a new one."""
        with self._changed:
            replica, self._replica = self._replica, None
            self._size = -1
            gone = [reader for reader in self._idle if reader.keeper is replica]
            self._idle = [reader for reader in self._idle if reader.keeper is not replica]
        if replica is not None:
            for reader in gone:
                reader.close()
            replica.retire()

    # Queries

    def ask(
        self,
        question: Question,
        timeout_s: float | None,
        on_start: Callable[[ReaderStream], None] | None = None,
        quick: bool | None = None,
    ) -> ReaderStream:
        """Return the answer when its first piece has arrived.

        Parameters
        ----------
        quick
            Whether the query may use a place reserved for quick queries; estimated from its text
            if not given.
        on_start
            Called with the answer when a reader starts on it; closing the answer stops the query
            even before its first piece.

        Raises
        ------
        QueryTimeout
            The time is up; it includes the wait for a reader.
        QueryTooExpensive
            The reader ran out of memory or crashed, now or recently with the same text.
        BusyError
            Too many queries are waiting.
        """
        at = None if timeout_s is None else time.monotonic() + timeout_s
        key = hashlib.sha256(question.text.encode()).digest()
        self._refuse_again(key)
        quick = is_quick(question.text) if quick is None else quick
        leave = self._enter(not quick, at, timeout_s)
        try:
            asked = _Asked(question.encode(), question.text)
            stream = self._ask(asked, at, timeout_s, key, on_start)
        except BaseException:
            leave()
            raise
        stream.hold(leave)
        return stream

    @property
    def evaluate_updates(self) -> bool:
        """Whether readers can evaluate updates, which requires a copy that they may change."""
        if not self._possible:
            return False
        if self._snapshots is None:
            return True
        if self._snapshots.frozen:
            return False
        if self._size < 0:
            self._size = len(self._store)
        return self._size <= self.limits.replica_max

    def evaluate_update(
        self, text: str, order: bytes, timeout_s: float, limit_s: float
    ) -> tuple[bytes, Callable[[], bool]]:
        """Return the change that an update makes, and whether its reader's copy is still in use.

        Parameters
        ----------
        order
            From :meth:`rtask.kb.readers.updating.UpdateOrder.encode`.
        timeout_s, limit_s
            Remaining time, and the time limit to report in the error.

        Raises
        ------
        QueryTimeout, QueryTooExpensive, BusyError
            As :meth:`ask`.
        RtaskError
            The update is not valid or not allowed.
        """
        at = time.monotonic() + timeout_s
        key = hashlib.sha256(b"update " + text.encode()).digest()
        self._refuse_again(key)
        leave = self._enter(True, at, limit_s, update=True)
        try:
            asked = _Asked(order, text, b"U", "update")
            stream = self._ask(asked, at, limit_s, key, None)
        except BaseException:
            leave()
            raise
        stream.hold(leave)
        keeper = stream.reader.keeper
        with stream:
            return stream.read(), lambda: self._replica is keeper

    def _ask(
        self,
        asked: _Asked,
        at: float | None,
        timeout_s: float | None,
        key: bytes,
        on_start: Callable[[ReaderStream], None] | None,
    ) -> ReaderStream:
        for attempt in (1, 2):
            try:
                reader = self._reader(at, asked.kind == b"U")
            except ReaderGone:
                _require_time(at, timeout_s)
                if attempt == 2:
                    raise
                continue
            crash = functools.partial(self._too_expensive, key)
            stream = ReaderStream(
                reader, asked.text, timeout_s, self._done, crash, self._deadlines, asked.what
            )
            try:
                reader.ask(asked.payload, asked.kind)
                with self._changed:
                    self._running.add(stream)
                if at is not None:
                    self._deadlines.add(at, stream)
                if on_start is not None:
                    on_start(stream)
                stream.start()
            except ReaderGone:
                stream.abandon()
                if attempt == 1 and (reader.keeper.failed or not self._crashed(reader)):
                    continue  # killed from outside before answering anything
                raise crash(reader) from None
            else:
                return stream
        raise AssertionError("the second attempt returns or raises")

    def _crashed(self, reader: ReaderProcess) -> bool:
        reader.ended.wait(2.0)
        return reader.exit_code not in _KILLED

    def _too_expensive(self, key: bytes, reader: ReaderProcess) -> QueryTooExpensive:
        reader.ended.wait(2.0)
        code = reader.exit_code
        how = "ended"
        if code is not None and code < 0:
            with contextlib.suppress(ValueError):
                how = f"was ended by {signal.Signals(-code).name}"
        reason = f"the request exceeds its memory limit or crashes the reader, which {how}"
        if code not in _KILLED:
            self._refused[key] = (time.monotonic() + _REFUSE_S, reason)
        _log.warning("%s", reason)
        return QueryTooExpensive(reason, exit_code=code)

    def _refuse_again(self, key: bytes) -> None:
        if key in self._refused:
            until, reason = self._refused[key]
            if time.monotonic() < until:
                raise QueryTooExpensive(reason + "; the same text is refused for ten minutes")
            del self._refused[key]

    def _enter(
        self, heavy: bool, at: float | None, timeout_s: float | None, update: bool = False
    ) -> Callable[[], None]:
        """Wait for a free place; return a function that releases it."""
        with self._changed:
            if not self._is_room(heavy, update) and self._waiting >= self.limits.queue:
                raise BusyError(f"too many queries are waiting ({self._waiting}); try again later")
            self._waiting += 1
            try:
                while not self._is_room(heavy, update) and not self._closed:
                    _require_time(at, timeout_s)
                    self._changed.wait(None if at is None else at - time.monotonic())
            finally:
                self._waiting -= 1
            if self._closed:
                raise ClosedError("the knowledge base is closed")
            self._taken += 1
            self._heavy += heavy
            self._updating += update
        return functools.partial(self._leave, heavy, update)

    def _is_room(self, heavy: bool, update: bool) -> bool:
        limits = self.limits
        if update and self._updating >= limits.updates:
            return False
        if heavy and self._heavy >= max(1, limits.count - limits.reserved):
            return False
        return self._taken < limits.count

    def _leave(self, heavy: bool, update: bool) -> None:
        with self._changed:
            self._taken -= 1
            self._heavy -= heavy
            self._updating -= update
            self._changed.notify_all()

    def _done(self, reader: ReaderProcess, reusable: bool) -> None:
        """Reuse or discard the reader of a query that has ended."""
        with self._changed:
            self._answered += 1
            keep = (
                reusable
                and not self._closed
                and not reader.killed
                and not reader.keeper.retired
                and not reader.keeper.failed
                and reader.grown_bytes < _MAX_GROWTH
                and reader.waiting_bytes < _MAX_WAITING
            )
            reader.busy = False
            if keep:
                self._idle.append(reader)
            elif reader.killed:
                self._killed += 1
        if not keep:
            self._discard(reader)
            self._replace(reader)

    def _replace(self, reader: ReaderProcess) -> None:
        """Fork a reader in advance, so that the next query need not wait for it."""
        with self._changed, contextlib.suppress(ReaderGone):
            current = self._replica is reader.keeper and not self._closed
            if current and not self._idle:
                self._idle.append(reader.keeper.fork())

    def _discard(self, reader: ReaderProcess) -> None:
        reader.close()
        snapshot = self._used.pop(id(reader), None)
        if snapshot is not None and self._snapshots is not None:
            self._snapshots.release(snapshot)

    # Processes

    def _reader(self, at: float | None, updates: bool = False) -> ReaderProcess:
        """Return a reader that has every commit stored so far."""
        replica = self._ready_replica(at, wait=updates)
        if updates:
            if replica is None:
                raise UnsupportedError("this store is too large to evaluate updates in a reader")
            replica.evaluates_updates = True
        reader = self._idle_reader(replica) or self._new_reader(replica)
        left = _HELLO_S if at is None else max(0.0, at - time.monotonic())
        try:
            reader.say_hello(left)
        except ReaderGone:
            self._discard(reader)
            raise
        return reader

    def _idle_reader(self, replica: KeeperProcess | None) -> ReaderProcess | None:
        stale: list[ReaderProcess] = []
        found = None
        seq = self._last_seq()
        with self._changed:
            for reader in reversed(list(self._idle)):
                fits = reader.keeper is replica if replica else reader.snapshot_seq == seq
                if reader.keeper.failed or reader.killed or not fits:
                    self._idle.remove(reader)
                    stale.append(reader)
                elif found is None:
                    found = reader
            if found is not None:
                self._idle.remove(found)
                found.busy = True
        for reader in stale:
            self._discard(reader)
        return found

    def _new_reader(self, replica: KeeperProcess | None) -> ReaderProcess:
        if replica is not None:
            reader = replica.fork()
            reader.busy = True
            return reader
        assert self._snapshots is not None
        with self._starting:
            if self._opener is None or self._opener.failed:
                if self._opener is not None:
                    self._opener.close()
                self._opener = KeeperProcess(None, self.limits.memory_bytes, _MAX_WAITING)
                self._opener.start()
        snapshot = self._snapshots.take(self._last_seq())
        try:
            reader = self._opener.fork(snapshot.path, snapshot.seq)
        except BaseException:
            self._snapshots.release(snapshot)
            raise
        self._used[id(reader)] = snapshot
        reader.busy = True
        return reader

    def _ready_replica(self, at: float | None, wait: bool = False) -> KeeperProcess | None:
        """Return the replica, waiting if asked to; ``None`` if a snapshot is to be read instead."""
        with self._starting:
            if self._closed:
                raise ClosedError("the knowledge base is closed")
            if self._snapshots is not None and self._snapshots.frozen:
                return None
            if self._size < 0:
                self._size = len(self._store)
            if self._snapshots is not None and self._size > self.limits.replica_max:
                return None
            replica = self._replica
            if replica is not None and replica.failed:
                replica.close()
                replica = None
            if replica is None:
                replica = KeeperProcess(self._store, self.limits.memory_bytes, _MAX_WAITING)
                self._replica = replica
                replica.start()
        if not replica.ready.is_set():
            if self._snapshots is not None and self._size > _SMALL and not wait:
                return None
            replica.ready.wait(None if at is None else max(0.0, at - time.monotonic()))
        return replica

    def start(self, wait: bool = True, updates: bool = False) -> None:
        """Start the processes now that the first query would otherwise start.

        Parameters
        ----------
        wait
            Whether to wait for the replica even where snapshots can serve in the meantime.
        updates
            Whether to prepare readers for updates, too.
        """
        replica = self._ready_replica(None, wait)
        if updates and replica is not None:
            replica.evaluates_updates = True
        reader = self._reader(time.monotonic() + _HELLO_S)
        with self._changed:
            reader.busy = False
            self._idle.append(reader)

    def stats(self) -> dict[str, Any]:
        """Return the kind, number and state of the readers, and counts of their queries."""
        with self._changed:
            keepers = [k for k in (self._replica, self._opener) if k is not None and not k.failed]
            kind = "none"
            if keepers:
                kind = "replica" if self._replica in keepers else "snapshot"
            return {
                "kind": kind,
                "processes": [keeper.process.pid for keeper in keepers]
                + [r.pid for keeper in keepers for r in keeper.readers if r.pid > 0],
                "running": sum(not stream.is_over for stream in self._running),
                "idle": len(self._idle),
                "waiting": self._waiting,
                "answered": self._answered,
                "killed": self._killed,
            }

    def close(self) -> None:
        """Stop every query and end every process."""
        with self._changed:
            self._closed = True
            running = list(self._running)
            self._changed.notify_all()
        for stream in running:
            stream.close()
        with self._starting:
            for reader in self._idle:
                self._discard(reader)
            self._idle.clear()
            for keeper in (self._replica, self._opener):
                if keeper is not None:
                    keeper.close()
        self._deadlines.close()
        if self._snapshots is not None:
            self._snapshots.close()


def _require_time(at: float | None, timeout_s: float | None) -> None:
    if at is not None and time.monotonic() >= at:
        raise QueryTimeout(
            f"the query did not end within {timeout_s:g} s, all of it spent waiting for a reader; "
            "try again later or allow more time",
            timeout_s=timeout_s,
        )
