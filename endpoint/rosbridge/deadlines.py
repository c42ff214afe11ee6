"""Timer thread for the deadlines of calls that may never be answered."""

from __future__ import annotations

import heapq
import itertools
import logging
import threading
import time
from collections.abc import Callable

_log = logging.getLogger(__name__)


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
                self._ready.wait(left)
            return None
