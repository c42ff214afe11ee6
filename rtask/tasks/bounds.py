"""Bounds of a plan: its queries see what the caller may read, and all of it ends in time."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Any, Protocol

from rtask.errors import SearchLimit
from rtask.sparql.results import Solutions

__all__ = ["QUERY_TIMEOUT_S", "TIMEOUT_S", "Bounds", "Selectable"]

QUERY_TIMEOUT_S = 10.0
"""Time limit of each query."""
TIMEOUT_S = 60.0
"""Time limit of a plan with all its queries."""


class Selectable(Protocol):
    """A graph, embedded or on a server."""

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT."""


class Bounds:
    """The queries and the search of one plan, which share a deadline.

    Parameters
    ----------
    graph
        What is asked.
    timeout_s
        Time until the deadline, s.
    reads
        IRIs of the only graphs that the caller may read; None for all.
    clock
        Current time, s.

    Examples
    --------
    >>> bounds = Bounds(None, timeout_s=1.0, clock=iter([0.0, 0.5, 1.5]).__next__)
    >>> bounds.require_time()
    >>> bounds.require_time()
    Traceback (most recent call last):
    rtask.errors.SearchLimit: planning was ended after 1 s: whether there is a plan is not known
    """

    def __init__(
        self,
        graph: Selectable | None,
        timeout_s: float = TIMEOUT_S,
        reads: Collection[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._graph, self._timeout_s, self._clock = graph, timeout_s, clock
        self._end_s = clock() + timeout_s
        self._options: dict[str, Any] = {}
        if reads is not None:
            self._options = {"default_graphs": sorted(reads), "named_graphs": sorted(reads)}

    def select(self, query: str) -> Solutions:
        """Evaluate a SELECT in the time that is left."""
        left_s = self._left_s()
        assert self._graph is not None
        return self._graph.select(query, timeout_s=min(left_s, QUERY_TIMEOUT_S), **self._options)

    def require_time(self) -> None:
        """Raise unless there is time left.

        Raises
        ------
        SearchLimit
            The time is up.
        """
        self._left_s()

    def _left_s(self) -> float:
        left_s = self._end_s - self._clock()
        if left_s <= 0:
            raise SearchLimit(
                f"planning was ended after {self._timeout_s:g} s: whether there is a plan is not "
                "known"
            )
        return left_s
