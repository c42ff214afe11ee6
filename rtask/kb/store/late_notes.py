"""Notes of commits that reach the store late: one step for many commits, before anybody can look.

A commit's own statements are stored at once. Its notes, the activity and the numbers of the
catalogue, are in the journal with it, and wait here until a read might see them, until there are
many, or until there is a pause. Whoever begins a read announces it first: the notes that wait are
then stored, and commits store theirs at once until the read has begun. So no read can tell.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager

from rtask.errors import RtaskError
from rtask.kb.store.apply import apply
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import NetChange, Overlay
from rtask.kb.store.union import union_change
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DEFAULT, GraphName

__all__ = ["LateNotes"]

_log = logging.getLogger(__name__)
_MAX_COMMITS = 256
_REST_S = 0.2
"""Pause (s) after which notes are stored, so that the next read does not wait for them."""
_MAX_DRAIN_S = 2.0
"""Longest wait (s) for reads under way; a question on its way to a reader counts as one."""


class LateNotes:
    """Notes that wait to be stored, and the gate through which reads begin.

    Parameters
    ----------
    store
        The quads; its reads go through this gate from now on.
    meta, provenance
        The graphs of the notes.
    """

    def __init__(self, store: GraphStore, meta: GraphName, provenance: GraphName) -> None:
        self._store = store
        self._provenance = provenance
        self._graphs = frozenset({meta, provenance, DEFAULT})
        self._is_excluding = False
        self._waiting = NetChange()
        self._commits = 0
        self._last = 0.0
        self._quiet = threading.local()
        self._readers = 0
        self._was_read = False
        self._is_behind = False
        self._gate = threading.Condition()
        self._storing = threading.RLock()
        self._rest: threading.Thread | None = None
        store.gate = self

    @property
    def is_behind(self) -> bool:
        """Whether notes wait, so that the next read stores them first."""
        return self._is_behind

    # Reading

    def concerns(self, graph: GraphName) -> bool:
        """Whether the content of a graph may not be complete."""
        return self._is_excluding or graph in self._graphs

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Begin a read in this block: every note of every commit is in the store meanwhile."""
        # This very thread is about to store them: to wait for itself would be for ever.
        if getattr(self._quiet, "is_on", False):
            yield
            return
        with self._gate:
            self._readers += 1
            self._was_read = True
            is_behind = self._is_behind
        try:
            if is_behind:
                self.try_flush()
            yield
        finally:
            self.leave()

    @contextlib.contextmanager
    def excluding(self) -> Iterator[None]:
        """Let no read begin in the block; wait for those that are about to begin."""
        with self._storing:
            with self._gate:
                self._is_excluding = self._is_behind = True
                # Bounded: a reader that was killed between question and answer would never leave.
                self._gate.wait_for(lambda: not self._readers, _MAX_DRAIN_S)
            try:
                yield
            finally:
                with self._gate:
                    self._is_excluding = False

    def reading_now(self) -> AbstractContextManager[bool]:
        """Begin a read in this block if that needs no waiting; give whether it may begin."""
        return _ReadingNow(self)

    def enter_now(self) -> bool:
        """Begin a read if that needs no waiting; tell whether it may begin."""
        with self._gate:
            self._was_read = True
            may_begin = not self._is_behind
            self._readers += may_begin
            return may_begin

    def leave(self) -> None:
        """End the beginning of a read."""
        with self._gate:
            self._readers -= 1
            if not self._readers and self._is_excluding:
                self._gate.notify_all()

    @contextlib.contextmanager
    def quiet(self) -> Iterator[None]:
        """Let this thread read in the block without waiting notes, which do not concern it."""
        before = getattr(self._quiet, "is_on", False)
        self._quiet.is_on = True
        try:
            yield
        finally:
            self._quiet.is_on = before

    # Writing

    @contextlib.contextmanager
    def storing(self, may_wait: bool) -> Iterator[bool]:
        """Store a commit in this block; yield whether its notes are to be given to :meth:`add`.

        Parameters
        ----------
        may_wait
            Whether the commit is small and of the common kind. Others store their notes at once,
            after those that wait.
        """
        with self._storing:
            with self._gate:
                # Where reads and commits alternate, one step for both costs less than two.
                is_late = may_wait and not self._readers and not self._was_read
                self._was_read = False
                if is_late:
                    self._is_behind = True
            if not is_late:
                # A commit at once must not overtake notes of the ones before it.
                self.flush()
            yield is_late

    def add(self, notes: Overlay) -> None:
        """Let the notes of a commit wait, inside the block of :meth:`storing`."""
        self._waiting.join(notes)
        self._commits += 1
        self._last = time.monotonic()
        if self._commits >= _MAX_COMMITS:
            self.try_flush()
        elif self._rest is None:
            self._rest = threading.Thread(
                target=_flush_at_rest, args=(weakref.ref(self),), name="rtask-notes", daemon=True
            )
            self._rest.start()

    def flush(self) -> None:
        """Store the notes that wait."""
        with self._storing:
            waiting = self._waiting
            if waiting.removed or waiting.added:
                union = Overlay(self._store)
                with self.quiet():
                    if not self._store.is_view:
                        union = union_change(
                            self._store, waiting.removed, waiting.added, (self._provenance,)
                        )
                    # Every read that begins waits for this: see `reading` and `storing`.
                    apply(
                        self._store,
                        Writes(
                            [*waiting.removed, *union.removed],
                            [*waiting.added, *union.added],
                            is_unseen=True,
                        ),
                    )
            self._waiting, self._commits = NetChange(), 0
            with self._gate:
                self._is_behind = False

    def try_flush(self) -> None:
        """Store the notes; if that fails, they go on waiting: the commits themselves are stored."""
        try:
            self.flush()
        except (RtaskError, RuntimeError, OSError) as error:
            if "No space left" in str(error):
                self._store.is_stuck = True
            _log.warning("notes of commits are in the journal, but could not be stored: %s", error)

    def rested(self) -> bool:
        """Store what waits if there was no commit for a while; tell whether nothing waits now."""
        if time.monotonic() - self._last < _REST_S:
            return False
        with self._storing:
            # Asked again, now that no commit can come between.
            if time.monotonic() - self._last < _REST_S:
                return False
            if self._store.is_open:
                self.try_flush()
            self._rest = None
            return True


class _ReadingNow:
    """The block of :meth:`LateNotes.reading_now`; queries of event loops enter many."""

    __slots__ = ("_may_begin", "_notes")

    def __init__(self, notes: LateNotes) -> None:
        self._notes = notes

    def __enter__(self) -> bool:
        self._may_begin = self._notes.enter_now()
        return self._may_begin

    def __exit__(self, *_: object) -> None:
        if self._may_begin:
            self._notes.leave()


def _flush_at_rest(reference: weakref.ref[LateNotes]) -> None:
    while True:
        time.sleep(_REST_S)
        # A weak reference, so that a closed knowledge base is not kept alive by its own pause.
        notes = reference()
        if notes is None or notes.rested():
            return
        del notes
