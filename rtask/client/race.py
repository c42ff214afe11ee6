"""Race of a near and a far answer to one question (Kehoe 2014, 6.2, "Networking").

The far side knows more, but the link to it may be slow or cut; the near side, a slice of the graph
on the robot or a simpler method, always answers. Both are asked at once, and the robot goes on with
the best that is there in time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from rtask.errors import DeadlineError, UsageError

__all__ = ["Contender", "Raced", "race"]

T = TypeVar("T")
Side = Literal["local", "remote"]


@dataclass(frozen=True)
class Raced(Generic[T]):
    """The answer of a race.

    Parameters
    ----------
    value
        The answer.
    won_by
        Who gave it.
    is_partial
        Whether it is only the best so far, because the time was up.
    seconds
        From the question to the answer.
    """

    value: T
    won_by: Side
    is_partial: bool
    seconds: float


class Contender(Generic[T]):
    """One side of a race, as the function that answers sees it."""

    def __init__(self, changed: threading.Condition) -> None:
        self._changed = changed
        self._answers: list[T] = []
        self._is_live = True
        self.is_over = False
        self.error: Exception | None = None

    @property
    def may_count(self) -> bool:
        """Whether the answer may still count; a long function looks now and then."""
        return self._is_live

    def offer(self, answer: T) -> None:
        """Tell the best answer so far, which counts if the time is up before there is a better."""
        with self._changed:
            self._answers[:] = [answer]
            self._changed.notify_all()

    @property
    def answers(self) -> list[T]:
        """The last answer alone; empty while there is none, since None may be an answer."""
        return self._answers

    @property
    def is_answered(self) -> bool:
        """Whether the function has returned."""
        return self.is_over and self.error is None

    def run(self, function: Callable[[Contender[T]], T]) -> None:
        """Carry out the function and note its end."""
        try:
            answer = [function(self)]
        except Exception as error:  # noqa: BLE001 - the other side may have an answer
            self.error = error
            answer = self._answers
        with self._changed:
            self._answers, self.is_over = answer, True
            self._changed.notify_all()

    def drop(self) -> None:
        """Tell the function that its answer is not wanted any more."""
        self._is_live = False


def race(
    local: Callable[[Contender[T]], T],
    remote: Callable[[Contender[T]], T],
    *,
    patience_s: float = 0.05,
    deadline_s: float = 1.0,
    better: Callable[[T], Any] | None = None,
) -> Raced[T]:
    """Ask both sides at once and return the best answer that is there in time.

    The remote answer counts if it comes within ``patience_s``; afterwards the first answer does. At
    the deadline it is the best that a side offered so far.

    Parameters
    ----------
    local, remote
        Answer the question, each in a thread of its own; they get a :class:`Contender`, to which
        they may :meth:`~Contender.offer` answers on the way. The one that loses is told by
        :attr:`~Contender.may_count` and otherwise goes on by itself, so a report that it carries is
        not lost.
    patience_s
        How long a local answer waits for the remote one.
    deadline_s
        When the race ends, whoever has answered.
    better
        Score of an answer: where both sides have one, the higher counts. None = the remote one.

    Raises
    ------
    DeadlineError
        Nobody offered anything in time.
    Exception
        Both sides failed: the error of the local one, caused by that of the remote one.

    Examples
    --------
    >>> race(lambda _: "near", lambda _: "far", patience_s=10, deadline_s=20).won_by
    'remote'
    """
    if not 0 <= patience_s <= deadline_s:
        raise UsageError(f"patience_s={patience_s} must be from 0 to deadline_s={deadline_s}")
    began = time.monotonic()
    changed = threading.Condition()
    near: Contender[T] = Contender(changed)
    far: Contender[T] = Contender(changed)
    for side, function, name in ((far, remote, "remote"), (near, local, "local")):
        threading.Thread(target=side.run, args=(function,), name=name, daemon=True).start()

    def settled(until_s: float, is_patient: bool) -> bool:
        """Wait for an end of the race before a time; tell whether it has come."""

        def is_settled() -> bool:
            if far.is_answered or (near.is_over and far.is_over):
                return True
            return near.is_answered and not is_patient

        return changed.wait_for(is_settled, max(began + until_s - time.monotonic(), 0.0))

    with changed:
        # The near side alone is not waited for beyond patience; the far side knows more.
        in_time = settled(patience_s, True) or settled(deadline_s, False)
        near.drop()
        far.drop()
        seconds = time.monotonic() - began
        chosen = _chosen(near, far, better)
        if chosen is not None:
            won_by: Side = "remote" if chosen is far else "local"
            return Raced(chosen.answers[0], won_by, not chosen.is_answered, seconds)
    if in_time and near.error is not None:
        raise near.error from far.error
    raise DeadlineError(f"no answer within {deadline_s:g} s", timeout_s=deadline_s)


def _chosen(
    near: Contender[T], far: Contender[T], better: Callable[[T], Any] | None
) -> Contender[T] | None:
    """Return the side whose answer counts: a whole one before a partial one."""
    whole = [side for side in (far, near) if side.is_answered]
    sides = whole or [side for side in (far, near) if side.answers]
    if len(sides) == 2 and better is not None:
        return max(sides, key=lambda side: better(side.answers[0]))
    return sides[0] if sides else None
