"""The reader processes of one knowledge base: started, kept current, reused and discarded.

There are two kinds of readers: forks of a replica in memory, which follow each commit, and readers
that open a snapshot, used for stores too large for a replica and while the replica is being built.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from rtask.errors import ClosedError, UnsupportedError
from rtask.kb.readers.frames import CommitFrame
from rtask.kb.readers.keeper import KeeperProcess, ReaderGone, ReaderProcess
from rtask.kb.readers.places import Places
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.snapshots import Snapshot, Snapshots
from rtask.kb.store.writes import Writes

__all__ = ["ReaderSupply"]

_HELLO_S = 60.0
_MAX_GROWTH = 256 << 20
_MAX_WAITING = 64 << 20
_SMALL = 50_000


class ReaderSupply:
    """Hands out readers that have every commit, and takes them back.

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
    places
        Source of the limits, which may be replaced at any time.
    """

    def __init__(
        self,
        store: GraphStore,
        last_seq: Callable[[], int],
        folder: Path | None,
        frozen: bool,
        places: Places,
    ) -> None:
        self._store = store
        self._last_seq = last_seq
        self._places = places
        self._snapshots: Snapshots | None = None
        if folder is not None:
            self._snapshots = Snapshots(store, folder, frozen, last_seq)
        # Reentrant: a forgotten answer may be collected, and give its reader back, inside a block.
        self._lock = threading.RLock()
        self._starting = threading.Lock()
        self._replica: KeeperProcess | None = None
        self._opener: KeeperProcess | None = None
        self._idle: list[ReaderProcess] = []
        self._used: dict[int, Snapshot] = {}
        self._closed = False
        self._size = -1
        self.possible = (
            isinstance(store, EmbeddedStore)
            and sys.platform != "win32"
            and hasattr(os, "fork")
            and bool(sys.executable)
        )
        self.killed = self.answered = self.changes = 0

    def stored(self, writes: Writes) -> None:
        """Forward a commit to the replica; called by the writer after each commit, in order."""
        if writes.is_replacement:
            self.invalidate()
            return
        replica = self._replica
        if replica is not None:
            replica.add(CommitFrame(writes))
        # Only now, so that an answer remembered under this number contains the commit.
        self.changes += 1

    def invalidate(self) -> None:
        """Discard the replica after a change outside a commit; the next query builds a new one."""
        with self._lock:
            replica, self._replica = self._replica, None
            self._size = -1
            gone = [reader for reader in self._idle if reader.keeper is replica]
            self._idle = [reader for reader in self._idle if reader.keeper is not replica]
        if replica is not None:
            for reader in gone:
                reader.close()
            replica.retire()
        self.changes += 1

    @property
    def evaluate_updates(self) -> bool:
        """Whether readers can evaluate updates, which requires a copy that they may change."""
        if not self.possible:
            return False
        if self._snapshots is None:
            return True
        if self._snapshots.frozen:
            return False
        if self._size < 0:
            self._size = len(self._store)
        return self._size <= self._places.limits.replica_max

    def is_replica(self, keeper: KeeperProcess) -> bool:
        """Whether a keeper still holds the current copy of the store."""
        return self._replica is keeper

    def give_back(self, reader: ReaderProcess, reusable: bool) -> None:
        """Reuse or discard the reader of a query that has ended."""
        with self._lock:
            self.answered += 1
            keep = (
                reusable
                and not self._closed
                and not reader.killed
                and not reader.keeper.retired
                and not reader.keeper.failed
                and self._is_small(reader)
            )
            reader.busy = False
            if keep:
                self._idle.append(reader)
            elif reader.killed:
                self.killed += 1
        if not keep:
            self._discard(reader)
            self._replace(reader)

    def _replace(self, reader: ReaderProcess) -> None:
        """Fork a reader in advance, so that the next query need not wait for it."""
        with self._lock, contextlib.suppress(ReaderGone):
            current = self._replica is reader.keeper and not self._closed
            if current and not self._idle:
                self._idle.append(reader.keeper.fork())

    def _discard(self, reader: ReaderProcess) -> None:
        reader.close()
        snapshot = self._used.pop(id(reader), None)
        if snapshot is not None and self._snapshots is not None:
            self._snapshots.release(snapshot)

    def take(self, at: float | None, updates: bool = False) -> ReaderProcess:
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

    def take_now(self) -> ReaderProcess | None:
        """Return an idle reader that has every commit stored so far; ``None`` if there is none."""
        with self._lock:
            for at in reversed(range(len(self._idle))):
                reader = self._idle[at]
                if reader.pid > 0 and self.is_current(reader):
                    del self._idle[at]
                    reader.busy = True
                    return reader
        return None

    def is_current(self, reader: ReaderProcess) -> bool:
        """Whether a reader has every commit stored so far, and is worth using again."""
        keeper = reader.keeper
        if keeper is not self._replica and reader.snapshot_seq != self._last_seq():
            return False
        return not (reader.is_gone or keeper.failed) and self._is_small(reader)

    @staticmethod
    def _is_small(reader: ReaderProcess) -> bool:
        return reader.grown_bytes < _MAX_GROWTH and reader.waiting_bytes < _MAX_WAITING

    def _idle_reader(self, replica: KeeperProcess | None) -> ReaderProcess | None:
        stale: list[ReaderProcess] = []
        idle = None
        seq = self._last_seq()
        with self._lock:
            for reader in reversed(list(self._idle)):
                fits = reader.keeper is replica if replica else reader.snapshot_seq == seq
                if reader.keeper.failed or reader.is_gone or not fits:
                    self._idle.remove(reader)
                    stale.append(reader)
                elif idle is None:
                    idle = reader
            if idle is not None:
                self._idle.remove(idle)
                idle.busy = True
        for reader in stale:
            self._discard(reader)
        return idle

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
                self._opener = KeeperProcess(None, self._places.limits.memory_bytes, _MAX_WAITING)
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
            if self._snapshots is not None and self._size > self._places.limits.replica_max:
                return None
            replica = self._replica
            if replica is not None and replica.failed:
                replica.close()
                replica = None
            if replica is None:
                replica = KeeperProcess(self._store, self._places.limits.memory_bytes, _MAX_WAITING)
                self._replica = replica
                replica.start()
        if not replica.ready.is_set():
            if self._snapshots is not None and self._size > _SMALL and not wait:
                return None
            replica.ready.wait(None if at is None else max(0.0, at - time.monotonic()))
        return replica

    def start(self, wait: bool = True, updates: bool = False, count: int = 1) -> None:
        """Start the processes now that the first query would otherwise start.

        Parameters
        ----------
        wait
            Whether to wait for the replica even where snapshots can serve in the meantime.
        updates
            Whether to prepare readers for updates, too.
        count
            Number of readers to start.
        """
        replica = self._ready_replica(None, wait)
        if updates and replica is not None:
            replica.evaluates_updates = True
        readers = [self.take(time.monotonic() + _HELLO_S) for _ in range(count)]
        with self._lock:
            for reader in readers:
                reader.busy = False
                self._idle.append(reader)

    def processes(self) -> tuple[str, list[int], int]:
        """Return the kind of the readers, the process ids, and how many readers are idle."""
        with self._lock:
            keepers = [k for k in (self._replica, self._opener) if k is not None and not k.failed]
            kind = "none"
            if keepers:
                kind = "replica" if self._replica in keepers else "snapshot"
            pids = [keeper.process.pid for keeper in keepers]
            pids += [r.pid for keeper in keepers for r in keeper.readers if r.pid > 0]
            return kind, pids, len(self._idle)

    def refuse(self) -> None:
        """Keep no reader from now on, because the knowledge base is being closed."""
        with self._lock:
            self._closed = True

    def close(self) -> None:
        """End every process; no query may be running."""
        with self._starting:
            for reader in self._idle:
                self._discard(reader)
            self._idle.clear()
            for keeper in (self._replica, self._opener):
                if keeper is not None:
                    keeper.close()
        if self._snapshots is not None:
            self._snapshots.close()
