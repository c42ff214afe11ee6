"""Bounds on what may follow from one commit, and the guard that can end its derivation.

What is counted (statements derived, combinations tried) depends on the graph alone, so that a
loaded machine decides as an idle one does. Time and memory are guards: what they end may succeed
later, so the answer is 503 with ``Retry-After``.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rtask.errors import BusyError

__all__ = [
    "OF_OPERATORS",
    "OF_ROBOTS",
    "UNBOUNDED",
    "Guard",
    "ReasoningLimits",
    "return_memory",
    "stopping",
]

_FIRST_DERIVED, _FIRST_DERIVED_EACH = 1_000, 5
_FIRST_FIRINGS, _FIRST_FIRINGS_EACH = 15_000, 15
_FIRST_REBUILT = 2_000
_MEMORY_EVERY_S = 0.02
_RETRY_S = 10


@dataclass(frozen=True)
class ReasoningLimits:
    """Bounds on what may follow from one commit.

    Parameters
    ----------
    derived, derived_each
        Statements that may be derived: so many, and so many more for each statement that the
        commit adds or removes.
    firings, firings_each
        Combinations of facts that all rules together may try; counted alike.
    seconds
        Time for the derivation; ``None`` without a bound.
    memory_bytes
        Memory that the process may gain meanwhile; ``None`` without a bound.
    """

    derived: int = 10_000
    derived_each: int = 10
    firings: int = 300_000
    firings_each: int = 60
    seconds: float | None = 30.0
    memory_bytes: int | None = 512 << 20

    def derived_from(self, statements: int) -> int:
        """Return how many statements may be derived from a change of so many."""
        return self.derived + statements * self.derived_each

    def budget(self, statements: int, guard: Guard) -> Any:
        """Return the reasoner's budget for a change of so many statements."""
        from reasoner import ChangeBudget

        return ChangeBudget(
            self.derived_from(statements),
            self.firings + statements * self.firings_each,
            guard,
        )

    def first_look(self, statements: int, guard: Guard) -> Any:
        """Return the budget within which a change is derived at once, in less than .1 s.

        The ordinary writes of a robot need a tenth of it.
        """
        whole = self.budget(statements, guard)
        return replace(
            whole,
            derived=min(whole.derived, _FIRST_DERIVED + statements * _FIRST_DERIVED_EACH),
            firings=min(whole.firings, _FIRST_FIRINGS + statements * _FIRST_FIRINGS_EACH),
            rebuild_up_to=_FIRST_REBUILT,
        )


OF_ROBOTS = ReasoningLimits()
"""Bounds of the commits of robots, teachers and callers without a token."""

OF_OPERATORS = ReasoningLimits(200_000, 50, 20_000_000, 200, 600.0, 2 << 30)
"""Bounds of the updates that an operator sends to a server; its loads have those of the closure."""

UNBOUNDED = ReasoningLimits(sys.maxsize, 0, sys.maxsize, 0, None, None)
"""Only the closure's own bounds."""


class Guard:
    """Looks at the clock, at memory and at a request to stop, while consequences are derived.

    Raises
    ------
    BusyError
        When called after the time has passed, memory has grown too far, or writing was
        interrupted.

    Parameters
    ----------
    stop
        Set to end the derivation at once.
    """

    def __init__(self, limits: ReasoningLimits | None, stop: threading.Event) -> None:
        self._stop = stop
        self._seconds = None if limits is None else limits.seconds
        self._allowed = None if limits is None else limits.memory_bytes
        self._started = self._looked = time.monotonic()
        self._before: int | None = None

    def __call__(self) -> None:
        """Let the derivation go on, or raise."""
        if self._stop.is_set():
            raise stopping()
        now = time.monotonic()
        if self._seconds is not None and now - self._started > self._seconds:
            raise BusyError(
                f"what follows from the change was not derived within {self._seconds:g} s; nothing "
                "was stored; try again later, or split the change",
                retry_after_s=_RETRY_S,
                limit="reasoning time",
                allowed=self._seconds,
            )
        allowed = self._allowed
        # The system is asked rarely: the guard is called far more often than memory grows.
        if allowed is None or (self._before is not None and now - self._looked < _MEMORY_EVERY_S):
            return
        self._looked = now
        memory = resident_bytes()
        if memory is None:  # nothing tells it here: it is not asked for again
            self._allowed = None
        elif self._before is None:
            self._before = memory  # not before there is work: most commits end without a look
        elif memory - self._before > allowed:
            raise BusyError(
                f"deriving what follows from the change takes more than {allowed >> 20} MiB; "
                "nothing was stored; try again later, or split the change",
                retry_after_s=_RETRY_S,
                limit="reasoning memory",
                allowed=allowed,
            )


def stopping() -> BusyError:
    """Return the refusal of a change that would take long while the server stops."""
    return BusyError(
        "the server is stopping; nothing was stored; send the change again later",
        retry_after_s=_RETRY_S,
    )


def resident_bytes() -> int | None:
    """Return the memory of this process, or ``None`` where the system does not say."""
    try:
        with Path("/proc/self/statm").open("rb") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None


def return_memory() -> None:
    """Give free memory back to the system after much was derived, where the C library is glibc."""
    # glibc keeps what was freed between pieces still in use; a server would stay as large as its
    # largest derivation.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
