"""Queries that took long though they looked quick, so that similar ones are not tried again."""

from __future__ import annotations

import time
from collections.abc import Callable

from rtask.sparql.tokens import shape

__all__ = ["SlowShapes"]

FORGOTTEN_AFTER_S = 60.0
_MAX_SHAPES = 1_000


class SlowShapes:
    """Shapes of slow queries, each for a minute; may be used from any thread.

    Parameters
    ----------
    clock
        Returns seconds; tests pass their own.

    Examples
    --------
    >>> slow = SlowShapes()
    >>> slow.note("SELECT ?o { <urn:hub> <urn:to>+ ?o }")
    >>> "SELECT ?o { <urn:other> <urn:to>+ ?o }" in slow
    True
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._until: dict[str, float] = {}
        self._clock = clock

    def note(self, text: str) -> None:
        """Remember that a query was slow."""
        if len(self._until) >= _MAX_SHAPES:
            self._until.clear()
        self._until[shape(text)] = self._clock() + FORGOTTEN_AFTER_S

    def __contains__(self, text: str) -> bool:
        until = self._until.get(shape(text)) if self._until else None
        return until is not None and self._clock() < until
