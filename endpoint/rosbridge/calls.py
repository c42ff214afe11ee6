"""Calls run off the reader: a slow one delays neither its robot's fast ones nor other robots."""

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
    """Calls of one session."""

    running: int = 0
    waiting: deque[Job] = field(default_factory=deque)


class CallQueue:
    """Threads that carry out calls, shared fairly.

    A session has at most :data:`RUNNING_PER_SESSION` calls in the threads' queue, so the calls
    that one robot piles up wait in its own lane. Jobs must not raise.

    Parameters
    ----------
    threads
        How many calls run at the same time.
    """

    def __init__(self, threads: int = THREADS) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="call")
        self._lock = threading.Lock()
        self._lanes: dict[Hashable, _Lane] = {}

    def submit(self, session: Hashable, job: Job) -> bool:
        """Queue a call; tell whether there was room for it."""
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
        """Drop what a session that ended still has waiting."""
        with self._lock:
            lane = self._lanes.get(session)
            if lane is not None:
                lane.waiting.clear()

    def load(self, session: Hashable) -> tuple[int, int]:
        """Return how many calls of a session run and wait."""
        with self._lock:
            lane = self._lanes.get(session, _Lane())
            return lane.running, len(lane.waiting)

    def close(self) -> None:
        """Let running calls end; what waits is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class Once:
    """Lets the first of several answers of a call through."""

    __slots__ = ("_done", "_lock")

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._done = False

    def __call__(self) -> bool:
        with self._lock:
            first, self._done = not self._done, True
        return first
