"""Queries of earlier states of the graph: ``as_of=COMMIT``, ``EPOCH:COMMIT`` or a time.

A state is a copy by hard links in which later commits are undone. Two are kept for the questions
that follow, and closed after a minute without any.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import re
import threading
import time
from collections.abc import Callable, Iterator

from endpoint.http.messages import Chunks, RefusedError, Response
from endpoint.served import ServedGraph, embedded
from endpoint.settings import Config
from endpoint.sparql.answers import Answers, Question
from rtask.errors import BusyError, EpochChangedError, QueryTimeout, TooLargeError
from rtask.kb.readers.request import ReaderLimits
from rtask.knowledge_base import KnowledgeBase

__all__ = ["PastStates", "parse_as_of"]

_MAX_STATES = 2
_MAX_UNDONE = 200_000
_REST_S = 60.0
_COMMIT = re.compile(r"(?:[0-9a-f]+:)?[0-9]{1,17}")
_LIMITS = ReaderLimits(count=2, reserved=0, updates=0, queue=8)


def parse_as_of(text: str) -> int | dt.datetime | str:
    """Return the commit or time that a field ``as_of`` names; a text for ``EPOCH:COMMIT``.

    Raises
    ------
    RefusedError
        It names none, or a time without its zone.

    Examples
    --------
    >>> parse_as_of("17"), parse_as_of("9f3a:17")
    (17, '9f3a:17')
    """
    if _COMMIT.fullmatch(text):
        return text if ":" in text else int(text)
    at = None
    with contextlib.suppress(ValueError):
        at = dt.datetime.fromisoformat(text)
    if at is None or at.tzinfo is None:
        raise RefusedError(
            400,
            "usage",
            f"as_of={text[:80]!r} is no commit (a number, or EPOCH:NUMBER as in RTASK-Version) and "
            "no time with its zone, e.g. 2026-01-02T03:04:05Z",
            parameter="as_of",
        )
    return at


class _State:
    """One earlier state that is open."""

    def __init__(self, kb: KnowledgeBase, config: Config) -> None:
        self.kb = kb
        self.answers = Answers(kb, config)
        self.users = 0
        self.last_used = time.monotonic()


class PastStates:
    """The earlier states of one graph that are open.

    Parameters
    ----------
    kb
        The graph as it is now.
    config
        Limits of one answer.
    """

    def __init__(self, kb: ServedGraph, config: Config) -> None:
        self._kb = kb
        self._config = config
        self._lock = threading.Lock()
        self._making = threading.Lock()
        self._states: dict[int, _State] = {}
        self._is_closed = False

    def open(self, question: Question, at: int | dt.datetime | str) -> Response:
        """Open an answer from an earlier state; ``RTASK-As-Of`` names its last commit.

        Raises
        ------
        UsageError
            There is no such commit.
        GoneError, EpochChangedError
            The commits since then are no longer kept, or have other numbers.
        TooLargeError
            More was changed since then than is undone for a question.
        UnsupportedError
            The graph keeps no journal, or something was loaded in bulk since then.
        StorageFullError
            There is no room for the copy.
        QueryTimeout
            The time is up, the making of the state included.
        """
        seq, state = self._hold(at, question.deadline)
        try:
            response = state.answers.open(question, point=False)
        except BaseException:
            self._release(seq)
            raise
        response = response.with_headers(("RTASK-As-Of", f"{self._kb.epoch}:{seq}"))
        if response.chunks is None:
            self._release(seq)
            return response
        chunks = _HeldChunks(response.chunks, lambda: self._release(seq))
        return Response(
            response.status, response.body, response.media_type, response.headers, chunks
        )

    def _hold(self, at: int | dt.datetime | str, deadline: float) -> tuple[int, _State]:
        own = embedded(self._kb, "as_of")
        if not self._making.acquire(timeout=max(0.0, deadline - time.monotonic())):
            raise QueryTimeout("other earlier states were being made until the time was over")
        try:
            seq = self._commit(own, at)
            with self._lock:
                state = self._states.get(seq)
                if state is not None:
                    state.users += 1
                    return seq, state
                self._make_room()
            _require_near(own, seq)
            past = own.as_of(seq)
            past.readers.limits = _LIMITS
            state = _State(past, self._config)
            state.users = 1
            with self._lock:
                self._states[seq] = state
            return seq, state
        finally:
            self._making.release()

    def _commit(self, kb: KnowledgeBase, at: int | dt.datetime | str) -> int:
        if isinstance(at, str):
            epoch, _, number = at.rpartition(":")
            if epoch != kb.epoch:
                raise EpochChangedError(f"commits were renumbered with epoch {kb.epoch}")
            return int(number)
        return at if isinstance(at, int) else kb.commit_at(at)

    def _make_room(self) -> None:
        """Close the state that has not been asked for longest, if there are too many."""
        while len(self._states) >= _MAX_STATES:
            idle = [seq for seq, state in self._states.items() if not state.users]
            if not idle:
                raise BusyError(f"{len(self._states)} earlier states are being read; try again")
            oldest = min(idle, key=lambda seq: self._states[seq].last_used)
            self._states.pop(oldest).kb.close()

    def _release(self, seq: int) -> None:
        with self._lock:
            state = self._states[seq]
            state.users -= 1
            state.last_used = time.monotonic()
            if self._is_closed and not state.users:
                self._states.pop(seq).kb.close()
                return
        timer = threading.Timer(_REST_S + 1.0, self._close_idle)
        timer.daemon = True
        timer.start()

    def _close_idle(self, rest_s: float = _REST_S) -> None:
        until = time.monotonic() - rest_s
        with self._lock:
            for seq, state in list(self._states.items()):
                if not state.users and state.last_used <= until:
                    self._states.pop(seq).kb.close()

    def close(self) -> None:
        """Close the states; one that is being read is closed after that."""
        self._is_closed = True
        self._close_idle(0.0)


def _require_near(kb: KnowledgeBase, seq: int) -> None:
    """Refuse a state which is further from the nearest kept one than a request may replay."""
    undone = kb.replayed_for(seq)
    if undone > _MAX_UNDONE:
        raise TooLargeError(
            f"{undone} statements have changed between commit {seq} and the nearest state that is "
            f"kept, and a query undoes {_MAX_UNDONE}; on the server, kb.as_of has no such limit",
            limit=_MAX_UNDONE,
        )


class _HeldChunks(Iterator[bytes]):
    """Pieces of an answer whose source is released when they end."""

    def __init__(self, chunks: Chunks, release: Callable[[], None]) -> None:
        self._chunks = chunks
        self._release: Callable[[], None] | None = release
        self._lock = threading.Lock()

    def __next__(self) -> bytes:
        return next(self._chunks)

    def close(self) -> None:
        """End the answer and release its source; may be called repeatedly."""
        self._chunks.close()
        with self._lock:
            release, self._release = self._release, None
        if release is not None:
            release()
