"""Threads of which no single caller takes all.

A robot may have as many requests in progress as a lane has threads. In one queue for all, what it
sends at once would be in front of everybody else's: 32 updates that take their whole time kept
another robot's insert waiting for seconds.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

__all__ = ["FairPool"]

_Result = TypeVar("_Result")
_Work = tuple["Future[Any]", Callable[[], Any]]


class FairPool:
    """A thread pool with a share for each caller.

    Parameters
    ----------
    threads
        Number of threads.
    share
        Threads that one caller has at most; more of its work waits until some of it has ended.

    Examples
    --------
    >>> pool = FairPool(4, 2, "example")
    >>> pool.submit("nao-1", lambda: 2 + 2).result()
    4
    >>> pool.shutdown(wait=True)
    """

    def __init__(self, threads: int, share: int, name: str) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._share = share
        self._lock = threading.Lock()
        self._running: Counter[str] = Counter()
        self._waiting: dict[str, deque[_Work]] = {}

    @property
    def threads(self) -> ThreadPoolExecutor:
        """The threads themselves, for work of nobody in particular."""
        return self._pool

    def submit(self, who: str | None, work: Callable[[], _Result]) -> Future[_Result]:
        """Start work for a caller, or let it wait for the caller's other work.

        Parameters
        ----------
        who
            The caller; ``None`` for work without a share.
        """
        if who is None:
            return self._pool.submit(work)
        future: Future[_Result] = Future()
        with self._lock:
            if self._running[who] >= self._share:
                self._waiting.setdefault(who, deque()).append((future, work))
                return future
            self._running[who] += 1
        self._start(who, future, work)
        return future

    def _start(self, who: str, future: Future[Any], work: Callable[[], Any]) -> None:
        try:
            self._pool.submit(self._run, who, future, work)
        except RuntimeError as error:  # the pool was shut down
            self._end(who)
            if future.set_running_or_notify_cancel():
                future.set_exception(error)

    def _run(self, who: str, future: Future[Any], work: Callable[[], Any]) -> None:
        try:
            if not future.set_running_or_notify_cancel():
                return
            try:
                result = work()
            except BaseException as error:  # noqa: BLE001 - the future carries it
                future.set_exception(error)
            else:
                future.set_result(result)
        finally:
            self._end(who)

    def _end(self, who: str) -> None:
        """Give the caller's place to its next work, or free it."""
        with self._lock:
            queue = self._waiting.get(who)
            following = queue.popleft() if queue else None
            if not queue:
                self._waiting.pop(who, None)
            if following is None:
                self._running[who] -= 1
                if not self._running[who]:
                    del self._running[who]
        if following is not None:
            self._start(who, *following)

    def shutdown(self, *, wait: bool) -> None:
        """Accept no more work and cancel what waits; wait for the work under way if asked to."""
        with self._lock:
            left = [item for queue in self._waiting.values() for item in queue]
            self._waiting.clear()
        for future, _ in left:
            future.cancel()
        self._pool.shutdown(wait=wait, cancel_futures=True)
