"""Facts of stored views: what the rest of the store says of each, computed when first asked for.

A view is compared with its object's other views and with the views of other objects that the
index proposes (those that its own descriptors vote for). The facts follow from what is stored now,
not from how it came to be stored: a new snapshot has facts of its own. Only the comparison of two
views, which never changes, is kept.
"""

from __future__ import annotations

import threading
import zlib
from collections import OrderedDict
from collections.abc import Callable
from typing import TypeVar

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
from features.recognition.index.snapshot import Snapshot, StoredView
from features.recognition.views.picture import ViewPicture

__all__ = ["StoreFacts"]

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")

_MAX_OWN, _MAX_OTHERS = 8, 6
"""Views of the same object, and of others, that a view is compared with."""
_MIN_VOTES = 6
_MAX_PAIRS, _MAX_PICTURES = 50_000, 256


class _Kept(OrderedDict[_Key, _Value]):
    """The values that were used last; safe to share between threads."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self._limit, self._lock = limit, threading.Lock()

    def get_or_make(self, key: _Key, make: Callable[[], _Value]) -> _Value:
        with self._lock:
            if key in self:
                self.move_to_end(key)
                return self[key]
        value = make()
        with self._lock:
            self[key] = value
            while len(self) > self._limit:
                self.popitem(last=False)
        return value


class StoreFacts:
    """Facts of the views of one index.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT within which a descriptor votes for a view.
    """

    def __init__(self, distance_cap: int) -> None:
        self._cap = distance_cap
        self._pairs: _Kept[tuple[str, str], ViewPair | None] = _Kept(_MAX_PAIRS)
        self._pictures: _Kept[str, ViewPicture | None] = _Kept(_MAX_PICTURES)
        self._facts: tuple[Snapshot, dict[int, ViewFacts]] | None = None

    def picture(self, snapshot: Snapshot, view: int) -> ViewPicture | None:
        """Return the picture of a stored view, None where none was kept or it is damaged."""
        stored = snapshot.stored_view(view)
        return self._pictures.get_or_make(
            _identity(snapshot, view, stored), lambda: _decoded(stored)
        )

    def of(self, snapshot: Snapshot, view: int) -> ViewFacts:
        """Return the facts of a view with a picture."""
        known = self._facts
        if known is None or known[0] is not snapshot:
            known = self._facts = (snapshot, {})
        if view not in known[1]:
            known[1][view] = self._computed(snapshot, view)
        return known[1][view]

    def pair(self, snapshot: Snapshot, view: int, other: int) -> ViewPair | None:
        """Return how a view agrees with another, in its own frame; None where it does not."""
        first, second = snapshot.stored_view(view), snapshot.stored_view(other)
        key = _identity(snapshot, view, first), _identity(snapshot, other, second)
        return self._pairs.get_or_make(
            key, lambda: self._compared(snapshot, view, other, first, second)
        )

    def _computed(self, snapshot: Snapshot, view: int) -> ViewFacts:
        picture = self.picture(snapshot, view)
        assert picture is not None
        rows, columns = grid_shape(picture.mask.shape, ComparisonParams())
        own = [self.pair(snapshot, view, other) for other in _siblings(snapshot, view)]
        others = [self.pair(snapshot, view, other) for other in self._proposed(snapshot, view)]
        return facts_of(
            len(snapshot.stored_view(view).keypoints),
            rows * columns,
            own,
            others,
        )

    def _proposed(self, snapshot: Snapshot, view: int) -> list[int]:
        """Return the views of other objects that a view's descriptors vote for."""
        matches = snapshot.match(snapshot.stored_view(view).descriptors)
        own = snapshot.object_of_view[view]
        votes = np.zeros(len(snapshot.alive), np.int64)
        for views, distances in (
            (matches.view, matches.nearest),
            (matches.rival_view, matches.rival),
        ):
            voted = views[(views >= 0) & (distances < self._cap)]
            votes += np.bincount(voted, minlength=len(votes))
        votes[snapshot.object_of_view == own] = 0
        return _first_by(votes, snapshot, _MAX_OTHERS, _MIN_VOTES)

    def _compared(
        self, snapshot: Snapshot, view: int, other: int, first: StoredView, second: StoredView
    ) -> ViewPair | None:
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


def _identity(snapshot: Snapshot, view: int, stored: StoredView) -> str:
    """Return a name of a view's content: a view may be replaced under the same IRI."""
    content = zlib.crc32(stored.picture, zlib.crc32(stored.keypoints.tobytes()))
    return f"{snapshot.view_iris[view]} {content:08x}"


def _decoded(stored: StoredView) -> ViewPicture | None:
    if len(stored.picture) == 0:
        return None
    try:
        return ViewPicture.from_bytes(stored.picture)
    except ValueError:
        return None
