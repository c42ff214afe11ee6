"""Facts of stored views: what the rest of the store says of each, computed when first asked for.

A view is compared with its object's other views and with the views of other objects that the
index proposes (those that its own descriptors vote for). The facts follow from what is stored now,
not from how it came to be stored. What does not change is kept: the comparison of two views, and
the facts of a view as long as those that it is compared with are the same ones.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import align_views
from features.recognition.comparison.difference import (
    ComparisonParams,
    compare_pictures,
    grid_shape,
)
from features.recognition.comparison.evidence import ViewFacts
from features.recognition.comparison.support import MIN_MATCHES, ViewPair, facts_of, view_pair
from features.recognition.comparison.votes import (
    Changes,
    Moment,
    Place,
    Votes,
    cast_votes,
    updated_votes,
)
from features.recognition.index.snapshot import Snapshot, StoredView
from features.recognition.views.picture import ViewPicture

__all__ = ["StoreFacts"]

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")

_MAX_OWN, _MAX_OTHERS = 8, 6
"""Views of the same object, and of others, that a view is compared with."""
_MIN_VOTES = 6
_MAX_KNOWN, _MAX_PAIRS, _MAX_PICTURES = 10_000, 50_000, 256


class _Kept(Generic[_Key, _Value]):
    """The values that were used last; safe to share between threads."""

    def __init__(self, limit: int) -> None:
        self._values: OrderedDict[_Key, _Value] = OrderedDict()
        self._limit, self._lock = limit, threading.Lock()

    def __contains__(self, key: object) -> bool:
        with self._lock:
            return key in self._values

    def get(self, key: _Key) -> _Value | None:
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: _Key, value: _Value) -> _Value:
        with self._lock:
            self._values[key] = value
            while len(self._values) > self._limit:
                self._values.popitem(last=False)
        return value


@dataclass(frozen=True, eq=False)
class _Known:
    """A view's facts, with what they follow from; views by their serial numbers."""

    place: Place
    votes: Votes
    own: tuple[int, ...]
    others: tuple[int, ...]
    facts: ViewFacts


class StoreFacts:
    """Facts of the views of one index.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT within which a descriptor votes for a view.
    """

    def __init__(self, distance_cap: int) -> None:
        self._cap = distance_cap
        self._changes = Changes()
        self._known: _Kept[int, _Known] = _Kept(_MAX_KNOWN)
        self._pairs: _Kept[tuple[int, int], tuple[ViewPair | None]] = _Kept(_MAX_PAIRS)
        self._pictures: _Kept[int, tuple[ViewPicture | None]] = _Kept(_MAX_PICTURES)

    def picture(self, snapshot: Snapshot, view: int) -> ViewPicture | None:
        """Return the picture of a stored view, None where none was kept or it is damaged."""
        key = int(snapshot.serials[view])
        held = self._pictures.get(key)
        if held is None:
            held = self._pictures.put(key, (_decoded(snapshot.stored_view(view)),))
        return held[0]

    def of(self, snapshot: Snapshot, view: int) -> ViewFacts:
        """Return the facts of a view with a picture."""
        return self._current(snapshot, view).facts

    def prepare(self, snapshot: Snapshot, views: Iterable[int]) -> None:
        """Compute the facts of new views, and those that they change, before they are asked for.

        Of the views that they are compared with only those are brought up to date whose facts had
        been computed before.
        """
        moment = self._changes.at(snapshot)
        for view in views:
            if self.picture(snapshot, view) is None:
                continue
            known = self._current(snapshot, view)
            for serial in (*known.own, *known.others):
                if serial in self._known:
                    self._current(snapshot, int(moment.view_of[serial]))

    def pair(self, snapshot: Snapshot, view: int, other: int) -> ViewPair | None:
        """Return how a view agrees with another, in its own frame; None where it does not."""
        key = int(snapshot.serials[view]), int(snapshot.serials[other])
        held = self._pairs.get(key)
        if held is None:
            held = self._pairs.put(key, (self._compared(snapshot, view, other),))
        return held[0]

    def _current(self, snapshot: Snapshot, view: int) -> _Known:
        moment, serial = self._changes.at(snapshot), int(snapshot.serials[view])
        known = self._known.get(serial)
        if known is not None and known.place == moment.place:
            return known
        return self._known.put(serial, self._brought_up(known, moment, view))

    def _brought_up(self, known: _Known | None, moment: Moment, view: int) -> _Known:
        """Return what is known of a view at a moment, with as much of what was known as holds."""
        snapshot = moment.snapshot
        changes = None if known is None else self._changes.between(known.place, moment.place)
        votes = own = None
        if known is not None and changes is not None:
            added, gone = changes
            descriptors = snapshot.stored_view(view).descriptors
            votes = updated_votes(known.votes, descriptors, moment, added, gone)
            arrived = snapshot.object_of_view[moment.numbers(added)]
            if len(gone) == 0 and not (arrived == snapshot.object_of_view[view]).any():
                own = known.own
        votes = votes or cast_votes(moment, view)
        if own is None:
            own = tuple(int(snapshot.serials[k]) for k in _siblings(snapshot, view))
        others = tuple(int(snapshot.serials[k]) for k in self._proposed(moment, view, votes))
        if known is not None and (own, others) == (known.own, known.others):
            return _Known(moment.place, votes, own, others, known.facts)
        return _Known(moment.place, votes, own, others, self._computed(moment, view, own, others))

    def _computed(
        self, moment: Moment, view: int, own: tuple[int, ...], others: tuple[int, ...]
    ) -> ViewFacts:
        snapshot = moment.snapshot
        picture = self.picture(snapshot, view)
        assert picture is not None
        rows, columns = grid_shape(picture.mask.shape, ComparisonParams())
        pairs, other_pairs = (
            [self.pair(snapshot, view, int(moment.view_of[serial])) for serial in serials]
            for serials in (own, others)
        )
        return facts_of(
            len(snapshot.stored_view(view).keypoints), rows * columns, pairs, other_pairs
        )

    def _proposed(self, moment: Moment, view: int, votes: Votes) -> list[int]:
        """Return the views of other objects that a view's descriptors vote for."""
        snapshot = moment.snapshot
        counted = votes.counted(moment, self._cap)
        counted[snapshot.object_of_view == snapshot.object_of_view[view]] = 0
        return _first_by(counted, snapshot, _MAX_OTHERS, _MIN_VOTES)

    def _compared(self, snapshot: Snapshot, view: int, other: int) -> ViewPair | None:
        first, second = snapshot.stored_view(view), snapshot.stored_view(other)
        here, there = self.picture(snapshot, view), self.picture(snapshot, other)
        side_px = float(snapshot.measures(np.array([view]))[0, 0])
        if here is None or there is None:
            return None
        found = align_views(first, second, side_px)
        if found is None or len(found) < MIN_MATCHES:
            return None
        places = first.keypoints[found.query_rows, :2]
        return view_pair(found, compare_pictures(here, there, found.query_from_view, places))


def _siblings(snapshot: Snapshot, view: int) -> list[int]:
    """Return the other views of the same object, those that look most alike where many are."""
    same = (snapshot.object_of_view == snapshot.object_of_view[view]) & snapshot.alive
    same[view] = False
    if np.count_nonzero(same) <= _MAX_OWN:
        return [int(k) for k in np.flatnonzero(same)]
    alike = np.where(same, snapshot.appearance(snapshot.look(view)), -1)
    return _first_by(alike, snapshot, _MAX_OWN, 0)


def _first_by(
    worth: NDArray[np.integer] | NDArray[np.floating], snapshot: Snapshot, count: int, least: float
) -> list[int]:
    """Return the views of most worth; equal ones in the order of their IRIs, not of arrival."""
    chosen = np.flatnonzero(worth >= least)
    if len(chosen) > count:
        limit = np.partition(worth[chosen], len(chosen) - count)[len(chosen) - count]
        chosen = chosen[worth[chosen] >= limit]
    ranked = sorted(chosen.tolist(), key=lambda k: (-worth[k], snapshot.view_iris[k]))
    return ranked[:count]


def _decoded(stored: StoredView) -> ViewPicture | None:
    if len(stored.picture) == 0:
        return None
    try:
        return ViewPicture.from_bytes(stored.picture)
    except ValueError:
        return None
