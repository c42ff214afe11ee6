"""Serialised writing: lock, commit, make durable and announce.

The lock is released before the journal is forced to disk, so that commits of several threads
share one fsync (early lock release, Johnson et al. 2010, "Aether"); a commit is acknowledged and
announced only after that, in the order of the commits.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from rtask.errors import (
    ClosedError,
    ForbiddenError,
    QueueFullError,
    RtaskError,
    UsageError,
)
from rtask.kb.commit.budget import return_memory
from rtask.kb.commit.commit import Change, Commit, RecentChanges, Request
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.foreign.supports import Support, support_of
from rtask.kb.commit.trials.derivation import (
    ContradictedTrialError,
    LongDerivationError,
    Trial,
    TrialDerivations,
)
from rtask.kb.durability.recovery import Checkpoints
from rtask.kb.store.commit_writes import MAX_LATE
from rtask.kb.store.overlay import Overlay

__all__ = ["Writer"]

_log = logging.getLogger(__name__)
_Made = TypeVar("_Made")
_GIVES_WAY_S, _LOOK_S = 1.0, 0.002
"""How long a large change waits at most for small ones, and how often it looks for them (s)."""
Listener = Callable[[Change], None]


class Writer:
    """Serialises the commits of one knowledge base.

    Parameters
    ----------
    committer
        Checks and stores changes.
    checkpoints
        Checkpoints of the folder; ``None`` for a store in memory.
    changes
        Class of the pending changes.

    Attributes
    ----------
    propose
        Keeps a change that was refused for lack of the right ``schema`` and returns its number, or
        ``None`` if such changes are not kept.
    recent
        Which graphs the last commits changed.
    follows
        Address of the process whose commits are taken in; nobody else may write then.
    refusal
        What is raised where the graph is open for reading only; ``None`` for the usual words.
    """

    def __init__(
        self,
        committer: Committer,
        checkpoints: Checkpoints | None = None,
        changes: type[Overlay] = Overlay,
    ) -> None:
        self.committer = committer
        self._changes = changes
        self._checkpoints = checkpoints
        self._lock = threading.RLock()
        self._large = threading.Lock()
        self._waiting_large: dict[int, float] = {}
        self._is_large, self._holder = False, 0
        self._inside = False
        self._closed = False
        self.recent = RecentChanges()
        self._aside: threading.Thread | None = None
        self.follows: str | None = None
        self.refusal: RtaskError | None = None
        self._announcing = threading.RLock()
        self._unannounced: deque[Change] = deque()
        self._listeners: list[Listener] = []
        self._waiting: dict[int, float] = {}
        self.propose: Callable[[Overlay, Request, str], int | None] | None = None
        inference = committer.inference
        self._trials = (
            None
            if inference is None
            else TrialDerivations(inference, self.exclusive, committer.stop)
        )

    def queue(self) -> tuple[int, float]:
        """Return how many threads wait to write, and for how long the first has waited (s)."""
        since = [*self._waiting.values(), *self._waiting_large.values()]
        return len(since), time.monotonic() - min(since) if since else 0.0

    def _acquire_after_small(self) -> None:
        """Take the lock for a large change: one of them at a time, and after small ones that wait.

        Whoever sends many large changes at once would else keep others waiting for all of them.
        """
        thread = threading.get_ident()
        self._waiting_large[thread] = time.monotonic()
        try:
            self._large.acquire()
        finally:
            del self._waiting_large[thread]
        try:
            until = time.monotonic() + _GIVES_WAY_S
            while self._waiting and time.monotonic() < until:
                time.sleep(_LOOK_S)
            self._acquire()
        except BaseException:
            self._large.release()
            raise

    def _acquire(self) -> None:
        # Without contention there is nothing to be counted.
        if self._lock.acquire(blocking=False):
            return
        thread = threading.get_ident()
        self._waiting[thread] = time.monotonic()
        try:
            self._lock.acquire()
        finally:
            del self._waiting[thread]

    def stop_deriving(self) -> None:
        """End the derivation under way, whose commit is refused, and any later one that is long."""
        self.committer.stop.set()

    def require_no_refusal(self) -> None:
        """Raise the reason why nothing is written, if one was given."""
        if self.refusal is not None:
            raise self._refusal()

    def _refusal(self) -> RtaskError:
        reason = self.refusal
        if reason is None:
            return ClosedError("the knowledge base is closed or open for reading only")
        return type(reason)(str(reason), **reason.details)  # each raised one has its own traceback

    def begin(self, size: int = 0) -> Overlay:
        """Take the lock and return an empty change.

        Parameters
        ----------
        size
            How many statements the change is known to have.
        """
        # A thread that writes already is told so below, instead of waiting for itself.
        is_large = size > MAX_LATE and self._holder != threading.get_ident()
        if is_large:
            self._acquire_after_small()
        else:
            self._acquire()
        try:
            if self._closed:
                raise self._refusal()
            if self.follows is not None:
                raise ForbiddenError(
                    f"this knowledge base follows {self.follows}; write there", operation="write"
                )
            if self._inside:
                raise UsageError(
                    "this thread is inside a transaction; use the transaction's own add, remove "
                    "and update"
                )
            self.committer.store.begin_change()
        except BaseException:
            self._lock.release()
            if is_large:
                self._large.release()
            raise
        self._inside, self._is_large, self._holder = True, is_large, threading.get_ident()
        return self._changes(self.committer.store)

    def cancel(self) -> None:
        """Discard the change and release the lock."""
        self.committer.store.end_change()
        was_large = self._is_large
        self._inside, self._is_large, self._holder = False, False, 0
        self._lock.release()
        if was_large:
            self._large.release()

    def finish(self, overlay: Overlay, request: Request) -> Commit:
        """Store the change, release the lock, make it durable, announce it."""
        before = self.committer.last_seq
        try:
            change = self._commit(overlay, request)
            if change.commit.seq > before:
                self.recent.note(change)
                self._unannounced.append(change)
        finally:
            self.cancel()
        # Nothing changed, so there is nothing to wait for.
        if change.commit.seq == before:
            return change.commit
        # After the lock was released: several commits share one call to the disk.
        self.committer.journal.sync(change.commit.seq)
        self._announce(change.commit.seq)
        self.checkpoint_if_due()
        return change.commit

    def commit(self, make: Callable[[Overlay], object], request: Request) -> Commit:
        """Store the change that a function makes, without keeping others waiting for long.

        Parameters
        ----------
        make
            Fills an empty change. It is called again if only a trial, during which others may
            write, shows whether more follows from the change than may.
        """
        return self.commit_repeatably(lambda again, _: self._made(make, again), request)

    def commit_repeatably(
        self, commit: Callable[[Request, Trial | None], _Made], request: Request
    ) -> _Made:
        """Make or rehearse a commit that can be made again; others do not wait for it for long.

        Parameters
        ----------
        commit
            Makes the commit for a request, or rehearses it. It is called again if only a trial,
            during which others may write, shows what follows from the change; then with the trial,
            which is to catch up before the lock is taken.
        """
        try:
            return commit(replace(request, is_repeatable=True), None)
        except LongDerivationError as error:
            change = error
        try:
            return self._commit_tried(commit, request, change)
        except ContradictedTrialError as error:
            clashes, causes, before = error.contradictions, error.causes, error.supports
        supports = tuple(dict.fromkeys((*before, *map(support_of, clashes))))
        if len(supports) == len(request.supports) or not self._gives_way(supports, request):
            raise self._contradicted(clashes, causes, request)
        return self.commit_repeatably(commit, replace(request, supports=supports))

    def _gives_way(self, supports: Sequence[Support], request: Request) -> bool:
        with self.exclusive():
            return self.committer.gives_way(supports, request)

    def _contradicted(
        self, clashes: Sequence[Any], causes: Sequence[Any], request: Request
    ) -> Exception:
        with self.exclusive():
            return self.committer.contradicted(clashes, causes, request)

    def _commit_tried(
        self,
        commit: Callable[[Request, Trial | None], _Made],
        request: Request,
        change: LongDerivationError,
    ) -> _Made:
        """Make a commit with what a trial derives from it."""
        request = replace(request, supports=change.supports)
        assert self._trials is not None
        try:
            with self._trials.tried(change, request.access.agent) as trial:
                # Where the copy is of no use a second one would not be either.
                again = replace(request, trial=trial, is_repeatable=trial.is_of_use)
                return commit(again, trial)
        except LongDerivationError as error:
            change = error
        finally:
            return_memory()
        with self._trials.tried(change, request.access.agent) as trial:
            done = commit(replace(request, trial=trial), trial)
        return_memory()
        return done

    def _made(self, make: Callable[[Overlay], object], request: Request) -> Commit:
        size = request.size
        overlay = self.begin(size)
        try:
            make(overlay)
        except BaseException:
            self.cancel()
            raise
        return self.finish(overlay, request)

    def _commit(self, overlay: Overlay, request: Request) -> Change:
        try:
            return self.committer.commit(overlay, request)
        except ForbiddenError as error:
            if error.details.get("right") != "schema" or self.propose is None:
                raise
            try:
                number = self.propose(overlay, request, str(error))
            except QueueFullError as full:
                # What was refused is said first: to wait would not make it allowed.
                raise ForbiddenError(
                    f"{error}. The change is not kept as a proposal either: {full}",
                    **error.details,
                ) from error
            if number is None:
                raise
            raise ForbiddenError(
                f"{error}. The change is kept as proposal {number}, without effect until an "
                "operator adopts it",
                **error.details,
                proposal=number,
            ) from error

    def checkpoint_if_due(self) -> None:
        """Make a checkpoint if the last one is old or the journal has grown much."""
        if self._checkpoints is not None and self._checkpoints.is_due():
            self._checkpoint_aside(self._checkpoints)

    def _checkpoint_aside(self, checkpoints: Checkpoints) -> None:
        """Begin a checkpoint in a thread of its own, unless one is under way or this is closed.

        Nobody waits for what is written to disk before the lock is taken.
        """
        with self._lock:
            if self._closed or (self._aside is not None and self._aside.is_alive()):
                return
            checkpoints.postpone()
            self._aside = threading.Thread(
                target=self._checkpoint, args=(checkpoints,), name="rtask-checkpoint"
            )
            self._aside.start()

    def _checkpoint(self, checkpoints: Checkpoints) -> None:
        inference = self.committer.inference
        save: Callable[[], None] | None = None
        try:
            checkpoints.write_ahead()
            with self._lock:
                checkpoints.make(self.committer.last_seq)
            with self._lock:
                if inference is not None and inference.is_save_due():
                    save = inference.prepare_save()
            if save is not None:
                save()
        except (RtaskError, OSError, RuntimeError) as error:
            # The journal holds all that the checkpoint would have made durable.
            _log.warning("a checkpoint failed and will be tried again: %s", error)

    @contextlib.contextmanager
    def exclusive(self) -> Iterator[None]:
        """Exclude writers, e.g. during a checkpoint."""
        self._acquire()
        try:
            if self._inside:
                raise UsageError("not possible inside a transaction; leave the with block first")
            yield
        finally:
            self._lock.release()

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` after each commit; return a function that stops this."""
        self._listeners.append(listener)

        def stop() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return stop

    def take_in(self, changes: Iterable[Change]) -> None:
        """Announce commits of another process, with the next of this one or :meth:`announce`."""
        self._unannounced.extend(changes)

    def announce(self) -> None:
        """Announce the commits that have been taken in."""
        self._announce(self.committer.last_seq)

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
        """Wait for the current write and checkpoint, and refuse further ones."""
        with self._lock:
            self._closed = True
            aside = self._aside
        if aside is not None:
            aside.join()
