"""Thread pool for calls: a slow call delays neither its robot's fast ones nor other robots."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

Job = Callable[[], None]

THREADS = 32
RUNNING_PER_SESSION = 8
WAITING_PER_SESSION = 32


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
