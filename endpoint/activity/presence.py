"""Open connections of robots, the calls that they have running, and how long calls take them."""

from __future__ import annotations

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["Calls", "Link", "Links"]

MAX_ROBOTS = 256
CLOSING_S = 2.0
TIMED_CALLS = 200
"""The last calls of a robot, of which the percentiles are."""


@dataclass(frozen=True)
class Link:
    """An open connection of a robot.

    Parameters
    ----------
    robot
        Name of the robot.
    since_s
        When it connected, seconds since the epoch.
    provides
        Returns the names of the services that it offers to others over this connection.
    close
        Closes the connection from any thread; takes the reason that the robot is told.
    """

    robot: str
    since_s: float
    provides: Callable[[], list[str]]
    close: Callable[[str], None]


class Links:
    """All open connections of robots; safe for all threads.

    Examples
    --------
    >>> links = Links()
    >>> leave = links.add(Link("nao-1", 0.0, lambda: ["/nao_1/say"], lambda reason: leave()))
    >>> len(links.of("nao-1")), links.close("nao-1", "closed by ann"), links.of("nao-1")
    (1, 1, [])
    """

    def __init__(self) -> None:
        self._left = threading.Condition()
        self._open: list[Link] = []

    def add(self, link: Link) -> Callable[[], None]:
        """Note a connection; call the returned function when it has ended."""
        with self._left:
            self._open.append(link)

        def leave() -> None:
            with self._left:
                self._open = [other for other in self._open if other is not link]
                self._left.notify_all()

        return leave

    def of(self, robot: str) -> list[Link]:
        """Return the open connections of a robot, the oldest first."""
        with self._left:
            return [link for link in self._open if link.robot == robot]

    def close(self, robot: str, reason: str) -> int:
        """Close the connections of a robot, wait a moment for their end, return their number."""
        links = self.of(robot)
        for link in links:
            link.close(reason)
        with self._left:
            self._left.wait_for(lambda: not any(link in links for link in self._open), CLOSING_S)
        return len(links)


@dataclass
class _Timed:
    running: dict[int, tuple[str, float]] = field(default_factory=dict)
    took_s: deque[float] = field(default_factory=lambda: deque(maxlen=TIMED_CALLS))


@dataclass(frozen=True)
class CallFigures:
    """Calls of one robot.

    Parameters
    ----------
    running
        Names of the operations that it waits for, with the seconds since it asked.
    timed
        Number of calls that the percentiles are of; at most :data:`TIMED_CALLS`.
    p50_ms, p95_ms
        Median and 95th percentile of the time that they took on the server; none without a call.
    """

    running: list[tuple[str, float]]
    timed: int
    p50_ms: float | None
    p95_ms: float | None


class Calls:
    """Durations of the engine's operations, robot by robot; safe for all threads.

    Of as many robots as :data:`MAX_ROBOTS`, those that called last.

    Parameters
    ----------
    clock
        Returns seconds.

    Examples
    --------
    >>> times = iter((0.0, 0.25, 1.0, 1.5))
    >>> calls = Calls(lambda: next(times))
    >>> calls.began("nao-1", 1, "recall_grasps"); calls.ended("nao-1", 1)
    >>> calls.began("nao-1", 2, "search_object"); calls.of("nao-1")
    CallFigures(running=[('search_object', 0.5)], timed=1, p50_ms=250.0, p95_ms=250.0)
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._robots: dict[str, _Timed] = {}

    def began(self, robot: str, number: int, operation: str) -> None:
        """Note that a call began; its number is that of no other."""
        with self._lock:
            timed = self._robots.pop(robot, None) or _Timed()
            self._robots[robot] = timed
            timed.running[number] = operation, self._clock()
            while len(self._robots) > MAX_ROBOTS:
                del self._robots[next(iter(self._robots))]

    def ended(self, robot: str, number: int) -> None:
        """Note that a call ended; one whose beginning was not seen is ignored."""
        with self._lock:
            timed = self._robots.get(robot)
            begun = timed.running.pop(number, None) if timed else None
            if timed and begun:
                timed.took_s.append(self._clock() - begun[1])

    def of(self, robot: str) -> CallFigures:
        """Return what is known of a robot's calls; of one that never called, that there is none."""
        with self._lock:
            timed = self._robots.get(robot) or _Timed()
            now = self._clock() if timed.running else 0.0
            running = [(name, now - begin) for name, begin in timed.running.values()]
            took_s = list(timed.took_s)
        if not took_s:
            return CallFigures(running, 0, None, None)
        cuts = statistics.quantiles([*took_s, took_s[-1]] if len(took_s) == 1 else took_s,
                                    n=20, method="inclusive")  # fmt: skip
        return CallFigures(running, len(took_s), 1000 * cuts[9], 1000 * cuts[18])
