"""How often one caller may ask: token buckets, and what is under way at once.

A bucket holds two seconds' worth; a caller that pauses may catch up that much. Callers are known by
their token, else by their address, so one robot's loop gone wild costs the others nothing.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable

from endpoint.http.messages import RefusedError

BURST_S = 2.0
_MAX_CALLERS = 10_000


class Buckets:
    """One token bucket for each caller.

    Parameters
    ----------
    rate
        Requests a second; zero is without limit.
    clock
        Seconds; for tests.

    Examples
    --------
    >>> buckets = Buckets(1.0, clock=lambda: 100.0)
    >>> [buckets.take("nao-1") for _ in range(3)]
    [0.0, 0.0, 1.0]
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.rate = rate
        self._burst = max(1.0, rate * BURST_S)
        self._clock = clock
        self._lock = threading.Lock()
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str) -> float:
        """Take one; return 0, or the seconds until there is one again."""
        if self.rate <= 0:
            return 0.0
        with self._lock:
            now = self._clock()
            level, seen = self._levels.pop(caller, (self._burst, now))
            level = min(self._burst, level + (now - seen) * self.rate)
            wait = 0.0 if level >= 1.0 else (1.0 - level) / self.rate
            self._levels[caller] = (level - 1.0 if wait == 0.0 else level, now)
            if len(self._levels) > _MAX_CALLERS:
                self._levels.popitem(last=False)
        return wait


class InFlight:
    """How many requests of each caller are under way.

    Parameters
    ----------
    allowed
        At once, for one caller.
    """

    def __init__(self, allowed: int) -> None:
        self.allowed = allowed
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}

    def enter(self, caller: str) -> bool:
        """Count a request; false, and not counted, where the caller has too many already."""
        with self._lock:
            count = self._counts.get(caller, 0)
            if count >= self.allowed:
                return False
            self._counts[caller] = count + 1
        return True

    def leave(self, caller: str) -> None:
        """Count a request that ended."""
        with self._lock:
            left = self._counts.get(caller, 0) - 1
            if left > 0:
                self._counts[caller] = left
            else:
                self._counts.pop(caller, None)


class Limiter:
    """The limits of callers: all requests, changes, requests at once.

    Parameters
    ----------
    rate, write_rate
        Requests and changes a second.
    max_in_flight
        Requests at once.
    """

    def __init__(self, rate: float, write_rate: float, max_in_flight: int) -> None:
        self._requests = Buckets(rate)
        self._writes = Buckets(write_rate)
        self._in_flight = InFlight(max_in_flight)

    def admit(self, caller: str) -> Callable[[], None]:
        """Let a request in; call what is returned when it has ended.

        Raises
        ------
        RefusedError
            429 with ``Retry-After`` in whole seconds (RFC 6585, 4).
        """
        wait = self._requests.take(caller)
        if wait:
            raise _too_many(f"more than {self._requests.rate:g} requests a second", wait)
        if not self._in_flight.enter(caller):
            raise _too_many(f"{self._in_flight.allowed} requests of yours are under way", 1.0)
        return lambda: self._in_flight.leave(caller)

    def admit_write(self, caller: str) -> None:
        """Let a change in; raises as :meth:`admit` does."""
        wait = self._writes.take(caller)
        if wait:
            raise _too_many(f"more than {self._writes.rate:g} changes a second", wait)


def _too_many(what: str, wait: float) -> RefusedError:
    seconds = str(max(1, math.ceil(wait)))
    return RefusedError(
        429,
        "too-many-requests",
        f"{what}; wait {seconds} s, or send several statements in one request",
        headers=(("Retry-After", seconds),),
    )
