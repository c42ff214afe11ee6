"""Register of the queries of a server: running, waiting, or abandoned after their time limit."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

from endpoint.access.auth import Caller
from endpoint.http.messages import RefusedError, Response
from endpoint.http.plan import RunningQuery

MAX_ABANDONED = 16


class RunningQueries:
    """All queries of a server that run or wait.

    Parameters
    ----------
    allowed
        Queries that run at once; as many again may wait.
    """

    def __init__(self, allowed: int) -> None:
        self.allowed = allowed
        self._lock = threading.Lock()
        self._running: dict[int, RunningQuery] = {}
        self._abandoned: set[Future[Response]] = set()

    def begin(self, query: RunningQuery) -> Callable[[], None]:
        """Register a query; call the returned function when it has ended.

        Raises
        ------
        RefusedError
            503 if as many queries run and wait as may.
        """
        if not self.try_begin(query):
            raise RefusedError(
                503,
                "busy",
                f"{self.allowed} queries are running and as many are waiting; try again",
                headers=(("Retry-After", "1"),),
            )
        return lambda: self.end(query)

    def try_begin(self, query: RunningQuery) -> bool:
        """Register a query if there is room; call :meth:`end` when it has ended."""
        with self._lock:
            if len(self._running) >= 2 * self.allowed:
                return False
            self._running[id(query)] = query
            return True

    def end(self, query: RunningQuery) -> None:
        """Forget a query that has ended."""
        with self._lock:
            self._running.pop(id(query), None)

    def visible_to(self, caller: Caller) -> list[RunningQuery]:
        """Return the queries that a caller may see and stop: all for an admin, else its own."""
        with self._lock:
            running = list(self._running.values())
        if caller.access.role == "admin":
            return running
        return [query for query in running if query.owner == caller.key]

    def stop_all(self) -> None:
        """Stop every query because the server stops."""
        with self._lock:
            running = list(self._running.values())
        for query in running:
            query.stop()

    def __len__(self) -> int:
        return len(self._running)

    def abandon(self, work: Future[Response]) -> None:
        """Cancel work past its time limit, or keep count of its thread until that ends."""
        if not work.cancel():
            self._abandoned.add(work)
            work.add_done_callback(self._forget)

    def _forget(self, work: Future[Response]) -> None:
        self._abandoned.discard(work)
        response = None if work.cancelled() else work.result()
        if response is not None and response.chunks is not None:
            response.chunks.close()

    def has_stuck_threads(self) -> bool:
        """Tell whether threads of abandoned queries are still running."""
        return any(not work.done() for work in self._abandoned)

    @property
    def has_room(self) -> bool:
        """Whether few enough abandoned queries are still running."""
        return len(self._abandoned) < MAX_ABANDONED

    def check_room(self) -> None:
        """Refuse a query while too many abandoned ones are still running.

        Raises
        ------
        RefusedError
            503, with the time to wait.
        """
        if not self.has_room:
            raise RefusedError(
                503,
                "busy",
                f"{MAX_ABANDONED} queries are still running past their time limit; try again later",
                headers=(("Retry-After", "30"),),
            )
