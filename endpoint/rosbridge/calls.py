"""Threads that carry out calls, and the deadlines of calls that may never be answered.

A slow call delays neither its robot's fast ones nor those of other robots.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Protocol

from endpoint.rosbridge.messages import JsonObject

Job = Callable[[], None]

THREADS = 32
RUNNING_PER_SESSION = 8
WAITING_PER_SESSION = 32
_log = logging.getLogger(__name__)


@dataclass
class _Lane:
    """The calls of one session."""

    running: int = 0
    waiting: deque[Job] = field(default_factory=deque)


class CallQueue:
    """Queue of calls whose threads are shared fairly between sessions.

    At most :data:`RUNNING_PER_SESSION` calls of a session are in the threads' queue; its further
    calls wait in a lane of their own. Jobs must not raise.

    Parameters
    ----------
    threads
        Number of calls that run at the same time.
    """

    def __init__(self, threads: int = THREADS) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="call")
        self._lock = threading.Lock()
        self._lanes: dict[Hashable, _Lane] = {}

    def submit(self, session: Hashable, job: Job) -> bool:
        """Queue a call; tell whether there was room."""
        with self._lock:
            lane = self._lanes.setdefault(session, _Lane())
            if lane.running < RUNNING_PER_SESSION:
                lane.running += 1
            elif len(lane.waiting) < WAITING_PER_SESSION:
                lane.waiting.append(job)
                return True
            else:
                return False
        self._pool.submit(self._run, session, job)
        return True

    def _run(self, session: Hashable, job: Job) -> None:
        try:
            job()
        finally:
            self._next(session)

    def _next(self, session: Hashable) -> None:
        with self._lock:
            lane = self._lanes.get(session)
            if lane is None:
                return
            if not lane.waiting:
                lane.running -= 1
                if not lane.running:
                    del self._lanes[session]
                return
            job = lane.waiting.popleft()
        self._pool.submit(self._run, session, job)

    def forget(self, session: Hashable) -> None:
        """Drop the waiting calls of a session that ended."""
        with self._lock:
            lane = self._lanes.get(session)
            if lane is not None:
                lane.waiting.clear()

    def load(self, session: Hashable) -> tuple[int, int]:
        """Return the numbers of a session's running and waiting calls."""
        with self._lock:
            lane = self._lanes.get(session, _Lane())
            return lane.running, len(lane.waiting)

    def close(self) -> None:
        """Wait for running calls to end and drop the waiting ones."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class Once:
    """Guard that lets only the first of several answers to a call through."""

    __slots__ = ("_done", "_lock")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._done = False

    def __call__(self) -> bool:
        with self._lock:
            first, self._done = not self._done, True
        return first


class Prepared(Protocol):
    """A call of a service, with an end that is settled once."""

    def result(self) -> JsonObject:
        """Carry it out and return its answer."""

    def expire(self) -> object:
        """End it as late, unless it is being stored."""

    def cancel(self) -> object:
        """End it as cancelled, unless it is being stored."""


class OwnCall:
    """A call that the server carries out, and whether its caller may still be told that it ended.

    Parameters
    ----------
    may_be_left
        Whether it changes nothing, so that its answer may be dropped while it runs. What writes
        is waited for, because its caller would write twice.
    """

    def __init__(self, *, may_be_left: bool) -> None:
        self._may_be_left = may_be_left
        self._lock = threading.Lock()
        self._is_left = self._has_begun = False
        self._prepared: Prepared | None = None

    def begin(self, prepared: Prepared | None) -> bool:
        """Begin to carry the call out, and return whether somebody still waits for it."""
        with self._lock:
            self._has_begun, self._prepared = not self._is_left, prepared
            return self._has_begun

    def leave(self, *, is_late: bool) -> bool:
        """Stop waiting; return whether the caller is to be told now rather than by the call.

        Parameters
        ----------
        is_late
            Whether its time is up; otherwise its caller has gone.
        """
        with self._lock:
            prepared = self._prepared
            if not self._has_begun:
                self._is_left = True
                return True
        if prepared is None:
            return self._may_be_left
        if is_late:
            prepared.expire()
        else:
            prepared.cancel()
        return False


class Deadline:
    """A scheduled action, which :meth:`cancel` revokes."""

    __slots__ = ("action",)

    def __init__(self, action: Callable[[], None]) -> None:
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        """Revoke the action."""
        self.action = None


class Deadlines:
    """Runs short actions at their times; actions must not block.

    Examples
    --------
    >>> done = threading.Event()
    >>> deadlines = Deadlines()
    >>> deadline = deadlines.after(0.01, done.set)
    >>> done.wait(10)
    True
    >>> deadlines.close()
    """

    def __init__(self) -> None:
        self._ready = threading.Condition()
        self._heap: list[tuple[float, int, Deadline]] = []
        self._numbers = itertools.count()
        self._closed = False
        self._thread: threading.Thread | None = None

    def after(self, seconds: float, action: Callable[[], None]) -> Deadline:
        """Schedule an action after a number of seconds."""
        deadline = Deadline(action)
        with self._ready:
            entry = (time.monotonic() + seconds, next(self._numbers), deadline)
            heapq.heappush(self._heap, entry)
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="deadlines", daemon=True)
                self._thread.start()
            if self._heap[0] is entry:
                self._ready.notify()
        return deadline

    def close(self) -> None:
        """Stop; no further action runs."""
        with self._ready:
            self._closed = True
            self._ready.notify()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while (deadline := self._next()) is not None:
            action = deadline.action
            if action is None:
                continue
            try:
                action()
            except Exception:  # noqa: BLE001 - one action's fault is not the others'
                _log.exception("an action at its deadline failed")

    def _next(self) -> Deadline | None:
        """Wait for the next action and return it; none once closed."""
        with self._ready:
            while not self._closed:
                # Cancelled ones in front go at once, so that they hold nothing alive.
                while self._heap and self._heap[0][2].action is None:
                    heapq.heappop(self._heap)
                if not self._heap:
                    self._ready.wait()
                    continue
                left = self._heap[0][0] - time.monotonic()
                if left <= 0:
                    return heapq.heappop(self._heap)[2]
                self._ready.wait(min(left, threading.TIMEOUT_MAX))
            return None
