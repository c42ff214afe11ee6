"""A reader that answers the small queries of an event loop, one after the other.

The loop may send a query before the one in front is answered, so that the reader goes on at once
and neither side waits for the other. Answers come in the order of the queries, each as a whole; a
long one is taken over by a stream. All methods are for the thread of the loop.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from rtask.kb.readers.keeper import ReaderProcess
from rtask.kb.readers.messages import HEADER

__all__ = ["Answer", "ReaderLine"]

_AT_ONCE = 64 << 10
_LONG = 128 << 10
_START = HEADER.size


class Answer(NamedTuple):
    """A whole answer, or the refusal of a reader to give one.

    Attributes
    ----------
    kind
        ``"rows"``, ``"boolean"`` or ``"triples"``; empty for a refusal.
    media_type, gzip
        Of the body, and whether it is compressed.
    """

    kind: str
    media_type: str
    gzip: bool
    body: bytes


_REFUSAL = Answer("", "", False, b"")


class ReaderLine:
    """A reader taken from the supply for a while, and what it has sent.

    Parameters
    ----------
    reader
        The reader; nobody else uses it meanwhile.
    give_back
        Called once, with whether the reader can be reused.
    leave
        Releases the place of the line, if a stream takes over the reader.

    Attributes
    ----------
    is_sound
        Whether the reader goes on answering: it has not ended, nor spoilt itself by a query.
    was_slow
        Whether the last answer took long to find, without the time that others had the processor.
    """

    def __init__(
        self,
        reader: ReaderProcess,
        give_back: Callable[[bool], None],
        leave: Callable[[], None],
    ) -> None:
        self.reader = reader
        self.leave = leave
        self.is_sound = True
        self.was_slow = False
        self._give_back: Callable[[bool], None] | None = give_back
        self._buffer = b""

    @property
    def descriptor(self) -> int:
        """The pipe that becomes readable when answers have come or the reader has ended."""
        return self.reader.answers

    @property
    def is_long(self) -> bool:
        """Whether the answer in front has turned out to be long; see :meth:`detach`."""
        return len(self._buffer) > _LONG

    def receive(self) -> None:
        """Read what has come; call this when the pipe is readable, and it does not wait."""
        try:
            data = os.read(self.reader.answers, _AT_ONCE)
        except BlockingIOError:
            return
        if not data:
            self.is_sound = False
        # Most answers come in one read, and are then not copied.
        self._buffer = self._buffer + data if self._buffer else data

    def take(self) -> Answer | None:
        """Return the answer in front; ``None`` if it is not whole yet."""
        data, at, kind, head = self._buffer, 0, b"", b""
        body: bytes | None = None
        while len(data) >= at + _START:
            kind, length = HEADER.unpack_from(data, at)
            start = at + _START
            at = start + length
            # Half a message: it is parsed again once more of it has come.
            if at > len(data):
                return None
            if kind == b"C":
                piece = data[start:at]
                body = piece if body is None else body + piece
            elif kind == b"M":
                head = data[start:at]
            else:
                self._buffer = data[at:]
                if kind == b"X":
                    self._note_refusal(data[start:at])
                    return _REFUSAL
                self._note_end(data[start:at])
                return Answer(*_facts(head), body or b"")
        return None

    def _note_end(self, payload: bytes) -> None:
        resident, is_reusable, self.was_slow = _end(payload)
        self.reader.measured(resident)
        self.is_sound = self.is_sound and is_reusable

    def _note_refusal(self, payload: bytes) -> None:
        facts = json.loads(payload)
        # Stopped in the middle of an answer, or grown in memory: it is not asked again.
        if not facts.get("reusable", facts["reason"] not in ("memory", "limit")):
            self.is_sound = False

    def kill(self) -> None:
        """End the reader, because of what it evaluates; the pipe becomes readable."""
        self.is_sound = False
        self.reader.kill()

    def detach(self) -> bytes:
        """Leave the reader to a stream, which gives it back; return what has come of the answer."""
        # From now on a stream owns the reader, and two must not give it back.
        self._give_back = None
        return self._buffer

    def close(self, is_reusable: bool) -> None:
        """Give the reader back; nothing may be watching its descriptor."""
        give_back, self._give_back = self._give_back, None
        if give_back is not None:
            # Bytes that are left belong to an answer that nobody took.
            give_back(is_reusable and self.is_sound and not self._buffer)


@lru_cache(maxsize=64)
def _facts(payload: bytes) -> tuple[str, str, bool]:
    facts = json.loads(payload)
    return facts["kind"], facts["type"], facts["gzip"]


@lru_cache(maxsize=64)
def _end(payload: bytes) -> tuple[int, bool, bool]:
    facts = json.loads(payload)
    return facts["rss"], facts.get("reusable", True), facts.get("slow", False)
