"""Point queries on the event loop: sent to a reader's socket, awaited at its pipe, without threads.

A thread for each query would spend more time waiting and waking than the query takes. A query goes
to a reader that is busy with others, if these take no time, so that few processes are woken; one
that turns out to take longer holds nobody up, for those behind it are asked of another reader.
Queries that find no reader wait here for one, not for long; then a thread takes over, which may
wait, and which starts another reader where there are too few.
"""

from __future__ import annotations

import asyncio
import enum
import logging
from collections import deque
from collections.abc import Callable

from endpoint.sparql.answers import QUICK_S
from rtask.errors import ClosedError, RtaskError
from rtask.kb.readers.line import Answer, ReaderLine
from rtask.kb.readers.pool import Readers
from rtask.kb.readers.streams import ReaderStream
from rtask.sparql.slow_shapes import SlowShapes

__all__ = ["Instead", "PointLines", "PointQuery"]

_log = logging.getLogger(__name__)
TICK_S = 0.02
FRESH_S = 0.003  # a query behind one that has taken longer so far goes to another reader
STALL_S = 0.02
IDLE_S = 0.05
WAIT_S = 0.1
_MAX_WAITING = 256
_MAX_IN_LINE = 32
_MAX_BYTES = 32 << 10  # of queries in one line: a socket takes them without waiting
MAX_ATTEMPTS = 3


class Instead(enum.Enum):
    """Instruction for a query that was not answered here."""

    ASK_IN_THREAD = enum.auto()
    ASK_AMONG_LONG = enum.auto()
    """It takes longer than it looked."""


OnAnswer = Callable[[Answer | ReaderStream | Instead], None]


class PointQuery:
    """A query on its way.

    Parameters
    ----------
    payload
        As it is sent to a reader.
    text
        SPARQL.
    on_answer
        Called once: with the whole answer; with a stream, whose first pieces have come; or with
        what to do instead.
    """

    __slots__ = ("attempts", "line", "on_answer", "payload", "since", "text")

    def __init__(self, payload: bytes, text: str, on_answer: OnAnswer) -> None:
        self.payload = payload
        self.text = text
        self.on_answer: OnAnswer | None = on_answer
        self.line: _Line | None = None  # from which its answer is expected
        self.attempts = 0
        self.since = 0.0

    def answer(self, outcome: Answer | ReaderStream | Instead) -> None:
        """Pass on what was found; a fault of one request must not concern the others."""
        on_answer, self.on_answer = self.on_answer, None
        if on_answer is not None:
            try:
                on_answer(outcome)
            except Exception:  # noqa: BLE001 - whatever it is, the others get their answers
                _log.exception("a point query could not be answered")

    def give_up(self) -> None:
        """Expect no answer any more; a thread finds out why."""
        self.answer(Instead.ASK_IN_THREAD)


class _Line:
    """A reader and the queries it was asked, the oldest in front."""

    __slots__ = ("bytes", "is_stalled", "queries", "reader", "since")

    def __init__(self, reader: ReaderLine) -> None:
        self.reader = reader
        self.queries: deque[PointQuery] = deque()
        self.bytes = 0
        self.since = 0.0  # when the query in front came there, or when the last one was answered
        self.is_stalled = False

    def has_room(self, size: int, now: float) -> bool:
        """Whether another query may stand in line, behind some that take no time."""
        return (
            not self.is_stalled
            and now - self.since <= FRESH_S
            and len(self.queries) < _MAX_IN_LINE
            and self.bytes + size <= _MAX_BYTES
        )

    def take_over(self) -> list[PointQuery]:
        """Return the queries that wait behind the one in front, which are asked elsewhere now."""
        behind = [query for query in list(self.queries)[1:] if query.line is self]
        for query in behind:
            query.line = None
        return behind


class PointLines:
    """Asks readers point queries; its methods are for the event loop's thread.

    Parameters
    ----------
    readers
        The readers; none if the graph is stored elsewhere, so that threads do all the work.
    start_reader
        Starts a reader in the background.
    slow
        Takes note of queries that took longer than they looked.
    """

    def __init__(
        self, readers: Readers | None, start_reader: Callable[[], None], slow: SlowShapes
    ) -> None:
        self._readers = readers
        self._slow = slow
        self._start_reader = start_reader
        self._lines: list[_Line] = []
        self._waiting: deque[PointQuery] = deque()
        self._timer: asyncio.TimerHandle | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    def ask(self, query: PointQuery) -> None:
        """Send a query as soon as a reader can take it."""
        readers = self._readers
        if readers is None or not readers.may_ask_now or len(self._waiting) >= _MAX_WAITING:
            query.answer(Instead.ASK_IN_THREAD)
            return
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
        query.since = now = self._loop.time()
        if self._waiting or not self._try(readers, query, now):
            if not self._lines:  # nobody will give a reader back soon
                self._start_reader()
                query.answer(Instead.ASK_IN_THREAD)
                return
            self._waiting.append(query)
            if len(self._lines) < _most_lines(readers):
                self._start_reader()
        if self._timer is None:
            self._timer = self._loop.call_later(TICK_S, self._tick)

    def forget(self, query: PointQuery) -> None:
        """Answer a query no more: its client has gone."""
        query.on_answer = None
        line = query.line
        if line is not None and self._loop is not None and line.queries[0] is query:
            self._end_if_stalled(line, self._loop.time())

    def close(self) -> None:
        """Give all readers back, when the server stops."""
        for line in list(self._lines):
            self._close(line)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _try(self, readers: Readers, query: PointQuery, now: float) -> bool:
        """Send a query if a reader can take it at once; tell whether that was decided."""
        for line in list(self._lines):
            if line.queries and not line.has_room(len(query.payload), now):
                continue
            if not readers.may_use(line.reader):
                line.is_stalled = True
                if not line.queries:
                    self._close(line)
            elif not line.queries or not readers.is_in_demand:
                self._send(readers, line, query, now)
                return True
        if len(self._lines) >= _most_lines(readers):
            return False
        try:
            reader = readers.open_line()
        except ClosedError:
            return False
        if reader is None:
            return False
        line = _Line(reader)
        self._lines.append(line)
        assert self._loop is not None
        self._loop.add_reader(reader.descriptor, self._receive, line)
        self._send(readers, line, query, now)
        return True

    def _send(self, readers: Readers, line: _Line, query: PointQuery, now: float) -> None:
        query.attempts += 1
        try:
            was_sent = readers.send(line.reader, query.payload, query.text)
        except RtaskError:
            was_sent = False  # the thread meets it again and answers it
        if not was_sent:
            line.is_stalled = not line.reader.is_sound
            if line.is_stalled and not line.queries:
                self._close(line)
            query.answer(Instead.ASK_IN_THREAD)
            return
        if not line.queries:
            line.since = now
        line.queries.append(query)
        line.bytes += len(query.payload)
        query.line = line

    def _receive(self, line: _Line) -> None:
        """Pass on the answers that have come, and send what waits."""
        assert self._loop is not None
        reader, queries = line.reader, line.queries
        reader.receive()
        while queries and (answer := reader.take()) is not None:
            query = queries.popleft()
            line.bytes -= len(query.payload)
            line.since = self._loop.time()
            if reader.was_slow:
                self._slow.note(query.text)
            if query.line is line:
                query.line = None
                query.answer(answer if answer.kind else Instead.ASK_IN_THREAD)
        if not reader.is_sound:
            self._close(line)
        elif queries and reader.is_long:
            self._continue(line)
        elif not queries:
            line.is_stalled = False
            if self._readers is not None and self._readers.is_in_demand:
                self._close(line)
        if self._waiting:
            self._advance()

    def _continue(self, line: _Line) -> None:
        """Leave a reader to the long answer in front; ask the others again."""
        readers, query = self._readers, line.queries[0]
        assert readers is not None
        if query.on_answer is None or query.line is not line:
            line.reader.kill()
            self._close(line)
            return
        self._remove(line)
        behind = line.take_over()
        stream = readers.continue_line(line.reader, query.text, len(line.queries) == 1)
        query.line = None
        query.answer(stream)
        self._ask_again(behind)

    def _close(self, line: _Line) -> None:
        """Give a reader back. A thread asks the query in front again, and finds out what it does
        to readers; those behind are asked again here."""
        self._remove(line)
        line.reader.close(is_reusable=not line.queries)
        if line.queries:
            behind = line.take_over()
            front = line.queries[0]
            line.queries.clear()
            if front.line is line:
                front.line = None
                front.answer(Instead.ASK_IN_THREAD)
            self._ask_again(behind)

    def _remove(self, line: _Line) -> None:
        assert self._loop is not None
        self._lines.remove(line)
        self._loop.remove_reader(line.reader.descriptor)

    def _ask_again(self, queries: list[PointQuery]) -> None:
        for query in queries:
            if query.attempts >= MAX_ATTEMPTS:
                query.answer(Instead.ASK_IN_THREAD)
            elif query.on_answer is not None:
                self.ask(query)

    def _advance(self) -> None:
        """Send the queries for which there is a reader now."""
        readers, loop = self._readers, self._loop
        assert readers is not None
        assert loop is not None
        while self._waiting:
            query = self._waiting[0]
            if query.on_answer is not None and not self._try(readers, query, loop.time()):
                return
            self._waiting.popleft()

    def _tick(self) -> None:
        """Keep the deadlines: of queries, of those that wait, and of readers without a query."""
        assert self._loop is not None
        self._timer, now = None, self._loop.time()
        for line in list(self._lines):
            if not line.queries:
                if now - line.since > IDLE_S:
                    self._close(line)
            elif now - line.since > QUICK_S:
                front = line.queries[0]
                self._slow.note(front.text)
                if front.line is line:
                    front.line = None
                    front.answer(Instead.ASK_AMONG_LONG)
                line.reader.kill()
            elif not self._end_if_stalled(line, now) and now - line.since > STALL_S:
                line.is_stalled = True
                self._ask_again(line.take_over())
        if self._waiting:
            self._advance()
        while self._waiting and now - self._waiting[0].since > WAIT_S:
            self._waiting.popleft().answer(Instead.ASK_IN_THREAD)
        if (self._lines or self._waiting) and self._timer is None:
            self._timer = self._loop.call_later(TICK_S, self._tick)

    @staticmethod
    def _end_if_stalled(line: _Line, now: float) -> bool:
        """End a reader whose query in front takes its time, though nobody waits for the answer."""
        front = line.queries[0]
        if front.on_answer is not None and front.line is line:
            return False
        if now - line.since <= STALL_S:
            return False
        line.reader.kill()
        return True


def _most_lines(readers: Readers) -> int:
    """Return how many readers may be busy with point queries."""
    return max(1, readers.limits.reserved)
