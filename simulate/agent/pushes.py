"""Pushes of things in clutter that cannot be grasped as they lie."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from features.geometry import FloatArray
from features.perception import Perceived
from simulate.agent.crowd import touching
from simulate.agent.tracking import TrackedObject

__all__ = ["Pushes"]

_MAX_PUSHES_EACH = 2
FAILURES_BEFORE = 3
"""Attempts at a thing without success after which it is pushed."""


class Pusher(Protocol):
    """The part of a body that pushes; see :class:`simulate.agent.agent.Body`."""

    def push(
        self, points: FloatArray, others: Sequence[FloatArray], height: float, side: str, seed: int
    ) -> str: ...


class Pushes:
    """Pushes what touches other things and cannot be grasped; counts the pushes of each thing.

    What stands free is not pushed: nothing around it keeps the hand away, and it might fall. What
    is left alone beside others is taken up once more when one of them has been pushed or taken.

    Parameters
    ----------
    body
        Robot that pushes.
    """

    def __init__(self, body: Pusher) -> None:
        self._body = body
        self._made: dict[int, int] = {}
        self._left: set[int] = set()
        self._due: set[int] = set()
        self._resumed: set[int] = set()

    def are_due(self, track: TrackedObject, failures: int) -> bool:
        """Tell whether so many attempts at a thing failed that a push comes first."""
        return failures >= FAILURES_BEFORE * (1 + self._made.get(track.number, 0))

    def push(
        self, track: TrackedObject, view: Perceived, side: str, seed: int, is_pair: bool = False
    ) -> str:
        """Push a thing; return the reason code, empty if it is not to be pushed or cannot be.

        Parameters
        ----------
        is_pair
            Whether it may be two things that are seen as one.
        """
        is_pair = is_pair or track.has_grown
        made = self._made.get(track.number, 0)
        if made >= _MAX_PUSHES_EACH or not (is_pair or _is_crowded(track, view)):
            return ""
        others = [seen.points for seen in view.objects if seen is not track.seen]
        points = track.seen.points
        if is_pair:
            points, rest = _ends(points)
            others.append(rest)
        reason = self._body.push(points, others, view.table_height, side, seed)
        if reason:
            self._made[track.number] = made + 1
            self.note_move()
        return reason

    def leave(self, track: TrackedObject, view: Perceived) -> None:
        """Note a thing that is left alone for want of a grasp beside others, which may go yet."""
        if _is_crowded(track, view) and track.number not in self._resumed:
            self._left.add(track.number)

    def note_move(self) -> None:
        """Note that a thing was pushed or taken, so that others may have more room."""
        self._due |= self._left
        self._left.clear()

    def resume(self, tracks: Iterable[TrackedObject]) -> None:
        """Take up again those of the things in view that may have more room; each once."""
        for track in tracks:
            if track.number in self._due:
                track.finished = False
                self._due.discard(track.number)
                self._resumed.add(track.number)


def _is_crowded(track: TrackedObject, view: Perceived) -> bool:
    """Tell whether a thing touches others, or is seen as one with another that it came to touch."""
    return track.has_grown or any(track.seen is seen for seen in touching(view.objects))


def _ends(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) in two halves, cut in the middle of their longer side seen from above.

    Two things that are seen as one only part if one of them is pushed and the other is not.
    """
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    longest = np.linalg.svd(flat, full_matrices=False)[2][0]
    along = flat @ longest
    first = along > (along.min() + along.max()) / 2
    return points[first], points[~first]
