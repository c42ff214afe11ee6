"""Tracking of the objects on a table from one view to the next.

A robot that has just pushed an object knows that the segment now lying 3 cm further is that object.
Tracking only joins views of one robot at one table; identity across robots comes from recognition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from features.geometry import FloatArray
from features.perception import Seen

__all__ = ["TrackedObject", "Tracker"]

_STILL_M = 0.025
_MOVED_M = 0.09
_SAME_SIZE = 0.15
_BETWEEN_M, _COVERED_M, _MOST = 0.04, 0.008, 0.7
_SHIFTED_M = 0.010
"""By which a thing may have moved, or was seen wrongly, since the robot last looked there."""
_GROWN = 1.5
"""Sides differ by a tenth from view to view, so that a volume may do by a third."""


@dataclass
class TrackedObject:
    """An object on the table that is tracked through several views.

    Parameters
    ----------
    number
        Counts from 1 at each table.
    seen
        The latest view of it.
    object_iri
        Its IRI in the graph; empty if it has none yet.
    finished
        Whether nothing is left to do with it.
    visible
        Whether it is in the latest view of its side of the table.
    waiting
        Whether it is out of reach because others are in the way.
    gone
        Whether it was put into a box: what lies at its place now is another thing, such as one that
        touched it and was seen as a part of it.
    released
        Whether it was last let go over a box, out of the robot's sight: most likely it lies there,
        so that only what has its size, or is recognised, is taken for it.
    may_lie_in_box
        Whether something new lies in that box, of which the robot could not tell what it is: if the
        object is nowhere on the table in the end, that is it.
    met_sides
        Of the box around it as the robot began to handle it, m, shortest first, which stay as they
        are when the thing falls; empty = not handled yet.
    """

    number: int
    seen: Seen
    object_iri: str = ""
    finished: bool = False
    visible: bool = True
    waiting: bool = False
    gone: bool = False
    released: bool = False
    may_lie_in_box: bool = False
    met_sides: tuple[float, ...] = ()

    def meet(self) -> None:
        """Note that the robot begins to handle it; from here on it is one thing."""
        self.met_sides = self.met_sides or tuple(sorted(_size(self.seen)))

    @property
    def has_grown(self) -> bool:
        """Whether it is seen so much larger than it was that another thing is seen with it."""
        return bool(self.met_sides) and _volume(self.seen) > _GROWN * float(np.prod(self.met_sides))


class Tracker:
    """Tracks the objects on one table.

    An object may have moved up to 2.5 cm unnoticed (because a neighbour brushed it), the one just
    handled up to 9 cm (because it was pushed). If the handled one is nowhere near and there is one
    unknown object on the table, or one of its size among several, they are the same: it was dropped
    or rolled away.
    """

    def __init__(self) -> None:
        self.tracks: list[TrackedObject] = []
        self._numbers = count(1)
        self._glimpsed: dict[int, tuple[Seen, ...]] = {}

    def update(
        self, objects: Sequence[Seen], handled: TrackedObject | None = None, side: int | None = None
    ) -> list[TrackedObject]:
        """Match the objects of a new view to the known ones; return those in view.

        Parameters
        ----------
        objects
            Objects in one frame.
        handled
            The object that the robot has just touched, which may have moved further.
        side
            +1 if the view shows the left half of the table (y > 0), -1 for the right half; objects
            in the other half stay unchanged.
        """
        expected = [t for t in self.tracks if side is None or t.seen.position[1] * side >= 0]
        for track in expected:
            track.visible = False
        expected = [track for track in expected if not track.gone]
        matched = self._match(expected, objects, handled)
        for seen, match in zip(objects, matched, strict=True):
            if match is None:
                self.tracks.append(TrackedObject(next(self._numbers), seen))
            else:
                match.seen, match.visible = seen, True
        self._forget_parts(expected, handled)
        if handled is not None and handled.gone:
            self._forget_glimpses(handled.seen)
        if side is not None:
            self.note(objects, side)
        return [track for track in self.tracks if track.visible]

    def _match(
        self,
        expected: Sequence[TrackedObject],
        objects: Sequence[Seen],
        handled: TrackedObject | None,
    ) -> list[TrackedObject | None]:
        """Return the known thing that each object of a view is; None for what is new."""
        matched: list[TrackedObject | None] = [None] * len(objects)
        if expected and objects:
            cost = np.array(
                [[self._distance(track, seen, handled) for seen in objects] for track in expected]
            )
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                # Assignment pairs whatever is left over as well: 1 is as far as one thing moves.
                if cost[row, column] < 1.0:
                    matched[column] = expected[row]
        is_astray = handled in expected and handled not in matched
        if handled is not None and is_astray and not handled.finished:
            strangers = [column for column, match in enumerate(matched) if match is None]
            alike = [c for c in strangers if _alike(handled.seen, objects[c])]
            candidates = strangers if len(strangers) == 1 and not handled.released else alike
            if len(candidates) == 1:
                matched[candidates[0]] = handled
        return matched

    def _forget_glimpses(self, taken: Seen) -> None:
        """Forget where a thing stood that is in a box now, also as the other side showed it."""
        for side, objects in self._glimpsed.items():
            self.note([seen for seen in objects if not _is_still(seen, taken)], side)

    def _forget_parts(
        self, expected: Sequence[TrackedObject], handled: TrackedObject | None
    ) -> None:
        """Forget what was seen as a thing of its own and proves to be a part of another.

        A thing behind another is seen as two. Its parts show as one when that other is gone, or
        vanish together when one of them is grasped. Only what was not handled yet is forgotten: it
        has no history that could be lost, and is met anew should it be a thing after all.
        """
        for track in expected:
            if track.visible or track.met_sides or track.finished:
                continue
            gone_with = handled is not None and handled.gone and _are_near(track, handled)
            if gone_with or any(o.visible and _covers(o, track) for o in self.tracks):
                self.tracks.remove(track)

    @classmethod
    def same(cls, track: TrackedObject, objects: Sequence[Seen]) -> Seen | None:
        """Return the object of another view that lies where the thing was last seen, if any."""
        near = min(objects, key=lambda seen: cls._distance(track, seen, None), default=None)
        return near if near is not None and cls._distance(track, near, None) < 1 else None

    def finds(self, track: TrackedObject, objects: Sequence[Seen], side: int | None) -> bool:
        """Match the objects of another view if it shows a lost object; else change nothing."""
        before = [(former, former.seen, former.visible) for former in self.tracks]
        glimpsed = dict(self._glimpsed)
        self.update(objects, track, side)
        if track.visible:
            return True
        self._glimpsed = glimpsed
        self.tracks[:] = [former for former, *_ in before]
        for former, seen, visible in before:
            former.seen, former.visible = seen, visible
        return False

    def note(self, objects: Sequence[Seen], side: int) -> None:
        """Remember what stands on a half of the table, without tracking it."""
        self._glimpsed[side] = tuple(objects)

    def has_seen(self, side: int) -> bool:
        """Tell whether a half of the table was ever looked at."""
        return side in self._glimpsed

    def remembered(self, track: TrackedObject, objects: Sequence[Seen]) -> list[FloatArray]:
        """Return the points (n, 3), m, of what a view does not show, or shows cut off.

        What only an older view shows is as wide as it may have moved since.

        Parameters
        ----------
        track
            The thing to be grasped, which may have been seen before as well.
        objects
            Everything that the present view shows, on both halves of the table.
        """
        clouds = []
        for former in (seen for half in self._glimpsed.values() for seen in half):
            now = [seen for seen in objects if _is_still(seen, former)]
            if _is_still(track.seen, former) or any(not seen.touches_border for seen in now):
                continue
            clouds.append(former.points if now else _blurred(former.points))
        return clouds

    def in_view(self, side: int) -> list[TrackedObject]:
        """Return the objects of a half of the table (as in :meth:`update`) in the latest view."""
        return [
            candidate
            for candidate in self.tracks
            if candidate.visible and candidate.seen.position[1] * side >= 0
        ]

    @property
    def missing(self) -> list[TrackedObject]:
        """Unfinished objects that went out of sight."""
        return [track for track in self.tracks if not track.visible and not track.finished]

    def lost(self, object_iri: str) -> TrackedObject | None:
        """Return the missing object of that identity, if any."""
        return next((track for track in self.missing if track.object_iri == object_iri), None)

    def stray(self, newcomer: TrackedObject) -> TrackedObject | None:
        """Return the missing object that one that appeared elsewhere must be, if any.

        It is the only one of that size or, if a single one is missing, that one: a thing that leans
        on a wall or is partly hidden by it has another size, but is no larger than before. What was
        let go over a box out of sight is only met again by its size.
        """
        missing = self.missing
        alike = [track for track in missing if _alike(track.seen, newcomer.seen)]
        if len(alike) == 1:
            return alike[0]
        size = np.linalg.norm(_size(newcomer.seen)) / (1 + _SAME_SIZE)
        lost = [track for track in missing if not track.released]
        fits = len(missing) == len(lost) == 1 and size < np.linalg.norm(_size(lost[0].seen))
        return lost[0] if fits else None

    def fell_out(self, object_iri: str, newcomer: TrackedObject, is_likely: bool = False) -> bool:
        """Tell whether a thing may have been put into a box before: by its identity and its size.

        It may lie another way up than it stood. One that is likely to be it by its looks only has
        to be no larger: what leans on the wall of the box is partly hidden by it.
        """
        fits = _is_no_larger if is_likely else _differ_little
        size = sorted(_size(newcomer.seen))
        return any(
            track.gone and track.object_iri == object_iri and fits(size, sorted(_size(track.seen)))
            for track in self.tracks
        )

    def join(self, lost: TrackedObject, newcomer: TrackedObject) -> None:
        """Replace a lost object by the one found elsewhere."""
        self.tracks.remove(lost)
        newcomer.number, newcomer.object_iri = lost.number, lost.object_iri

    @staticmethod
    def _distance(track: TrackedObject, seen: Seen, handled: TrackedObject | None) -> float:
        """Return the distance that an object would have moved, relative to the permitted one."""
        allowed = _MOVED_M if track is handled else _STILL_M
        way = float(np.linalg.norm(track.seen.position - seen.position))
        unlike = 0.0
        if track.has_grown:  # where a pair has parted, the thing is the one that has its size
            ratios = np.array(sorted(_size(seen))) / track.met_sides
            unlike = float(np.abs(np.log(ratios)).max())
        return min(way / allowed + unlike, 1e3)


def _is_still(seen: Seen, former: Seen) -> bool:
    """Tell whether a thing may be one that an older view showed, which nobody has touched."""
    return float(np.linalg.norm(seen.position - former.position)) < _STILL_M


def _blurred(points: FloatArray) -> FloatArray:
    """Return points (n, 3), m, together with where they may be by now, on the same level."""
    angles = np.arange(8) * np.pi / 4
    moves = _SHIFTED_M * np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], axis=1)
    moves = np.vstack([np.zeros(3), moves]).astype(points.dtype)
    return (points[None] + moves[:, None]).reshape(-1, 3)


def _are_near(track: TrackedObject, other: TrackedObject) -> bool:
    """Tell whether two things, as they were last seen, are closer than one between them is wide."""
    away, _ = cKDTree(other.seen.points).query(track.seen.points, distance_upper_bound=_BETWEEN_M)
    return bool(np.isfinite(away).any())


def _covers(whole: TrackedObject, part: TrackedObject) -> bool:
    """Tell whether a thing is seen now where most of another one was seen before."""
    away, _ = cKDTree(whole.seen.points).query(part.seen.points, distance_upper_bound=_COVERED_M)
    return float(np.isfinite(away).mean()) > _MOST


def _volume(seen: Seen) -> float:
    return float(np.prod(_size(seen)))


def _size(seen: Seen) -> tuple[float, float, float]:
    return seen.shape.length, seen.shape.width, seen.shape.height


def _alike(first: Seen, other: Seen) -> bool:
    """Tell whether two views show things of one size."""
    return _differ_little(_size(first), _size(other))


def _is_no_larger(first: Sequence[float], other: Sequence[float]) -> bool:
    return bool(np.all(np.array(first) < np.array(other) * (1 + _SAME_SIZE)))


def _differ_little(first: Sequence[float], other: Sequence[float]) -> bool:
    ratios = np.array(first) / np.array(other)
    return bool(np.all(np.abs(ratios - 1) < _SAME_SIZE))
