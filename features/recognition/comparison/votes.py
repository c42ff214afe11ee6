"""Votes of a stored view's descriptors for views of other objects, kept while the store changes.

Matching a view with everything that is stored takes longer the more is stored. A view that arrives
can only replace the neighbours that it comes closer than, so the votes of the other views are
brought up to date by comparing them with the new view alone.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.comparison.facts_file import FactsFile, FiledView, content_digest
from features.recognition.index.nearest import FAR, nearest_rows
from features.recognition.index.snapshot import Snapshot

__all__ = [
    "MAX_ADDED",
    "NO_VOTES",
    "Changes",
    "Moment",
    "Votes",
    "cast_votes",
    "filed_view",
    "updated_votes",
]

MAX_ADDED = 64
"""More views that arrived since are matched with everything at once, by the index."""


@dataclass(frozen=True, eq=False)
class Moment:
    """A snapshot, and its place in the sequence of changes.

    Parameters
    ----------
    snapshot
        Of the index.
    numbers : (V,) int64
        What each view is called in the sequence, 0 where it was removed. A view whose content or
        object is another one has another number.
    view_of : (s,) int64
        The view in the snapshot by its number, -1 where it is not stored.
    place
        How many changes there were. What is known at one place is known of every snapshot there.
    """

    snapshot: Snapshot
    numbers: NDArray[np.int64]
    view_of: NDArray[np.int64]
    place: int

    def stored(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the views in the snapshot of those numbers that are stored."""
        views = self.view_of[numbers[numbers < len(self.view_of)]]
        return views[views >= 0]


class Changes:
    """Views that came and went between the snapshots that were asked about; safe to share.

    Parameters
    ----------
    file
        What an earlier process knew: views that are stored as they were keep their numbers.
    """

    def __init__(self, file: FactsFile | None = None) -> None:
        self._lock = threading.Lock()
        self._last: Moment | None = None
        self._log: list[int] = [] if file is None else list(file.changes)
        before = [] if file is None else file.views
        self._before = {view.iri: view for view in before}
        self._present = np.array([view.id for view in before], np.int64)
        self._next_number = 1 + max((abs(number) for number in self._log), default=0)
        self._number_of_serial = np.zeros(1, np.int64)
        self._object_of_number = np.full(self._next_number, -1, np.int64)
        self._objects: dict[str, int] = {}

    def at(self, snapshot: Snapshot) -> Moment:
        """Return the place of a snapshot in the sequence."""
        with self._lock:
            if self._last is None or self._last.snapshot is not snapshot:
                self._last = self._next(snapshot)
            return self._last

    def latest(self) -> Moment | None:
        """Return the moment that was asked about last; its place is the end of the sequence."""
        with self._lock:
            return self._last

    def between(
        self, first: int, second: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Return the numbers of what came and what went, None where the first place is later."""
        if first > second:
            return None
        with self._lock:
            changes = np.array(self._log[first:second], np.int64)
        return changes[changes > 0], -changes[changes < 0]

    def since(self, place: int) -> list[int]:
        """Return the numbers of what came and, with a minus, went, from a place on, in order."""
        with self._lock:
            return self._log[place:]

    def _next(self, snapshot: Snapshot) -> Moment:
        alive = np.flatnonzero(snapshot.alive)
        chosen = self._numbered(snapshot, alive)
        numbers = np.zeros(len(snapshot.alive), np.int64)
        numbers[alive] = chosen
        self._log += (-np.setdiff1d(self._present, chosen)).tolist()
        self._log += np.setdiff1d(chosen, self._present).tolist()
        self._present = chosen
        view_of = np.full(self._next_number, -1, np.int64)
        view_of[chosen] = alive
        return Moment(snapshot, numbers, view_of, len(self._log))

    def _numbered(self, snapshot: Snapshot, alive: NDArray[np.intp]) -> NDArray[np.int64]:
        """Return the numbers of the stored views, new ones for those that have none."""
        names = [self._objects.setdefault(o, len(self._objects)) for o in snapshot.object_iris]
        objects = np.array(names, np.int64)[snapshot.object_of_view[alive]]
        serials = snapshot.serials[alive]
        missing = int(serials.max(initial=0)) + 1 - len(self._number_of_serial)
        self._number_of_serial = np.pad(self._number_of_serial, (0, max(missing, 0)))
        numbers = self._number_of_serial[serials]
        is_new = (numbers == 0) | (self._object_of_number[numbers] != objects)
        for row in np.flatnonzero(is_new).tolist():
            numbers[row] = self._earlier_number(snapshot, int(alive[row])) or self._next_number
            self._next_number = max(self._next_number, int(numbers[row]) + 1)
        room = self._next_number - len(self._object_of_number)
        self._object_of_number = np.pad(self._object_of_number, (0, room), constant_values=-1)
        self._object_of_number[numbers] = objects
        self._number_of_serial[serials] = numbers
        self._before = {}  # whoever was not met at the start is gone
        return numbers

    def _earlier_number(self, snapshot: Snapshot, view: int) -> int:
        """Return the number that an earlier process gave to the same content, 0 where none."""
        filed = self._before.get(snapshot.view_iris[view])
        if filed is None:
            return 0
        now = filed_view(filed.id, snapshot, view)
        return filed.id if now == filed else 0


def filed_view(number: int, snapshot: Snapshot, view: int) -> FiledView:
    """Return by what a file knows a stored view again: its IRI, object, and digest."""
    stored = snapshot.stored_view(view)
    digest = content_digest(
        snapshot.look(view).tobytes(), stored.keypoints.tobytes(), bytes(stored.picture[:64])
    )
    object_iri = snapshot.object_iris[snapshot.object_of_view[view]]
    return FiledView(number, snapshot.view_iris[view], object_iri, digest)


@dataclass(frozen=True, eq=False)
class Votes:
    """Neighbours of a view's n descriptors: the nearest, and the nearest of another object.

    Parameters
    ----------
    view, rival_view : (n,) int64
        Numbers of their views, 0 where there is none.
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
        for numbers, distances in ((self.view, self.nearest), (self.rival_view, self.rival)):
            near = moment.view_of[numbers[(numbers > 0) & (distances < distance_cap)]]
            votes += np.bincount(near, minlength=len(votes))
        return votes


NO_VOTES = Votes(
    np.empty(0, np.int64), np.empty(0, np.int32), np.empty(0, np.int64), np.empty(0, np.int32)
)
"""Of a view that has not voted."""


def cast_votes(moment: Moment, view: int) -> Votes:
    """Match a view with everything that is stored."""
    snapshot = moment.snapshot
    votes = snapshot.match(snapshot.stored_view(view).descriptors)

    def numbers(views: NDArray[np.int32]) -> NDArray[np.int64]:
        return np.where(views >= 0, moment.numbers[views], 0)

    return Votes(numbers(votes.view), votes.nearest, numbers(votes.rival_view), votes.rival)


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
        Numbers of views.
    """
    if len(gone) and np.isin(np.concatenate([votes.view, votes.rival_view]), gone).any():
        return None
    arrived = moment.stored(added)
    if len(arrived) == 0:
        return votes
    if len(arrived) > MAX_ADDED:
        return None
    snapshot = moment.snapshot
    blocks = [snapshot.stored_view(int(row)).descriptors for row in arrived]
    first, nearest, second, rival = nearest_views(
        descriptors, blocks, snapshot.object_of_view[arrived]
    )
    numbers = np.append(moment.numbers[arrived], 0)  # the last is none
    both = (
        (votes.view, votes.nearest, votes.rival_view, votes.rival),
        (numbers[first], nearest, numbers[second], rival),
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


def nearest_views(
    query: UInt8Array, blocks: Sequence[UInt8Array], labels: NDArray[np.int32]
) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.intp], NDArray[np.int32]]:
    """Return the nearest view of each descriptor, and the nearest with another label.

    The answer is that of :func:`match_exact`; views one by one, whose distances stay in the cache,
    take half of the time of all at once.

    Parameters
    ----------
    query : (n, 128) uint8
    blocks : (m, 128) uint8 each
        Descriptors of the views.
    labels : (views,) int32

    Returns
    -------
    first, nearest, second, rival
        Positions (n,) among the views and squared distances; -1 and ``FAR`` where there is none.
    """
    n = len(query)
    first, second = np.full(n, -1), np.full(n, -1)
    nearest, rival = np.full(n, FAR, np.int32), np.full(n, FAR, np.int32)
    label_of = np.append(labels, -1)
    for k, block in enumerate(blocks):
        if len(block) == 0 or n == 0:
            continue
        distance = nearest_rows(query, block)[1]
        closer, other = distance < nearest, label_of[first] != labels[k]
        # What was nearest is the rival of another label; of the same one, the rival stays.
        moved = closer & other
        second, rival = np.where(moved, first, second), np.where(moved, nearest, rival)
        next_best = ~closer & other & (distance < rival)
        second, rival = np.where(next_best, k, second), np.where(next_best, distance, rival)
        first, nearest = np.where(closer, k, first), np.where(closer, distance, nearest)
    return first, nearest, second, rival


def _labels(moment: Moment, numbers: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the objects of views by their numbers, -1 where there is none."""
    views = moment.view_of[numbers]
    is_stored = (numbers > 0) & (views >= 0)
    return np.where(is_stored, moment.snapshot.object_of_view[views], np.int32(-1))
