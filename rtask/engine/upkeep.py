"""Thread that does what can wait in small steps, when nothing new has come for a while."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

__all__ = ["Upkeep"]

log = logging.getLogger(__name__)

_QUIET_S = 2.0
_REST = 2.0
"""Rest after a step, in durations of the step: requests come first."""


class Upkeep:
    """Background work in small steps; starts with the first announcement.

    Parameters
    ----------
    name
        Of the thread.
    step
        Does a little, and returns how much is left. What it raises ends the work until the next
        announcement, with a word in the log.
    quiet_s
        Time without an announcement after which the work begins.
    """

    def __init__(self, name: str, step: Callable[[], int], quiet_s: float = _QUIET_S) -> None:
        self._step, self._quiet_s = step, quiet_s
        self._changed = threading.Condition()
        self._announced = self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def announce(self) -> None:
        """Say that there may be work."""
        with self._changed:
            self._announced = True
            self._changed.notify()

    def close(self) -> None:
        """Stop after the current step."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while self._waited():
            try:
                while self._is_due():
                    started = time.perf_counter()
                    left = self._step()
                    if not left:
                        break
                    self._rest(_REST * (time.perf_counter() - started))
            except Exception:
                log.exception("%s stopped until something changes", self._thread.name)

    def _waited(self) -> bool:
        """Wait for an announcement, and for quiet after it; False when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._announced or self._closed)
            while self._announced and not self._closed:
                self._announced = False
                self._changed.wait(self._quiet_s)
            return not self._closed

    def _is_due(self) -> bool:
        with self._changed:
            return not self._closed and not self._announced

    def _rest(self, seconds: float) -> None:
        with self._changed:
            if not self._closed:
                self._changed.wait(seconds)
