"""Admission of queries: places at the readers, the wait for one, and texts that are refused."""

from __future__ import annotations

import functools
import hashlib
import threading
import time
from collections import Counter
from collections.abc import Callable

from rtask.errors import BusyError, ClosedError, QueryTimeout, QueryTooExpensive
from rtask.kb.commit.budget import stopping
from rtask.kb.readers.request import ReaderLimits

__all__ = ["Places", "RefusedTexts", "require_time"]

_REFUSE_S = 600.0


class Places:
    """Places for queries that run at a time, some of them reserved for quick ones.

    Attributes
    ----------
    limits
        How many there are; may be replaced at any time.
    waiting
        Number of queries that wait for a place.
    """

    def __init__(self) -> None:
        self.limits = ReaderLimits()
        self.waiting = 0
        self._changed = threading.Condition()
        self._taken = self._heavy = self._updating = 0
        self._authors: Counter[str] = Counter()
        self._waiting_quick = self._waiting_updates = 0
        self._closed = self._refuses_updates = False

    def enter(
        self,
        heavy: bool,
        at: float | None,
        timeout_s: float | None,
        update: bool = False,
        who: str | None = None,
    ) -> Callable[[], None]:
        """Wait for a free place; return a function that releases it.

        Parameters
        ----------
        heavy
            Whether the reserved places are barred to it.
        at, timeout_s
            Deadline on the monotonic clock, and the time limit to report in the error.
        who
            Author of an update, who leaves the last of their places to others.

        Raises
        ------
        QueryTimeout
            There was no place in time.
        BusyError
            Too many queries are waiting.
        """
        with self._changed:
            if not self._is_room(heavy, update, who) and self.waiting >= self.limits.queue:
                raise BusyError(f"too many queries are waiting ({self.waiting}); try again later")
            self.waiting += 1
            self._waiting_quick += not heavy
            self._waiting_updates += update
            try:
                while not (self._is_room(heavy, update, who) or self._is_barred(update)):
                    require_time(at, timeout_s)
                    self._changed.wait(None if at is None else at - time.monotonic())
            finally:
                self.waiting -= 1
                self._waiting_quick -= not heavy
                self._waiting_updates -= update
            self._require_open(update)
            return self._take(heavy, update, who)

    def enter_now(self) -> Callable[[], None] | None:
        """Take a place for quick queries; return a function that releases it, or none if full."""
        with self._changed:
            self._require_open()
            if self.is_in_demand or not self._is_room(False, False):
                return None
            return self._take(False, False)

    @property
    def is_in_demand(self) -> bool:
        """Whether somebody waits who may have the next place that is released."""
        if not self.waiting:
            return False
        limits, updates = self.limits, self._waiting_updates
        if self._waiting_quick > 0:
            return True
        waits_long = self.waiting > updates
        waits_update = updates > 0 and self._updating < limits.updates
        return (waits_long or waits_update) and self._heavy < limits.long

    def _take(self, heavy: bool, update: bool, who: str | None = None) -> Callable[[], None]:
        self._taken += 1
        self._heavy += heavy
        self._updating += update
        if who is not None:
            self._authors[who] += 1
        return functools.partial(self._leave, heavy, update, who)

    def _is_room(self, heavy: bool, update: bool, who: str | None = None) -> bool:
        limits = self.limits
        if update and self._updating >= limits.updates:
            return False
        if who is not None and self._authors[who] >= max(1, limits.updates - 1):
            return False
        if heavy and self._heavy >= limits.long:
            return False
        return self._taken < limits.count

    def _leave(self, heavy: bool, update: bool, who: str | None = None) -> None:
        with self._changed:
            if who is not None:
                self._authors[who] -= 1
                if not self._authors[who]:
                    del self._authors[who]
            self._taken -= 1
            self._heavy -= heavy
            self._updating -= update
            # All of them: one that is woken alone may be barred from this place, and another could
            # take it.
            self._changed.notify_all()

    def _is_barred(self, update: bool) -> bool:
        return self._closed or (update and self._refuses_updates)

    def _require_open(self, update: bool = False) -> None:
        if self._closed:
            raise ClosedError("the knowledge base is closed")
        if self._is_barred(update):
            raise stopping()

    def refuse_updates(self) -> None:
        """Let no update in, because the server stops; those that wait get a :class:`BusyError`."""
        with self._changed:
            self._refuses_updates = True
            self._changed.notify_all()

    def close(self) -> None:
        """Let nobody in; those that wait get a :class:`ClosedError`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class RefusedTexts:
    """Texts that ended a reader lately; they are not tried again for ten minutes."""

    def __init__(self) -> None:
        self._reasons: dict[bytes, tuple[float, str]] = {}

    def check(self, kind: bytes, text: str) -> None:
        """Refuse a text that ended a reader lately.

        Raises
        ------
        QueryTooExpensive
            With the reason given then.
        """
        if not self._reasons:
            return
        key = _key(kind, text)
        if key in self._reasons:
            until, reason = self._reasons[key]
            if time.monotonic() < until:
                raise QueryTooExpensive(reason + "; the same text is refused for ten minutes")
            del self._reasons[key]

    def add(self, kind: bytes, text: str, reason: str) -> None:
        """Refuse a text from now on."""
        self._reasons[_key(kind, text)] = (time.monotonic() + _REFUSE_S, reason)


def _key(kind: bytes, text: str) -> bytes:
    # The text itself may be a megabyte, and hold what is nobody's business.
    return hashlib.sha256(kind + text.encode()).digest()


def require_time(at: float | None, timeout_s: float | None) -> None:
    """Raise :class:`QueryTimeout` if a deadline passed while waiting for a reader."""
    if at is not None and time.monotonic() >= at:
        raise QueryTimeout(
            f"the query did not end within {timeout_s:g} s, all of it spent waiting for a reader; "
            "try again later or allow more time",
            timeout_s=timeout_s,
        )
