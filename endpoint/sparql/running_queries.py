"""The queries that run now: how many, whose, and how to stop one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from endpoint.access.auth import Caller
from endpoint.http.messages import RefusedError

_SHOWN = 2_000


@dataclass
class RunningQuery:
    """One query that has not ended.

    Parameters
    ----------
    id
        Request id.
    caller
        Who asked.
    text
        SPARQL.
    timeout_s
        What it may take.
    """

    id: str
    caller: Caller
    text: str
    timeout_s: float
    started: float = field(default_factory=time.monotonic)
    stopped: bool = False
    _stop: Callable[[], None] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Say how the query is ended; called at once if somebody ended it already."""
        with self._lock:
            self._stop = stop
            late = self.stopped
        if late:
            stop()

    def stop(self) -> None:
        """End the query; what makes its answer is ended by :meth:`on_stop`'s function."""
        with self._lock:
            self.stopped = True
            stop = self._stop
        if stop is not None:
            stop()

    def facts(self) -> dict[str, Any]:
        """Return what is shown of it."""
        return {
            "id": self.id,
            "caller": self.caller.name,
            "seconds": round(time.monotonic() - self.started, 3),
            "timeout": self.timeout_s,
            "query": self.text[:_SHOWN],
        }


class RunningQueries:
    """All queries of a server that run or wait.

    Parameters
    ----------
    allowed
        That run at once; as many again may wait.
    """

    def __init__(self, allowed: int) -> None:
        self.allowed = allowed
        self._lock = threading.Lock()
        self._running: dict[int, RunningQuery] = {}

    def begin(self, query: RunningQuery) -> Callable[[], None]:
        """Count a query in; call what is returned when it has ended.

        Raises
        ------
        RefusedError
            503 where as many run and wait as may.
        """
        key = id(query)
        with self._lock:
            if len(self._running) >= 2 * self.allowed:
                raise RefusedError(
                    503,
                    "busy",
                    f"{self.allowed} queries run and as many wait; try again",
                    headers=(("Retry-After", "1"),),
                )
            self._running[key] = query

        def end() -> None:
            with self._lock:
                self._running.pop(key, None)

        return end

    def visible_to(self, caller: Caller) -> list[RunningQuery]:
        """Return the queries that a caller may see and stop: its own; an admin's are all."""
        with self._lock:
            running = list(self._running.values())
        if caller.access.role == "admin":
            return running
        return [query for query in running if query.caller.key == caller.key]

    def stop_all(self) -> None:
        """End every query: the server stops."""
        with self._lock:
            running = list(self._running.values())
        for query in running:
            query.stop()

    def __len__(self) -> int:
        return len(self._running)
