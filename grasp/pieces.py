"""Queue of pieces of work, which gives another worker a piece that takes too long as well."""

from __future__ import annotations

import contextlib
import statistics
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Hashable, Sequence
from typing import TypeVar

__all__ = ["LOOK_S", "Pieces", "handed_out"]

J = TypeVar("J", bound=Hashable)

LOOK_S = 0.25
"""Time between two looks for pieces that take long."""
_SLOW, _SLOW_S = 4.0, 2.0
"""A piece is given to an idle worker as well when it takes this many times the median so far, and
at least so many seconds."""


class Pieces:
    """The pieces of one work: which wait, which have ended.

    Parameters
    ----------
    count
        How many there are; they are known by their numbers, from 0.
    """

    def __init__(self, count: int) -> None:
        self._todo = deque(range(count))
        self._open = set(self._todo)
        self._seconds: list[float] = []

    @property
    def is_going(self) -> bool:
        """Whether a piece has not ended."""
        return bool(self._open)

    def is_open(self, number: int) -> bool:
        """Tell whether a piece has not ended."""
        return number in self._open

    def next(self, doing: Sequence[tuple[int, float]]) -> int | None:
        """Return the number of a piece that waits, or else of one that takes long, or none.

        Parameters
        ----------
        doing
            The pieces that workers have, each with the time when it was given to that worker, s of
            :func:`time.monotonic`.
        """
        if self._todo:
            return self._todo.popleft()
        if not self._seconds:
            return None
        slow_s = max(_SLOW_S, _SLOW * statistics.median(self._seconds))
        holders = Counter(number for number, _ in doing)
        now = time.monotonic()
        late = [
            (since, number)
            for number, since in doing
            if number in self._open and holders[number] == 1 and now - since > slow_s
        ]
        return min(late)[1] if late else None

    def put_back(self, number: int) -> None:
        """Let a piece wait again, before all others."""
        if number not in self._todo:
            self._todo.appendleft(number)

    def ended(self, number: int, seconds: float | None = None) -> bool:
        """Note the end of a piece; tell whether it is the first one.

        Parameters
        ----------
        seconds
            How long it took; None = it failed, which says nothing about the others.
        """
        if number not in self._open:
            return False
        self._open.discard(number)
        if seconds is not None:
            self._seconds.append(seconds)
        with contextlib.suppress(ValueError):
            self._todo.remove(number)
        return True


def handed_out(
    count: int,
    seats: int,
    begin: Callable[[int], J],
    wait: Callable[[list[J], float], Sequence[J]],
    drop: Callable[[J], None],
) -> Generator[tuple[int, J], None, None]:
    """Carry out pieces at several seats at once, and yield number and job of each as it ends.

    A piece that takes much longer than the others is begun once more when a seat is free, and the
    first job that ends counts, so results must depend on the piece alone.

    Parameters
    ----------
    seats
        How many jobs there are at a time.
    begin
        Starts the job of a piece.
    wait
        Waits some seconds for one of the jobs to end, and returns those that have.
    drop
        Ends a job that is not wanted any more, or lets it go on unheeded.
    """
    pieces = Pieces(count)
    doing: dict[J, tuple[int, float]] = {}
    try:
        while pieces.is_going:
            while len(doing) < seats:
                number = pieces.next(list(doing.values()))
                if number is None:
                    break
                doing[begin(number)] = number, time.monotonic()
            for job in wait(list(doing), LOOK_S):
                number, since = doing.pop(job)
                if pieces.ended(number, time.monotonic() - since):
                    for other in [seat for seat, (same, _) in doing.items() if same == number]:
                        drop(other)
                    yield number, job
    finally:
        for job in doing:
            drop(job)
