"""Expiry: withdraw statements, as a commit, within a second of the end of their validity."""

from __future__ import annotations

import datetime as dt
import heapq
import logging
import threading
from collections.abc import Callable

from pyoxigraph import Quad

from rtask.errors import ClosedError, RtaskError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change, Request
from rtask.kb.commit.statements import INVALIDATED, REIFIES, VALID_UNTIL, stamp, when
from rtask.kb.commit.writer import Writer
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import Triple

__all__ = ["Expiry"]

_log = logging.getLogger(__name__)
# The wall clock may be set meanwhile, and a wait does not notice that.
_MAX_WAIT_S = 3_600.0
_MAX_EXPIRED = 10_000


class Expiry:
    """Withdraws the expired statements of one knowledge base, in a thread started when needed.

    Parameters
    ----------
    access
        The program's own rights.
    is_ours
        Tells whether expiry may change a graph.
    """

    def __init__(
        self, store: GraphStore, writer: Writer, access: Access, is_ours: Callable[[object], bool]
    ) -> None:
        self._store = store
        self._writer = writer
        self._access = access
        self._is_ours = is_ours
        self._changed = threading.Condition()
        self._heap: list[float] = []
        self._thread: threading.Thread | None = None
        self._closed = False

    def clock(self) -> dt.datetime:
        """Return the time by which statements expire."""
        return dt.datetime.now(dt.UTC)

    def start(self) -> None:
        """Read the expiry times in the store."""
        self._note(list(self._store.quads_for_pattern(None, VALID_UNTIL, None, None)))

    def announce(self, change: Change) -> None:
        """Record the expiry times in a commit."""
        self._note([quad for quad in change.added if quad.predicate == VALID_UNTIL])

    def _note(self, quads: list[Quad]) -> None:
        moments = [when(quad.object) for quad in quads if self._is_ours(quad.graph_name)]
        times = {moment.timestamp() for moment in moments if moment is not None}
        if not times:
            return
        with self._changed:
            # Many statements of a commit end at one moment, and those of the next often at the
            # same.
            for time in times - set(self._heap[:1]):
                heapq.heappush(self._heap, time)
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="rtask-expiry", daemon=True)
                self._thread.start()
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                if self._closed:
                    return
                now = self.clock().timestamp()
                if not self._heap or self._heap[0] > now:
                    wait = self._heap[0] - now if self._heap else _MAX_WAIT_S
                    self._changed.wait(min(wait, _MAX_WAIT_S))
                    continue
                while self._heap and self._heap[0] <= now:
                    heapq.heappop(self._heap)
            try:
                self.expire()
            except ClosedError:
                return
            except RtaskError:
                _log.exception("expired statements could not be withdrawn")

    def expire(self) -> int:
        """Withdraw expired statements in one commit; return how many."""
        now = self.clock()
        overlay = self._writer.begin()
        try:
            count = self._withdraw(overlay, now)
        except BaseException:
            self._writer.cancel()
            raise
        if not count:
            self._writer.cancel()
            return 0
        self._writer.finish(overlay, Request(self._access, note="expired", trusted=True))
        _log.info("%d statements have expired", count)
        return count

    def _withdraw(self, overlay: Overlay, now: dt.datetime) -> int:
        count = 0
        for quad in self._store.quads_for_pattern(None, VALID_UNTIL, None, None):
            until = when(quad.object)
            if until is None or until > now or not self._is_ours(quad.graph_name):
                continue
            graph, reifier = quad.graph_name, quad.subject
            for named in list(self._store.quads_for_pattern(reifier, REIFIES, None, graph)):
                triple = named.object
                if not isinstance(triple, Triple):
                    continue
                about = Quad(triple.subject, triple.predicate, triple.object, graph)
                # Somebody may have withdrawn it before: its annotations stay as the record of what
                # was.
                if about in self._store:
                    overlay.remove(about)
                    overlay.add(Quad(reifier, INVALIDATED, stamp(now), graph))
                    count += 1
            if count >= _MAX_EXPIRED:  # the rest in the next commit
                with self._changed:
                    heapq.heappush(self._heap, now.timestamp())
                break
        return count

    def close(self) -> None:
        """Stop the thread after its current commit."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        thread = self._thread
        # A subscriber to the last commit may close the knowledge base from this very thread.
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=10.0)
