"""Queries in processes of their own: admission, deadlines, and what happens when a reader dies."""

from __future__ import annotations

import contextlib
import functools
import logging
import signal
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.errors import ClosedError, QueryTooExpensive, RtaskError
from rtask.kb.commit.budget import stopping
from rtask.kb.readers.keeper import ReaderGone, ReaderProcess
from rtask.kb.readers.line import ReaderLine
from rtask.kb.readers.places import Places, RefusedTexts, require_time
from rtask.kb.readers.request import Question, ReaderLimits
from rtask.kb.readers.streams import Deadlines, ReaderStream
from rtask.kb.readers.supply import ReaderSupply
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.writes import Writes
from rtask.sparql.query_cost import is_quick

__all__ = ["Readers"]

_log = logging.getLogger(__name__)
_KILLED = (None, -signal.SIGKILL, -signal.SIGTERM)


@dataclass(frozen=True)
class _Asked:
    """A message to a reader, and its description in errors."""

    payload: bytes
    text: str
    kind: bytes = b"Q"
    what: str = "query"
    is_quick: bool = True

    @property
    def message_kind(self) -> bytes:
        """Kind of the message, which tells a reader about queries that take long."""
        return self.kind if self.is_quick else b"S"


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
        self._store = store
        self._places = Places()
        self._supply = ReaderSupply(store, last_seq, folder, frozen, self._places)
        self._refused = RefusedTexts()
        self._deadlines = Deadlines()
        self._lock = threading.RLock()  # a forgotten answer may be collected inside a block
        self._running: weakref.WeakSet[ReaderStream] = weakref.WeakSet()
        self._lines: set[ReaderLine] = set()
        self._updates: weakref.WeakSet[ReaderStream] = weakref.WeakSet()
        self._is_stopping = False

    @property
    def limits(self) -> ReaderLimits:
        """Number of readers and the limits of each."""
        return self._places.limits

    @limits.setter
    def limits(self, limits: ReaderLimits) -> None:
        self._places.limits = limits

    @property
    def possible(self) -> bool:
        """Whether this system supports reader processes."""
        return self._supply.possible

    @property
    def evaluate_updates(self) -> bool:
        """Whether readers can evaluate updates, which requires a copy that they may change."""
        return self._supply.evaluate_updates

    def stored(self, writes: Writes) -> None:
        """Forward a commit to the replica; called by the writer after each commit, in order."""
        self._supply.stored(writes)

    def invalidate(self) -> None:
        """Discard the replica after a change outside a commit; the next query builds a new one."""
        self._supply.invalidate()

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
        quick = is_quick(question.text) if quick is None else quick
        asked = _Asked(question.encode(), question.text, is_quick=quick)
        self._refused.check(asked.kind, asked.text)
        leave = self._places.enter(not quick, at, timeout_s)
        try:
            stream = self._ask(asked, at, timeout_s, on_start)
        except BaseException:
            leave()
            raise
        stream.hold(leave)
        return stream

    def open_line(self) -> ReaderLine | None:
        """Take an idle reader for an event loop; ``None`` if there is none, or no place for one.

        The line counts as one query that runs, until it is closed.
        """
        leave = self._places.enter_now()
        if leave is None:
            return None
        reader = self._supply.take_now()
        if reader is None:
            leave()
            return None
        line: ReaderLine

        def close(is_reusable: bool) -> None:
            with self._lock:
                self._lines.discard(line)
            self._supply.give_back(reader, is_reusable)
            leave()

        line = ReaderLine(reader, close, leave)
        with self._lock:
            self._lines.add(line)
        return line

    def may_use(self, line: ReaderLine) -> bool:
        """Whether the reader of a line has every commit, and is fit for another query."""
        return line.is_sound and self._supply.is_current(line.reader)

    @property
    def is_in_demand(self) -> bool:
        """Whether threads wait for a place like that of a line, which is to be closed soon."""
        return self._places.is_in_demand

    def send(self, line: ReaderLine, payload: bytes, text: str) -> bool:
        """Send a query on a line without waiting; tell whether it was sent.

        The caller keeps the deadline, by :meth:`ReaderLine.kill`.

        Parameters
        ----------
        payload
            From :meth:`Question.encode`.

        Raises
        ------
        QueryTooExpensive
            The same text ended a reader lately.
        """
        self._refused.check(b"Q", text)
        with self._store.complete_now() as is_complete:
            if not is_complete:
                return False
            if line.reader.ask_now(payload):
                return True
        line.is_sound = (
            False  # it has ended, or has so much to catch up with that another is faster
        )
        return False

    def continue_line(self, line: ReaderLine, text: str, is_last: bool) -> ReaderStream:
        """Return the answer in front of a line, which has turned out to be long, as a stream.

        Parameters
        ----------
        is_last
            Whether nothing else was asked on the line, so that the reader can be reused.
        """
        asked = _Asked(b"", text)
        crash = functools.partial(self._too_expensive, asked)
        read_ahead = line.detach()

        def done(reader: ReaderProcess, is_reusable: bool) -> None:
            self._supply.give_back(reader, is_reusable and is_last)

        stream = ReaderStream(
            line.reader, text, None, done, crash, self._deadlines, read_ahead=read_ahead
        )
        stream.hold(line.leave)
        with self._lock:
            self._lines.discard(line)
            self._running.add(stream)
        return stream

    @property
    def may_ask_now(self) -> bool:
        """Whether a query can be sent without completing the store first."""
        return self._store.is_complete

    @property
    def changes(self) -> int:
        """Number that grows with each change of the store, after the readers know of it."""
        return self._supply.changes

    def evaluate_update(
        self,
        text: str,
        order: bytes,
        timeout_s: float,
        limit_s: float,
        who: str | None = None,
    ) -> tuple[bytes, Callable[[], bool]]:
        """Return the change that an update makes, and whether its reader's copy is still in use.

        Parameters
        ----------
        order
            From :meth:`rtask.kb.readers.updating.UpdateOrder.encode`.
        timeout_s, limit_s
            Remaining time, and the time limit to report in the error.
        who
            The author, who leaves a place to others; see :meth:`Places.enter`.

        Raises
        ------
        QueryTimeout, QueryTooExpensive, BusyError
            As :meth:`ask`.
        RtaskError
            The update is not valid or not allowed.
        """
        at = time.monotonic() + timeout_s
        asked = _Asked(order, text, b"U", "update")
        self._refused.check(asked.kind, asked.text)
        leave = self._places.enter(True, at, limit_s, update=True, who=who)
        try:
            stream = self._ask(asked, at, limit_s, self._begin_update)
        except ClosedError:
            leave()
            raise self._stopped() from None
        except BaseException:
            leave()
            raise
        stream.hold(leave)
        keeper = stream.reader.keeper
        try:
            with stream:
                return stream.read(), lambda: self._supply.is_replica(keeper)
        except ClosedError:
            raise self._stopped() from None

    def _stopped(self) -> RtaskError:
        if self._is_stopping:
            return stopping()
        return ClosedError("the knowledge base is closed")

    def _begin_update(self, stream: ReaderStream) -> None:
        with self._lock:
            self._updates.add(stream)
        if self._is_stopping:
            stream.close()

    def stop_updates(self) -> None:
        """End the evaluation of updates, now and later; they are refused, and stored nothing."""
        self._places.refuse_updates()
        with self._lock:
            self._is_stopping = True
            running = list(self._updates)
        for stream in running:
            stream.close()

    def _ask(
        self,
        asked: _Asked,
        at: float | None,
        timeout_s: float | None,
        on_start: Callable[[ReaderStream], None] | None,
    ) -> ReaderStream:
        # Until the reader has the question, it gets every commit complete, before the question.
        with self._store.complete():
            return self._send(asked, at, timeout_s, on_start)

    def _send(
        self,
        asked: _Asked,
        at: float | None,
        timeout_s: float | None,
        on_start: Callable[[ReaderStream], None] | None,
    ) -> ReaderStream:
        for attempt in (1, 2):
            try:
                reader = self._supply.take(at, asked.kind == b"U")
            except ReaderGone:
                require_time(at, timeout_s)
                if attempt == 2:
                    raise
                continue
            crash = functools.partial(self._too_expensive, asked)
            stream = ReaderStream(
                reader,
                asked.text,
                timeout_s,
                self._supply.give_back,
                crash,
                self._deadlines,
                asked.what,
            )
            try:
                # Half of the time, so that a second reader can answer if this one does not read.
                now = time.monotonic()
                until = at if at is None or attempt == 2 else now + (at - now) / 2
                reader.ask(asked.payload, asked.message_kind, until)
                with self._lock:
                    self._running.add(stream)
                if at is not None:
                    self._deadlines.add(at, stream)
                if on_start is not None:
                    on_start(stream)
                stream.start()
            except ReaderGone:
                stream.abandon()
                if attempt == 1 and (reader.keeper.failed or not self._crashed(reader)):
                    continue  # killed from outside before answering anything, or too slow
                if reader.exit_code in _KILLED:
                    require_time(at, timeout_s)
                raise crash(reader) from None
            else:
                return stream
        raise AssertionError("the second attempt returns or raises")

    def _crashed(self, reader: ReaderProcess) -> bool:
        reader.ended.wait(2.0)
        return reader.exit_code not in _KILLED

    def _too_expensive(self, asked: _Asked, reader: ReaderProcess) -> QueryTooExpensive:
        reader.ended.wait(2.0)
        code = reader.exit_code
        how = "ended"
        if code is not None and code < 0:
            with contextlib.suppress(ValueError):
                how = f"was ended by {signal.Signals(-code).name}"
        reason = f"the request exceeds its memory limit or crashes the reader, which {how}"
        if code not in _KILLED:
            self._refused.add(asked.kind, asked.text, reason)
        _log.warning("%s", reason)
        return QueryTooExpensive(reason, exit_code=code)

    def start(self, wait: bool = True, updates: bool = False) -> None:
        """Start the processes now that the first query would otherwise start.

        Parameters
        ----------
        wait
            Whether to wait for the replica even where snapshots can serve in the meantime.
        updates
            Whether to prepare readers for updates, too.
        """
        self._supply.start(wait, updates)

    def stats(self) -> dict[str, Any]:
        """Return the kind, number and state of the readers, and counts of their queries."""
        kind, processes, idle = self._supply.processes()
        with self._lock:
            running = sum(not stream.is_over for stream in self._running) + len(self._lines)
        return {
            "kind": kind,
            "processes": processes,
            "running": running,
            "idle": idle,
            "waiting": self._places.waiting,
            "answered": self._supply.answered,
            "killed": self._supply.killed,
        }

    def close(self) -> None:
        """Stop every query and end every process."""
        self._supply.refuse()
        self._places.close()
        with self._lock:
            running, lines = list(self._running), list(self._lines)
        for stream in running:
            stream.close()
        for line in lines:
            line.close(is_reusable=False)
        self._deadlines.close()
        self._supply.close()
