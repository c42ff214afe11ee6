"""Rate limits: token buckets and a bound on simultaneous requests, for each caller.

A bucket holds two seconds' worth of requests, which a caller may send in one burst after a pause.
Callers are told apart by their token, else by their address, so that a robot caught in a loop costs
the others nothing.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable

from endpoint.access.auth import Caller
from endpoint.http.messages import RefusedError

BURST_S = 2.0
_MAX_CALLERS = 10_000


class Buckets:
    """A token bucket for each caller.

    Parameters
    ----------
    rate
        Requests per second; zero for no limit.
    clock
        Returns seconds; tests pass their own.

    Examples
    --------
    >>> buckets = Buckets(1.0, clock=lambda: 100.0)
    >>> [buckets.take("nao-1") for _ in range(3)]
    [0.0, 0.0, 1.0]
    >>> [buckets.take("nao-2", 2), buckets.take("nao-2")]
    [0.0, 1.0]
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.rate = rate
        self._burst = max(1.0, rate * BURST_S)
        self._clock = clock
        self._lock = threading.Lock()
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str, count: int = 1) -> float:
        """Take tokens and return 0, or return the seconds until there are as many.

        More than a bucket holds can be taken from a full one; it then fills from below zero.
        """
        if self.rate <= 0:
            return 0.0
        with self._lock:
            now = self._clock()
            # Whoever is new, or was forgotten, starts with a full bucket.
            level, seen = self._levels.pop(caller, (self._burst, now))
            level = min(self._burst, level + (now - seen) * self.rate)
            # More than a bucket ever holds would wait for ever: it is let through once the bucket
            # is full.
            needed = min(float(count), self._burst)
            wait = 0.0 if level >= needed else (needed - level) / self.rate
            # May fall below zero for a large request, which the next ones then wait off.
            self._levels[caller] = (level - count if wait == 0.0 else level, now)
            # Likeliest to have a full bucket by now, with which it would start again.
            if len(self._levels) > _MAX_CALLERS:
                self._levels.popitem(last=False)
        return wait


class InFlight:
    """Counter of the requests of each caller that are in progress.

    Parameters
    ----------
    allowed
        Simultaneous requests of one caller.
    """

    def __init__(self, allowed: int) -> None:
        self.allowed = allowed
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}

    def enter(self, caller: str) -> bool:
        """Count a request in; return false, uncounted, if the caller has too many already."""
        with self._lock:
            count = self._counts.get(caller, 0)
            if count >= self.allowed:
                return False
            self._counts[caller] = count + 1
        return True

    def leave(self, caller: str) -> None:
        """Count a request out."""
        with self._lock:
            left = self._counts.get(caller, 0) - 1
            if left > 0:
                self._counts[caller] = left
            else:
                self._counts.pop(caller, None)


class Limiter:
    """Limits requests, changes and simultaneous requests of each caller.

    Local callers are not limited while no token is required.

    Parameters
    ----------
    rate, write_rate
        Requests and changes per second.
    max_in_flight
        Simultaneous requests.
    clock
        Returns seconds; tests pass their own.
    """

    def __init__(
        self,
        rate: float,
        write_rate: float,
        max_in_flight: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._requests = Buckets(rate, clock)
        self._writes = Buckets(write_rate, clock)
        self._in_flight = InFlight(max_in_flight)

    def admit(self, caller: Caller) -> Callable[[], None]:
        """Admit a request; call the returned function when it has ended.

        Raises
        ------
        RefusedError
            429 with ``Retry-After`` in whole seconds (RFC 6585, 4).
        """
        if caller.access.role == "anonymous":
            return lambda: None
        return self._admit(caller.key)

    def try_admit(self, caller: Caller) -> bool:
        """Admit a request if no limit is reached; call :meth:`leave` when it has ended."""
        if caller.access.role == "anonymous":
            return True
        # The order matters: a request over the rate must not be counted in.
        return not self._requests.take(caller.key) and self._in_flight.enter(caller.key)

    def leave(self, caller: Caller) -> None:
        """Note that a request has ended that was admitted by :meth:`try_admit`."""
        if caller.access.role != "anonymous":
            self._in_flight.leave(caller.key)

    def admit_stranger(self, address: str) -> None:
        """Rate-limit unauthenticated callers by their address; raises as :meth:`admit` does."""
        # Left at once: a stranger's request is refused before it does any work.
        self._admit(f"stranger {address}")()

    def _admit(self, caller: str) -> Callable[[], None]:
        wait = self._requests.take(caller)
        if wait:
            raise _too_many(f"more than {self._requests.rate:g} requests per second", wait)
        if not self._in_flight.enter(caller):
            raise _too_many(f"{self._in_flight.allowed} of your requests are in progress", 1.0)
        return lambda: self._in_flight.leave(caller)

    def admit_calls(self, caller: Caller, calls: int, changes: int) -> None:
        """Admit what a request that was admitted holds; raises as :meth:`admit` does.

        Parameters
        ----------
        calls
            Calls in the request; the first was counted by :meth:`admit`.
        changes
            Calls among them that change or record something.
        """
        if caller.access.role == "anonymous":
            return
        for buckets, count, what in (
            # The request itself was counted when it came.
            (self._writes, changes, "changes"),
            (self._requests, calls - 1, "requests"),
        ):
            wait = buckets.take(caller.key, count) if count > 0 else 0.0
            if wait:
                raise _too_many(f"more than {buckets.rate:g} {what} per second", wait)


def _too_many(what: str, wait: float) -> RefusedError:
    seconds = str(max(1, math.ceil(wait)))
    return RefusedError(
        429,
        "too-many-requests",
        f"{what}; wait {seconds} s, or combine several statements in one request",
        headers=(("Retry-After", seconds),),
    )
