"""Serialised writing: lock, commit, make durable and announce.

The lock is released before the journal is forced to disk, so that commits of several threads
share one fsync (early lock release, Johnson et al. 2010, "Aether"); a commit is acknowledged and
announced only after that, in the order of the commits.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator

from rtask.errors import ClosedError, UsageError
from rtask.kb.commit.commit import Change, Commit, Committer, Request
from rtask.kb.durability.recovery import Checkpoints
from rtask.kb.store.overlay import Overlay

__all__ = ["Writer"]

_log = logging.getLogger(__name__)
Listener = Callable[[Change], None]


class Writer:
    """Serialises the commits of one knowledge base.

    Parameters
    ----------
    committer
        Checks and stores changes.
    checkpoints
        Checkpoints of the folder; ``None`` for a store in memory.
    """

    def __init__(self, committer: Committer, checkpoints: Checkpoints | None = None) -> None:
        self.committer = committer
        self._checkpoints = checkpoints
        self._lock = threading.RLock()
        self._inside = False
        self._closed = False
        self._announcing = threading.RLock()
        self._unannounced: deque[Change] = deque()
        self._listeners: list[Listener] = []

    def begin(self) -> Overlay:
        """Take the lock and return an empty change."""
        self._lock.acquire()
        try:
            if self._closed:
                raise ClosedError("the knowledge base is closed or open for reading only")
            if self._inside:
                raise UsageError(
                    "this thread is inside a transaction; use the transaction's own add, remove "
                    "and update"
                )
        except BaseException:
            self._lock.release()
            raise
        self._inside = True
        return Overlay(self.committer.store)

    def cancel(self) -> None:
        """Discard the change and release the lock."""
        self._inside = False
        self._lock.release()

    def finish(self, overlay: Overlay, request: Request) -> Commit:
        """Store the change, release the lock, make it durable, announce it."""
        before = self.committer.last_seq
        try:
            change = self.committer.commit(overlay, request)
            if change.commit.seq > before:
                self._unannounced.append(change)
        finally:
            self.cancel()
        if change.commit.seq == before:
            return change.commit
        self.committer.journal.sync(change.commit.seq)
        self._announce(change.commit.seq)
        if self._checkpoints is not None and self._checkpoints.is_due():
            self._checkpoint(self._checkpoints)
        return change.commit

    def _checkpoint(self, checkpoints: Checkpoints) -> None:
        inference = self.committer.inference
        save: Callable[[], None] | None = None
        with self.exclusive():
            checkpoints.make(self.committer.last_seq)
            if inference is not None and inference.is_save_due():
                save = inference.prepare_save()
        if save is not None:
            save()

    @contextlib.contextmanager
    def exclusive(self) -> Iterator[None]:
        """Exclude writers, e.g. during a checkpoint."""
        with self._lock:
            if self._inside:
                raise UsageError("not possible inside a transaction; leave the with block first")
            yield

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` after each commit; return a function that stops this."""
        self._listeners.append(listener)

        def stop() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return stop

    def _announce(self, durable: int) -> None:
        with self._announcing:
            while self._unannounced and self._unannounced[0].commit.seq <= durable:
                change = self._unannounced.popleft()
                for listener in list(self._listeners):
                    try:
                        listener(change)
                    except Exception:  # noqa: BLE001 - a listener must not undo a stored commit
                        _log.exception("a listener failed on commit %d", change.commit.seq)

    def settle(self) -> None:
        """Store the notes of commits that wait, unless a commit was interrupted."""
        late = self.committer.late
        if late is not None and not self.committer.interrupted:
            late.try_flush()

    def close(self) -> None:
        """Wait for the current write and refuse further ones."""
        with self._lock:
            self._closed = True
