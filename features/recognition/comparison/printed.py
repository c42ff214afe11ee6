"""Objects whose print the query may show, with the evidence for each."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import Alignment, align_views
from features.recognition.comparison.difference import Comparison, compare_pictures
from features.recognition.comparison.evidence import (
    PrintEvidence,
    highest_preference,
    preference,
    print_evidence,
)
from features.recognition.comparison.store_facts import StoreFacts
from features.recognition.index.snapshot import Matches, Snapshot, StoredView
from features.recognition.rigid import fit_rigid
from features.recognition.verify import VerifyParams
from features.recognition.views.picture import ViewPicture
from features.recognition.views.view import ViewFeatures

__all__ = ["PrintedView", "printed_objects", "proposed_views"]

_MIN_VOTES = 6
"""Fewer votes seldom give the six matches that agree at least: one view in a hundred."""
_MAX_COMPARED = 6
"""Aligned views whose pictures are compared; the others have fewer matches."""
_MAX_STABLE_LEAD = 0.5


@dataclass(frozen=True, eq=False)
class PrintedView:
    """A stored view whose print the query may show.

    Parameters
    ----------
    view
        Number in the snapshot.
    alignment
        Of the view with the query.
    evidence
        Of its print, leads over the other objects included.
    query_from_view : (4, 4) float64 or None, m
        The movement in space, where both views have depth.
    """

    view: int
    alignment: Alignment
    evidence: PrintEvidence
    query_from_view: NDArray[np.float64] | None = None

    def with_look(self, lead: float) -> PrintedView:
        """Return the same with the lead of its object in colours and shapes."""
        bounded = float(np.clip(lead, -0.2, 0.2))
        return replace(self, evidence=replace(self.evidence, look_lead=bounded))


def proposed_views(
    matches: Matches, snapshot: Snapshot, distance_cap: int, views: int, per_object: int
) -> list[int]:
    """Return the views that most descriptors vote for, only so many of one object.

    Here a descriptor votes for its nearest view and for the nearest of another object: products
    that share print must both be looked at, which the ratio rule prevents.
    """
    votes = np.zeros(len(snapshot.alive), np.int64)
    for voted, distances in (
        (matches.view, matches.nearest),
        (matches.rival_view, matches.rival),
    ):
        near = voted[(voted >= 0) & (distances < distance_cap)]
        votes += np.bincount(near, minlength=len(votes))
    chosen: list[int] = []
    taken: dict[int, int] = {}
    for view in np.argsort(-votes, kind="stable").tolist():
        if votes[view] < _MIN_VOTES or len(chosen) == views:
            break
        number = int(snapshot.object_of_view[view])
        if taken.get(number, 0) < per_object:
            taken[number] = taken.get(number, 0) + 1
            chosen.append(view)
    return chosen


def printed_objects(
    query: ViewFeatures,
    snapshot: Snapshot,
    facts: StoreFacts,
    views: Iterable[int],
    required: Collection[int],
    first: int,
) -> dict[int, PrintedView]:
    """Return the best view of every object whose print agrees in enough places.

    Parameters
    ----------
    views
        Numbers of the views to compare.
    required, first
        Objects that are asked about, besides so many with most matches: of the others some may be
        left out, since the facts of a view take long where it was not compared before.
    """
    if not query.picture or len(query) < 2:
        return {}
    picture = ViewPicture.from_bytes(query.picture)
    aligned: list[tuple[int, Alignment]] = []
    for view in views:
        stored = snapshot.stored_view(view)
        alignment = align_views(query, stored, query.side_px) if len(stored.picture) else None
        if alignment is not None:
            aligned.append((view, alignment))
    aligned.sort(key=lambda pair: (-len(pair[1]), snapshot.view_iris[pair[0]]))
    tried = (_laid(query, snapshot, facts, *laid_view) for laid_view in aligned[:_MAX_COMPARED])
    laid = [laid_view for laid_view in tried if laid_view is not None]
    objects = [int(snapshot.object_of_view[laid_view.view]) for laid_view in laid]
    spare = spare_objects(
        objects, [len(laid_view.alignment) for laid_view in laid], max(first, 2)
    ) - {*required}
    drawn = [
        _drawn(query, picture, laid_view)
        for laid_view, number in zip(laid, objects, strict=True)
        if number not in spare
    ]
    return with_leads(_best_of_objects(query, snapshot, facts, drawn))


def spare_objects(objects: Sequence[int], matches: Sequence[int], first: int) -> set[int]:
    """Return the objects that are not among the first by matches, whichever view stands for each.

    Parameters
    ----------
    objects, matches
        Of every view that may stand for its object.

    Examples
    --------
    >>> spare_objects([7, 7, 8, 9, 9], [30, 20, 25, 6, 19], 2), spare_objects([7, 8], [9, 9], 1)
    ({9}, set())
    """
    least: dict[int, int] = {}
    most: dict[int, int] = {}
    for number, count in zip(objects, matches, strict=True):
        least[number] = min(count, least.get(number, count))
        most[number] = max(count, most.get(number, count))
    return {k for k in most if sum(score > most[k] for score in least.values()) >= first}


@dataclass(frozen=True, eq=False)
class _Laid:
    """A stored view that agrees with the query in the image and, with depth, in space."""

    view: int
    alignment: Alignment
    picture: ViewPicture
    query_from_view: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class _Drawn(_Laid):
    """A stored view laid over the query; ``most`` bounds its preference."""

    comparison: Comparison
    most: float


def _laid(
    query: ViewFeatures, snapshot: Snapshot, facts: StoreFacts, view: int, alignment: Alignment
) -> _Laid | None:
    """Return a view to compare, None where space or its picture forbids it."""
    agrees, movement = _in_space(query, snapshot.stored_view(view), alignment)
    stored = facts.picture(snapshot, view) if agrees else None
    return None if stored is None else _Laid(view, alignment, stored, movement)


def _drawn(query: ViewFeatures, picture: ViewPicture, laid: _Laid) -> _Drawn:
    """Return the comparison with a view."""
    places = query.keypoints[laid.alignment.query_rows, :2]
    comparison = compare_pictures(picture, laid.picture, laid.alignment.query_from_view, places)
    most = highest_preference(laid.alignment, comparison)
    return _Drawn(laid.view, laid.alignment, laid.picture, laid.query_from_view, comparison, most)


def _best_of_objects(
    query: ViewFeatures, snapshot: Snapshot, facts: StoreFacts, drawn: list[_Drawn]
) -> dict[int, PrintedView]:
    """Return the preferred view of every object.

    The facts of a view take longest where it was not compared before. Which view is preferred
    follows from those of its keypoints, which take half as long.
    """
    views: dict[int, list[int]] = {}
    for k, view in enumerate(drawn):
        views.setdefault(int(snapshot.object_of_view[view.view]), []).append(k)
    printed: dict[int, PrintedView] = {}
    for number, choice in views.items():
        view = drawn[_preferred(query, snapshot, facts, drawn, choice)]
        keypoints: NDArray[np.float32] = snapshot.stored_view(view.view).keypoints
        view_facts = facts.of(snapshot, view.view)
        evidence = print_evidence(
            view.alignment, view.comparison, keypoints, query.mask_px, view_facts
        )
        printed[number] = PrintedView(view.view, view.alignment, evidence, view.query_from_view)
    return printed


def _preferred(
    query: ViewFeatures,
    snapshot: Snapshot,
    facts: StoreFacts,
    drawn: list[_Drawn],
    choice: list[int],
) -> int:
    """Return which of the views of one object is preferred, of equal ones the first.

    A view that cannot be preferred any more is not asked for its facts.
    """
    if len(choice) == 1:
        return choice[0]
    best = -np.inf, 0
    for k in sorted(choice, key=lambda k: (-drawn[k].most, k)):
        candidate = drawn[k]
        if (candidate.most, -k) < best:
            continue
        keypoints: NDArray[np.float32] = snapshot.stored_view(candidate.view).keypoints
        view_facts = facts.of_keypoints(snapshot, candidate.view)
        worth = preference(
            candidate.alignment, candidate.comparison, keypoints, query.mask_px, view_facts
        )
        best = max(best, (worth, -k))
    return -best[1]


def _in_space(
    query: ViewFeatures, stored: StoredView, alignment: Alignment
) -> tuple[bool, NDArray[np.float64] | None]:
    """Tell whether the matches agree on a movement in space, where both sides have depth."""
    here, there = query.points3d[alignment.query_rows], stored.points3d[alignment.view_rows]
    solid = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
    if np.count_nonzero(solid) < VerifyParams().min_places:
        return True, None
    rigid = fit_rigid(here[solid], there[solid], query.size_m)
    return rigid is not None, None if rigid is None else rigid.query_from_view


def with_leads(best: dict[int, PrintedView]) -> dict[int, PrintedView]:
    """Return the candidates with their leads over the next one by matches.

    To be alone is no merit: the sibling of a stored product that nobody stored meets no rival
    either. Its stable share is then the lead over nothing.
    """
    ranked = sorted(best.values(), key=lambda p: -p.evidence.matches)
    leading = {}
    for number, printed in best.items():
        rival = next((other for other in ranked if other is not printed), None)
        evidence = replace(
            printed.evidence, stable_lead=min(printed.evidence.stable_share, _MAX_STABLE_LEAD)
        )
        if rival is not None:
            ahead = (1 + evidence.matches) / (1 + rival.evidence.matches)
            gain = evidence.stable_share - rival.evidence.stable_share
            evidence = replace(
                evidence,
                lead=float(np.clip(np.log2(ahead), -2, 3)),
                stable_lead=float(np.clip(gain, -_MAX_STABLE_LEAD, _MAX_STABLE_LEAD)),
            )
        leading[number] = replace(printed, evidence=evidence)
    return leading
