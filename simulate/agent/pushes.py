"""Pushes of things in clutter that cannot be grasped as they lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from features.geometry import FloatArray
from features.perception import Perceived
from simulate.agent.crowd import touching
from simulate.agent.tracking import TrackedObject

__all__ = ["Pushes"]

_MOST_PER_THING = 2
FAILURES_BEFORE = 3
"""Attempts at a thing without success after which it is pushed."""


class Pusher(Protocol):
    """The part of a body that pushes; see :class:`simulate.agent.agent.Body`."""

    @property
    def takes_poses(self) -> bool: ...

    def push(
        self, points: FloatArray, others: Sequence[FloatArray], height: float, side: str, seed: int
    ) -> str: ...


class Pushes:
    """Pushes what touches other things and cannot be grasped; counts the pushes of each thing.

    What stands free is not pushed: nothing around it keeps the hand away, and it might fall.

    Parameters
    ----------
    body
        Robot that pushes.
    """

    def __init__(self, body: Pusher) -> None:
        self._body = body
        self._made: dict[int, int] = {}

    def are_due(self, thing: TrackedObject, failures: int) -> bool:
        """Tell whether so many attempts at a thing failed that a push comes first."""
        return failures >= FAILURES_BEFORE * (1 + self._made.get(thing.number, 0))

    def push(self, thing: TrackedObject, view: Perceived, side: str, seed: int) -> str:
        """Push a thing; return the reason code, empty if it is not to be pushed or cannot be."""
        made = self._made.get(thing.number, 0)
        is_crowded = any(thing.seen is seen for seen in touching(view.objects))
        if not self._body.takes_poses or not is_crowded or made >= _MOST_PER_THING:
            return ""
        others = [seen.points for seen in view.objects if seen is not thing.seen]
        reason = self._body.push(thing.seen.points, others, view.table_height, side, seed)
        if reason:
            self._made[thing.number] = made + 1
        return reason
