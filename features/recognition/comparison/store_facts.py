"""Facts of stored views: what the rest of the store says of each, computed once and kept.

A view is compared with its object's other views and with the views of other objects that the
index proposes (those that its own descriptors vote for). The facts follow from what is stored now,
not from how it came to be stored. What does not change is kept, beside the index where it has a
folder: the comparison of two views, and the facts of a view as long as those that it is compared
with are the same ones.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import Alignment, align_views
from features.recognition.comparison.difference import (
    ComparisonParams,
    compare_pictures,
    grid_shape,
)
from features.recognition.comparison.evidence import ViewFacts
from features.recognition.comparison.facts_file import FactsFile, Record
from features.recognition.comparison.kept import Kept
from features.recognition.comparison.known import Known
from features.recognition.comparison.same_print import MIN_SAME_PRINT
from features.recognition.comparison.support import (
    MIN_MATCHES,
    ViewPair,
    facts_of,
    keypoints_only,
    view_pair,
)
from features.recognition.comparison.votes import (
    MAX_ADDED,
    NO_VOTES,
    Changes,
    Moment,
    Votes,
    cast_votes,
    filed_view,
    updated_votes,
)
from features.recognition.index.snapshot import Snapshot, StoredView
from features.recognition.views.picture import ViewPicture
from features.recognition.views.view import EXTRACTOR

__all__ = ["Neighbours", "StoreFacts"]

_MAX_OWN, _MAX_OTHERS = 8, 6
"""Views of the same object, and of others, that a view is compared with."""
_MIN_VOTES = 6
_MAX_VOTED, _MAX_MORE, _MAX_ALIKE = 200, 12, 6
"""Views that are looked through for more neighbours; how many are taken by votes, and by looks."""
_MAX_RECORDS, _MAX_AT_HAND, _MAX_PICTURES = 10_000, 2_000, 256
"""Views of which something is kept in memory: without a file, and beside one; and pictures."""
_MAX_PAIRS = 32
"""Comparisons of a view that are kept until it is asked for, and only those that count remain."""
_MAX_UNWRITTEN = 32
_MAX_BEHIND = 20
"""What is known of a view is outdated when one in so many views has changed since."""
_NEVER = 2**62
_RULES = f"1 {EXTRACTOR} {_MAX_OWN} {_MAX_OTHERS} {_MIN_VOTES} {ComparisonParams()}"
"""What is kept follows from these; the first number counts changes of how it follows."""


Before = tuple[Known | None, Known | None]
"""Facts about a view at an earlier moment: whole, and in part."""


@dataclass(frozen=True)
class Neighbours:
    """Views that a view may agree with: of its own object, and of others by falling votes."""

    own: tuple[int, ...]
    others: tuple[int, ...]


class StoreFacts:
    """Facts of the views of one index.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT within which a descriptor votes for a view.
    path
        File that keeps them beyond this process; None = in memory only.
    """

    def __init__(self, distance_cap: int, path: Path | None = None) -> None:
        self._cap = distance_cap
        self._file = None if path is None else FactsFile(path, f"{_RULES} {distance_cap}")
        self._changes = Changes(self._file)
        self._known: Kept[int, Known] = Kept(_MAX_RECORDS if path is None else _MAX_AT_HAND)
        self._pictures: Kept[int, tuple[ViewPicture | None]] = Kept(_MAX_PICTURES)
        self._alignments: Kept[tuple[int, int], tuple[Alignment | None]] = Kept(_MAX_PICTURES)
        self._facts: Kept[int, tuple[Mapping[int, ViewPair | None], ViewFacts]]
        self._facts = Kept(_MAX_AT_HAND)
        self._writing, self._unwritten = threading.Lock(), dict[int, Known]()
        self._filed = np.array([v.id for v in self._file.views] if self._file else [], np.int64)
        self._filed_place = len(self._changes.since(0))
        self._places = {} if self._file is None else self._file.places()

    def picture(self, snapshot: Snapshot, view: int) -> ViewPicture | None:
        """Return the picture of a stored view, None where none was kept or it is damaged."""
        key = int(snapshot.serials[view])  # a picture stays when its object changes
        held = self._pictures.get(key)
        if held is None:
            held = self._pictures.put(key, (_decoded(snapshot.stored_view(view)),))
        return held[0]

    def aligned(self, snapshot: Snapshot, view: int, other: int) -> Alignment | None:
        """Return the alignment of a stored view with another one, in the first one's frame."""
        key = int(snapshot.serials[view]), int(snapshot.serials[other])
        held = self._alignments.get(key)
        if held is None:
            first, second = snapshot.stored_view(view), snapshot.stored_view(other)
            side_px = float(snapshot.measures(np.array([view]))[0, 0])
            held = self._alignments.put(key, (align_views(first, second, side_px),))
        return held[0]

    def of(self, snapshot: Snapshot, view: int) -> ViewFacts:
        """Return the facts of a view with a picture."""
        return self._cached_facts(snapshot, view, self._current(snapshot, view), 1)

    def of_keypoints(self, snapshot: Snapshot, view: int) -> ViewFacts:
        """Return the facts of a view with a picture, the support of its cells perhaps left out.

        Without it no pictures are compared, which is half of the work.
        """
        record = self._current(snapshot, view, drawn=False)
        if record.is_drawn:
            return self._cached_facts(snapshot, view, record, 1)
        return self._followed(snapshot, view, record)

    def supported(self, snapshot: Snapshot, view: int) -> ViewFacts:
        """Return the facts of a view with a picture that its object's other views alone give.

        The view is not matched with everything. No keypoint counts as shared.
        """
        record = replace(self._current(snapshot, view, voted=False), others=())
        return self._cached_facts(snapshot, view, record, -1)

    def siblings(self, snapshot: Snapshot, view: int) -> tuple[int, ...]:
        """Return the other views of the same object that a view is compared with."""
        own = self._current(snapshot, view, voted=False, drawn=False).own
        moment = self._changes.at(snapshot)
        return tuple(int(moment.view_of[number]) for number in own)

    def different(self, snapshot: Snapshot, view: int) -> set[int]:
        """Return views of other objects of which it is known that they show another print.

        Views that match in too few places, or differ between their matches, do so whatever else
        is stored.
        """
        record = self._current(snapshot, view)
        weak = [
            number
            for number in record.others
            if (pair := record.pairs[number]) is None or len(pair.rows) < MIN_SAME_PRINT
        ]
        numbers = np.array([*record.different, *weak], np.int64)
        return set(self._changes.at(snapshot).stored(numbers).tolist())

    def note_different(self, snapshot: Snapshot, view: int, others: Iterable[int]) -> None:
        """Keep what :meth:`different` returns from now on as well."""
        numbers = self._changes.at(snapshot).numbers
        distinguished = {int(numbers[other]) for other in others}
        if distinguished:
            record = self._current(snapshot, view)
            self._keep(
                int(numbers[view]), replace(record, different=record.different | distinguished)
            )

    def prepare(self, snapshot: Snapshot, views: Iterable[int]) -> None:
        """Compute the facts of new views, and compare with them what they may change facts of.

        That is done for views of which something is known. Their votes, which any other view that
        arrives may change as well, are brought up to date when they are asked for.
        """
        moment = self._changes.at(snapshot)
        for view in views:
            if self.picture(snapshot, view) is None:
                continue
            number, record = int(moment.numbers[view]), self._current(snapshot, view)
            for own in record.own:
                self._meet(moment, own, number, is_own=True)
            for other in record.others:
                self._meet(moment, other, number, is_own=False)
        self._write()

    def outdated(self, snapshot: Snapshot) -> list[int]:
        """Return the views of which nothing is known, or only what much has changed since.

        The next query that needs one has to match it with everything; fewer changes take it less.
        """
        moment = self._changes.at(snapshot)
        alive = np.flatnonzero(snapshot.alive)
        places = np.array([self._places.get(k, -1) for k in moment.numbers[alive].tolist()])
        behind = max(MAX_ADDED, len(alive) // _MAX_BEHIND)
        outdated: list[int] = alive[(places < 0) | (places < moment.place - behind)].tolist()
        return outdated

    def compare(self, snapshot: Snapshot, views: Iterable[int]) -> None:
        """Compute the facts of views as of now, and keep them."""
        for view in views:
            if self.picture(snapshot, view) is not None:
                self._current(snapshot, view)
            else:
                number = int(self._changes.at(snapshot).numbers[view])
                self._places[number] = _NEVER
        self._write()

    def neighbours(self, snapshot: Snapshot, view: int) -> Neighbours:
        """Return the views that a view with a picture may agree with.

        Of others, there are those that it is compared with, then more that were voted for, then
        those of the objects that look most alike: where many views of a family match, or better
        pictures do, one that shows the very same gets few votes.
        """
        record = self._current(snapshot, view)
        moment = self._changes.at(snapshot)
        own, others = (
            [int(moment.view_of[number]) for number in numbers]
            for numbers in (record.own, record.others)
        )
        voted = self._proposed(moment, view, record.votes, _MAX_VOTED)
        alike = np.where(snapshot.alive, snapshot.appearance(snapshot.look(view)), -1)
        # Its own object's views are compared anyway and would fill the few places.
        alike[snapshot.object_of_view == snapshot.object_of_view[view]] = -1
        others += _few_of_each(voted, snapshot, 2, _MAX_MORE)
        others += _few_of_each(_first_by(alike, snapshot, _MAX_VOTED, 0), snapshot, 1, _MAX_ALIKE)
        return Neighbours(tuple(own), tuple(dict.fromkeys(others)))

    def close(self) -> None:
        """Write what is not yet in the file, and close it."""
        if self._file is not None:
            self._write()
            self._file.close()

    def forget(self) -> None:
        """Delete the file: the next recogniser of the index compares everything again."""
        if self._file is not None:
            self._file.delete()

    def _held(self, number: int) -> Known | None:
        """Return what is known of a view, from memory or from the file."""
        view_record = self._known.get(number) or self._unwritten.get(number)
        if view_record is None and self._file is not None:
            record = self._file.record(number)
            view_record = None if record is None else Known.from_bytes(record.place, record.content)
            if view_record is not None:
                self._known.put(number, view_record)
        return view_record

    def _current(
        self, snapshot: Snapshot, view: int, voted: bool = True, drawn: bool = True
    ) -> Known:
        """Return what is known of a view as of now.

        Parameters
        ----------
        voted, drawn
            Whether its votes for views of other objects, and the comparison of pictures with views
            of its own, are needed. Where one is missing, it is kept under the number with a minus.
        """
        moment = self._changes.at(snapshot)
        number = int(moment.numbers[view])
        whole = self._held(number)
        if whole is not None and whole.place == moment.place:
            return whole
        part = self._held(-number)
        if part is not None and part.place == moment.place:
            if (part.has_voted or not voted) and (part.is_drawn or not drawn):
                return part
            voted = voted or part.has_voted
        record = self._brought_up(moment, view, (whole, part), voted, drawn)
        if (voted or record.has_voted) and (drawn or record.is_drawn):
            self._places[number] = record.place
            return self._keep(number, record)
        return self._keep(-number, record)

    def _meet(self, moment: Moment, number: int, arrived: int, is_own: bool) -> None:
        """Compare a view of which something is known with one that arrived, by their numbers."""
        record, view = self._held(number), int(moment.view_of[number])
        if record is None or arrived in record.pairs:
            return
        if is_own and arrived not in self._siblings(moment, view):
            return
        if len(record.pairs) >= _MAX_PAIRS:
            self._current(moment.snapshot, view)
            return
        pair = self._compared(moment.snapshot, view, int(moment.view_of[arrived]), is_own)
        record = replace(record, pairs={**record.pairs, arrived: pair})
        self._keep(number, record)

    def _keep(self, number: int, record: Known) -> Known:
        """Keep what is known of a view, in memory and for the file."""
        self._known.put(number, record)
        if self._file is None:
            return record
        with self._writing:
            if number > 0:
                self._unwritten.pop(-number, None)
            self._unwritten[number] = record
            is_much = len(self._unwritten) >= _MAX_UNWRITTEN
        if is_much:
            self._write()
        return record

    def _write(self) -> None:
        """Write what was computed since the last time, with the changes that it is based on."""
        if self._file is None:
            return
        with self._writing:
            # Before the changes are read: what is added from here on belongs to a later moment.
            records, self._unwritten = self._unwritten, {}
            moment = self._changes.latest()
            if moment is None or not records:
                return
            present = np.flatnonzero(moment.view_of >= 0)
            came = np.setdiff1d(present, self._filed).tolist()
            changes = self._changes.since(self._filed_place)
            self._file.write(
                [filed_view(k, moment.snapshot, int(moment.view_of[k])) for k in came],
                np.setdiff1d(self._filed, present).tolist(),
                self._filed_place,
                changes[: moment.place - self._filed_place],
                [
                    Record(number, record.place, record.to_bytes())
                    for number, record in records.items()
                    if abs(number) < len(moment.view_of) and moment.view_of[abs(number)] >= 0
                ],
            )
            self._filed, self._filed_place = present, moment.place

    def _brought_up(
        self, moment: Moment, view: int, before: Before, voted: bool, drawn: bool
    ) -> Known:
        """Return what is known of a view at a moment, with as much of what was known as holds."""
        lasting = (self._own(record, moment, view) for record in before)
        own = next((own_views for own_views in lasting if own_views is not None), None)
        if own is None:
            own = self._siblings(moment, view)
        votes = self._votes(moment, view, before) if voted else NO_VOTES
        others = tuple(int(moment.numbers[k]) for k in self._proposed(moment, view, votes))
        distinguished = {
            number for record in before if record is not None for number in record.different
        }
        different = moment.numbers[moment.stored(np.array(sorted(distinguished), np.int64))]
        whole = before[0]
        if whole is not None and (own, others) == (whole.own, whole.others):
            pairs = whole.pairs
        else:
            pairs = self._pairs(moment, view, before, own, others, drawn)
        return Known(moment.place, votes, own, others, pairs, frozenset(different.tolist()))

    def _votes(self, moment: Moment, view: int, before: Before) -> Votes:
        """Return the votes of a view, of what was known the latest brought up to date."""
        voted = [record for record in before if record is not None and record.has_voted]
        votes, last = None, max(voted, key=lambda record: record.place, default=None)
        changes = None if last is None else self._changes.between(last.place, moment.place)
        if last is not None and changes is not None:
            descriptors = moment.snapshot.stored_view(view).descriptors
            votes = updated_votes(last.votes, descriptors, moment, *changes)
        return votes or cast_votes(moment, view)

    def _own(self, record: Known | None, moment: Moment, view: int) -> tuple[int, ...] | None:
        """Return the other views of the object as they were known, None where they may differ."""
        changes = None if record is None else self._changes.between(record.place, moment.place)
        if record is None or changes is None:
            return None
        added, gone = changes
        objects = moment.snapshot.object_of_view
        # Of a view that went it is no longer known whose it was.
        is_touched = len(gone) > 0 or (objects[moment.stored(added)] == objects[view]).any()
        return None if is_touched else record.own

    def _siblings(self, moment: Moment, view: int) -> tuple[int, ...]:
        return tuple(int(moment.numbers[k]) for k in _siblings(moment.snapshot, view))

    def _pairs(
        self,
        moment: Moment,
        view: int,
        before: Before,
        own: tuple[int, ...],
        others: tuple[int, ...],
        drawn: bool,
    ) -> dict[int, ViewPair | None]:
        """Return the comparisons of a view with others, those that are known already included."""
        pairs: dict[int, ViewPair | None] = {}
        for record in reversed(before):
            pairs.update({} if record is None else record.pairs)
        pairs_by_number: dict[int, ViewPair | None] = {}
        for number in (*own, *others):
            is_drawn = drawn and number in own
            pair = pairs.get(number)
            if number not in pairs or (is_drawn and pair is not None and not pair.is_drawn):
                other = int(moment.view_of[number])
                pair = self._compared(moment.snapshot, view, other, is_drawn)
            pairs_by_number[number] = pair
        return pairs_by_number

    def _cached_facts(self, snapshot: Snapshot, view: int, record: Known, sign: int) -> ViewFacts:
        """Return what follows from a view's comparisons; kept until there are others."""
        key = sign * int(self._changes.at(snapshot).numbers[view])
        held = self._facts.get(key)
        # By identity: records are replaced, never changed.
        if held is None or held[0] is not record.pairs:
            held = self._facts.put(key, (record.pairs, self._followed(snapshot, view, record)))
        return held[1]

    def _followed(self, snapshot: Snapshot, view: int, record: Known) -> ViewFacts:
        picture = self.picture(snapshot, view)
        assert picture is not None
        rows, columns = grid_shape(picture.mask.shape, ComparisonParams())
        return facts_of(
            len(snapshot.stored_view(view).keypoints),
            rows * columns,
            [record.pairs[number] for number in record.own],
            [record.pairs[number] for number in record.others],
        )

    def _proposed(
        self, moment: Moment, view: int, votes: Votes, most: int = _MAX_OTHERS
    ) -> list[int]:
        """Return the views of other objects that a view's descriptors vote for."""
        snapshot = moment.snapshot
        counted = votes.counted(moment, self._cap)
        counted[snapshot.object_of_view == snapshot.object_of_view[view]] = 0
        return _first_by(counted, snapshot, most, _MIN_VOTES)

    def _compared(self, snapshot: Snapshot, view: int, other: int, drawn: bool) -> ViewPair | None:
        """Return how a view agrees with another one; the cells of its picture only if drawn."""
        first, second = snapshot.stored_view(view), snapshot.stored_view(other)
        if len(first.picture) == 0 or len(second.picture) == 0:
            return None
        alignment = self.aligned(snapshot, view, other)
        if alignment is None or len(alignment) < MIN_MATCHES:
            return None
        here, there = self.picture(snapshot, view), self.picture(snapshot, other)
        if here is None or there is None:
            return None
        if not drawn:
            return keypoints_only(alignment)
        places = first.keypoints[alignment.query_rows, :2]
        return view_pair(
            alignment, compare_pictures(here, there, alignment.query_from_view, places)
        )


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
        # All that tie with the last one stay until they are sorted by IRI.
        limit = np.partition(worth[chosen], len(chosen) - count)[len(chosen) - count]
        chosen = chosen[worth[chosen] >= limit]
    ranked = sorted(chosen.tolist(), key=lambda k: (-worth[k], snapshot.view_iris[k]))
    return ranked[:count]


def _few_of_each(views: list[int], snapshot: Snapshot, of_each: int, most: int) -> list[int]:
    """Return the first so many of the views of each object, and so many in all."""
    chosen, taken = list[int](), Counter[int]()
    for view in views:
        number = int(snapshot.object_of_view[view])
        taken[number] += 1
        if taken[number] <= of_each:
            chosen.append(view)
    return chosen[:most]


def _decoded(stored: StoredView) -> ViewPicture | None:
    if len(stored.picture) == 0:
        return None
    try:
        return ViewPicture.from_bytes(stored.picture)
    except ValueError:
        return None
