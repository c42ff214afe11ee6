"""Streamed answers of readers, and their deadlines.

Nothing is read ahead, so a slow client stops the reader and memory stays flat.
"""

from __future__ import annotations

import heapq
import itertools
import json
import os
import select
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

from rtask import errors
from rtask.errors import (
    ClosedError,
    DataError,
    QueryTimeout,
    QueryTooExpensive,
    RtaskError,
    TooLargeError,
    UsageError,
)
from rtask.kb.readers.keeper import ReaderGone, ReaderProcess, wait_for
from rtask.kb.readers.messages import HEADER
from rtask.sparql.syntax import syntax_error

__all__ = ["Deadlines", "ReaderStream", "Stream", "WholeStream"]

_READ_AHEAD = 8 << 10


class Stream(Iterator[bytes]):
    """Answer of a query in pieces of bytes; created by :meth:`KnowledgeBase.stream`.

    Read it from one thread at a time; :meth:`close` may be called from any.

    Attributes
    ----------
    kind
        ``"rows"``, ``"boolean"`` or ``"triples"``.
    media_type
        Media type of the bytes.
    gzip
        Whether they are compressed; small answers never are.
    """

    kind = ""
    media_type = ""
    gzip = False

    def __next__(self) -> bytes:
        raise NotImplementedError

    def __iter__(self) -> Stream:
        return self

    def close(self) -> None:
        """Stop reading; a reader that is still working is killed."""

    def extend(self, timeout_s: float) -> bool:
        """Set the deadline of this answer to ``timeout_s`` seconds from now.

        Returns
        -------
        ``False`` if the deadline had already passed.
        """
        return True

    def read(self) -> bytes:
        """Return the rest of the answer."""
        return b"".join(self)

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class WholeStream(Stream):
    """An answer that is already complete."""

    def __init__(self, data: bytes, media_type: str) -> None:
        self.media_type = media_type
        self._pieces = iter([data[i : i + (256 << 10)] for i in range(0, len(data), 256 << 10)])

    def __next__(self) -> bytes:
        return next(self._pieces)


class ReaderStream(Stream):
    """An answer from a reader.

    Parameters
    ----------
    text
        The query, for errors.
    done
        Called once, with whether the reader can be reused.
    crash
        Creates the error for a reader that ended without an answer.
    what
        Kind of request, for errors.
    deadlines
        End the query in time.
    read_ahead
        What the reader has sent already.
    """

    def __init__(
        self,
        reader: ReaderProcess,
        text: str,
        timeout_s: float | None,
        done: Callable[[ReaderProcess, bool], None],
        crash: Callable[[ReaderProcess], RtaskError],
        deadlines: Deadlines,
        what: str = "query",
        read_ahead: bytes = b"",
    ) -> None:
        self.reader = reader
        self.deadline: float | None = None
        self.expired = False
        self.closed = False
        self._text = text
        self._timeout_s = timeout_s
        self._done: Callable[[ReaderProcess, bool], None] | None = done
        self._crash = crash
        self._deadlines = deadlines
        self._what = what
        self._release: Callable[[], None] | None = None
        self._first: bytes | None = None
        self._read_ahead = read_ahead
        self._reading = threading.Lock()

    @property
    def is_over(self) -> bool:
        """Whether the reader has been given back."""
        return self._done is None

    def hold(self, release: Callable[[], None]) -> None:
        """Register a function to call when the query has ended."""
        # The query may have ended between its start and this call.
        with self._reading:
            if self._done is not None:
                self._release = release
                return
        release()

    def start(self) -> None:
        """Wait for the first piece.

        Raises
        ------
        ReaderGone
            The reader ended without an answer.
        RtaskError
            The query failed; the error gives the reason.
        """
        with self._reading:
            kind, payload = self._next_message()
            if kind == b"M":
                facts = _facts(payload)
                self.kind, self.media_type = facts["kind"], facts["type"]
                self.gzip = facts["gzip"]
                kind, payload = self._next_message()
            self._first = self._take(kind, payload)

    def __next__(self) -> bytes:
        with self._reading:
            # Taken in advance, so that an error in the query is raised before the answer begins.
            if self._first is not None:
                piece, self._first = self._first, None
            elif self._done is None:
                # Stopped by somebody else: an end here would look like a whole answer.
                if self.closed:
                    raise ClosedError("the query was stopped")
                raise StopIteration
            else:
                try:
                    piece = self._take(*self._next_message()) or b""
                except ReaderGone:
                    raise self._crash(self.reader) from None
            if not piece:
                raise StopIteration
            return piece

    def _take(self, kind: bytes, payload: bytes) -> bytes:
        """Return a piece of the answer, or empty bytes at its end."""
        if kind == b"C":
            return payload
        facts = _facts(payload)
        if kind == b"X":
            # Stopped in the middle of an answer, or grown in memory.
            is_reusable = facts["reason"] not in ("memory", "limit")
            self._finish(facts.get("reusable", is_reusable))
            raise self._error(facts)
        self.reader.measured(facts["rss"])
        self._finish(facts.get("reusable", True))
        return b""

    def _error(self, facts: dict[str, Any]) -> RtaskError:
        reason, text = facts["reason"], facts["text"]
        if reason == "syntax":
            return syntax_error(SyntaxError(text), "query", self._text)
        if reason == "type":
            return UsageError(text)
        if reason == "limit":
            limit, value, allowed = facts["limit"], facts["value"], facts["allowed"]
            return TooLargeError(
                f"the answer has more than {allowed} {limit}; add a LIMIT",
                limit=limit,
                value=value,
                allowed=allowed,
            )
        if reason == "memory":
            return QueryTooExpensive(
                f"the {self._what} exceeds its memory limit; narrow it, or add a LIMIT"
            )
        if reason == "update":
            return _rebuilt(facts["error"], text, facts["details"])
        return DataError(f"the query cannot be evaluated: {text}")

    def _next_message(self) -> tuple[bytes, bytes]:
        try:
            kind, length = HEADER.unpack(self._exactly(HEADER.size))
            return kind, self._exactly(length)
        except EOFError:
            # Read first: giving the reader back forgets it.
            was_expired = self.expired
            self._finish(False)
            if self.closed:
                raise ClosedError("the query was stopped") from None
            if was_expired:
                raise QueryTimeout(
                    f"the {self._what} did not end within {self._timeout_s:g} s; narrow it, or "
                    "allow more time",
                    timeout_s=self._timeout_s,
                ) from None
            raise ReaderGone from None

    def _exactly(self, length: int) -> bytes:
        """Return exactly ``length`` bytes; small adjacent messages are read in one call."""
        if self._done is None:
            raise EOFError
        have = self._read_ahead
        parts, left = [have[:length]], length - len(have)
        self._read_ahead = have[length:]
        while left > 0:
            data = _read(self.reader.answers, max(left, _READ_AHEAD))
            if not data:
                raise EOFError
            parts.append(data[:left])
            self._read_ahead = data[left:]
            left -= len(data)
        return b"".join(parts) if len(parts) > 1 else parts[0]

    def extend(self, timeout_s: float) -> bool:
        if not self._deadlines.add(time.monotonic() + timeout_s, self):
            return False
        self._timeout_s = timeout_s
        return True

    def expire(self) -> None:
        """Stop the query because its deadline has passed."""
        # The reading thread meets the end of the pipe, and says why.
        if self._done is not None:
            self.reader.kill()

    def _finish(self, reusable: bool) -> None:
        done, self._done = self._done, None
        if done is not None:
            done(self.reader, reusable)
        release, self._release = self._release, None
        if release is not None:
            release()

    def abandon(self) -> None:
        """Give the reader back as unusable."""
        with self._reading:
            self._finish(False)

    def close(self) -> None:
        """Stop reading, from any thread; a reader that is still working is killed at once."""
        if self._done is None:
            return
        self.closed = True
        # Before the lock, which the reading thread holds until the pipe ends.
        self.reader.kill()
        with self._reading:  # a thread that is reading gets the end of the pipe first
            self._finish(False)

    def __del__(self) -> None:
        self.close()


@lru_cache(maxsize=256)
def _facts(payload: bytes) -> dict[str, Any]:
    """Return what a message says; heads and ends of answers repeat."""
    facts: dict[str, Any] = json.loads(payload)
    return facts


def _read(descriptor: int, size: int) -> bytes:
    """Read from a pipe, waiting; an event loop that watched it may have left it non-blocking."""
    while True:
        try:
            return os.read(descriptor, size)
        except BlockingIOError:
            wait_for(descriptor, select.POLLIN)


def _rebuilt(name: str, text: str, details: dict[str, Any]) -> RtaskError:
    """Recreate the error that a reader raised, with the same class."""
    error_class = getattr(errors, name, None)
    if isinstance(error_class, type) and issubclass(error_class, RtaskError):
        return error_class(text, **details)
    return DataError(f"the update cannot be evaluated: {text}")


class Deadlines:
    """Kills the readers of queries at their deadlines, with one thread for all queries."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._heap: list[tuple[float, int, weakref.ref[ReaderStream]]] = []
        self._numbers = itertools.count()
        self._thread: threading.Thread | None = None
        self._closed = False

    def add(self, at: float, stream: ReaderStream) -> bool:
        """Set a stream's deadline, a time of the monotonic clock, replacing an earlier deadline.

        Returns
        -------
        ``False`` if an earlier deadline had already passed.
        """
        with self._changed:
            if stream.expired:
                return False
            stream.deadline = at
            while self._heap and _is_over(self._heap[0][2]):
                heapq.heappop(self._heap)
            number = next(self._numbers)
            heapq.heappush(self._heap, (at, number, weakref.ref(stream)))
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="rtask-deadlines", daemon=True
                )
                self._thread.start()
            elif self._heap[0][1] == number:  # no other time is over before
                self._changed.notify()
            return True

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._heap and _is_over(self._heap[0][2]):
                    heapq.heappop(self._heap)
                if self._closed:
                    return
                wait = self._heap[0][0] - time.monotonic() if self._heap else None
                if wait is None or wait > 0:
                    self._changed.wait(wait)
                    continue
                at, _, reference = heapq.heappop(self._heap)
                stream = reference()
                if stream is None or stream.deadline != at:
                    continue
                stream.expired = True
            stream.expire()
            del stream

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._heap.clear()
            self._changed.notify()


def _is_over(reference: weakref.ref[ReaderStream]) -> bool:
    stream = reference()
    return stream is None or stream.is_over
