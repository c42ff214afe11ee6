"""Votes of a stored view's descriptors for views of other objects, kept while the store changes.

Matching a view with everything that is stored takes longer the more is stored. A view that arrives
can only replace the neighbours that it comes closer than, so the votes of the other views are
brought up to date by comparing them with the new view alone.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.cascade import FAR, match_exact
from features.recognition.index.snapshot import Snapshot

__all__ = ["Changes", "Moment", "Place", "Votes", "cast_votes", "updated_votes"]

_NONE = np.empty(0, np.int64)
_MAX_ADDED = 64
"""More views that arrived since are matched with everything at once, by the index."""


class Place(NamedTuple):
    """A place in the sequence of changes: how many views had come, gone, and changed objects."""

    added: int = 0
    gone: int = 0
    relabelled: int = 0


_START = Place()


@dataclass(frozen=True, eq=False)
class Moment:
    """A snapshot, and its place in the sequence of changes.

    Parameters
    ----------
    snapshot
        Of the index.
    view_of : (s,) int64
        Number of a view in the snapshot by its serial number, -1 where it is not stored.
    place
        What is known at one place is known of every snapshot there.
    """

    snapshot: Snapshot
    view_of: NDArray[np.int64]
    place: Place = _START

    def numbers(self, serials: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers in the snapshot of those that are stored."""
        found = self.view_of[serials[serials < len(self.view_of)]]
        return found[found >= 0]


class Changes:
    """Which views came and went between the snapshots that were asked about; safe to share."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: Moment | None = None
        self._added: list[int] = []
        self._gone: list[int] = []

    def at(self, snapshot: Snapshot) -> Moment:
        """Return the place of a snapshot in the sequence."""
        with self._lock:
            if self._last is None or self._last.snapshot is not snapshot:
                self._last = self._next(self._last, snapshot)
            return self._last

    def between(
        self, first: Place, second: Place
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Return the serial numbers of what came and what went.

        None where views changed their objects in between, or the first place is the later one.
        """
        if first.relabelled != second.relabelled or not _is_before(first, second):
            return None
        with self._lock:
            added = self._added[first.added : second.added]
            gone = self._gone[first.gone : second.gone]
        return np.array(added, np.int64), np.array(gone, np.int64)

    def _next(self, last: Moment | None, snapshot: Snapshot) -> Moment:
        alive = np.flatnonzero(snapshot.alive)
        serials = snapshot.serials[alive]
        view_of = np.full(int(serials.max(initial=0)) + 1, -1, np.int64)
        view_of[serials] = alive
        if last is None:
            return Moment(snapshot, view_of)
        before = np.flatnonzero(last.view_of >= 0)
        self._added += np.setdiff1d(serials, before).tolist()
        self._gone += np.setdiff1d(before, serials).tolist()
        kept = np.intersect1d(before, serials)
        unmoved = _same_objects(last.snapshot, last.view_of[kept], snapshot, view_of[kept])
        changed = last.place.relabelled + (not unmoved)
        return Moment(snapshot, view_of, Place(len(self._added), len(self._gone), changed))


def _is_before(first: Place, second: Place) -> bool:
    return first.added <= second.added and first.gone <= second.gone


def _same_objects(
    first: Snapshot, views: NDArray[np.int64], second: Snapshot, others: NDArray[np.int64]
) -> bool:
    """Tell whether views show the same objects in two snapshots, in which numbers may differ."""
    here, there = first.object_of_view[views], second.object_of_view[others]
    common = min(len(first.object_iris), len(second.object_iris))
    if first.object_iris[:common] == second.object_iris[:common]:
        return bool(np.array_equal(here, there))
    names, other_names = first.object_iris, second.object_iris
    return all(names[a] == other_names[b] for a, b in zip(here, there, strict=True))


@dataclass(frozen=True, eq=False)
class Votes:
    """Neighbours of a view's n descriptors: the nearest, and the nearest of another object.

    Parameters
    ----------
    view, rival_view : (n,) int64
        Serial numbers of their views, 0 where there is none.
    nearest, rival : (n,) int32
        Squared distances.
    """

    view: NDArray[np.int64]
    nearest: NDArray[np.int32]
    rival_view: NDArray[np.int64]
    rival: NDArray[np.int32]

    def counted(self, moment: Moment, distance_cap: int) -> NDArray[np.int64]:
        """Return the votes (V,) for the views of a snapshot."""
        votes = np.zeros(len(moment.snapshot.alive), np.int64)
        for serials, distances in ((self.view, self.nearest), (self.rival_view, self.rival)):
            near = moment.view_of[serials[(serials > 0) & (distances < distance_cap)]]
            votes += np.bincount(near, minlength=len(votes))
        return votes


def cast_votes(moment: Moment, view: int) -> Votes:
    """Match a view with everything that is stored."""
    snapshot = moment.snapshot
    found = snapshot.match(snapshot.stored_view(view).descriptors)

    def serials(views: NDArray[np.int32]) -> NDArray[np.int64]:
        return np.where(views >= 0, snapshot.serials[views], 0)

    return Votes(serials(found.view), found.nearest, serials(found.rival_view), found.rival)


def updated_votes(
    votes: Votes,
    descriptors: UInt8Array,
    moment: Moment,
    added: NDArray[np.int64],
    gone: NDArray[np.int64],
) -> Votes | None:
    """Return the votes after views came and went, None where everything has to be matched again.

    Parameters
    ----------
    descriptors : (n, 128) uint8
        Of the view that votes.
    added, gone
        Serial numbers.
    """
    if len(gone) and np.isin(np.concatenate([votes.view, votes.rival_view]), gone).any():
        return None
    arrived = moment.numbers(added)
    if len(arrived) == 0:
        return votes
    if len(arrived) > _MAX_ADDED:
        return None
    snapshot = moment.snapshot
    blocks = [snapshot.stored_view(int(number)).descriptors for number in arrived]
    views = np.repeat(arrived, [len(block) for block in blocks])
    labels = snapshot.object_of_view
    row, nearest, rival_row, rival = match_exact(descriptors, np.concatenate(blocks), labels[views])
    serials = snapshot.serials[views] if len(views) else _NONE
    both = (
        (votes.view, votes.nearest, votes.rival_view, votes.rival),
        (_at(serials, row), nearest, _at(serials, rival_row), rival),
    )
    closer = nearest < votes.nearest
    view = np.where(closer, both[1][0], votes.view)
    winner = _labels(moment, view)
    rival_view, rival = np.zeros_like(view), np.full(len(view), FAR, np.int32)
    for first, distance, second, second_distance in both:
        is_own = _labels(moment, first) == winner
        candidate = np.where(is_own, second, first)
        away = np.where(is_own, second_distance, distance)
        better = (candidate > 0) & (away < rival)
        rival_view[better], rival[better] = candidate[better], away[better]
    return Votes(view, np.where(closer, nearest, votes.nearest), rival_view, rival)


def _at(serials: NDArray[np.int64], rows: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the serial numbers of rows, 0 where there is none."""
    if len(serials) == 0:
        return np.zeros(len(rows), np.int64)
    return np.where(rows >= 0, serials[rows], 0)


def _labels(moment: Moment, serials: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the objects of views by their serial numbers, -1 where there is none."""
    numbers = moment.view_of[serials]
    stored = (serials > 0) & (numbers >= 0)
    return np.where(stored, moment.snapshot.object_of_view[numbers], np.int32(-1))
