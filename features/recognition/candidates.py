"""Candidate views of a query: voted for by descriptors, verified by geometry.

Three looks, each only if the one before left doubt: views with most votes of the index (Gatto
2016, 3.2.4); views that look alike, compared in full; and twins, objects whose descriptors stand
in each other's way.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.all_views import AllViewsParams
from features.recognition.comparison.confidence import PrintParams
from features.recognition.confidence import ConfidenceParams
from features.recognition.index.nearest import nearest_rows
from features.recognition.index.snapshot import Matches, Snapshot
from features.recognition.rigid import fit_rigid
from features.recognition.verify import VerifyParams, count_places, fit_affine
from features.recognition.views.view import ViewFeatures

__all__ = ["RecogniserParams", "VerifiedView", "untried_views", "verified_views"]

_CLEAR_LEAD = 2.0
"""So many times the places of the next object leave no doubt."""
_TWIN_GAIN = 1.5
"""So many times the places show that a rivalry, not the view, hid the others."""


@dataclass(frozen=True)
class RecogniserParams:
    """Parameters of finding and verifying candidates.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT beyond which nothing matches: (0.5 * 512)**2.
    ratio
        Lowe's ratio, on squared distances.
    usual_rival
        Squared distance, (0.45 * 512)**2, that stands in for a rival that is farther. Among a
        hundred objects the rival's median is (0.49 * 512)**2; among few nothing else is near, and
        the ratio rule alone would let everything through.
    min_votes, max_views
        Views with so many votes are verified, the best ones first.
    appearance_views
        Views of most similar look that are compared in full when votes were few.
    enough_inliers
        With so many, and twice as many as any other object, no second look is taken.
    twin_cap, twin_matches
        So many descriptors that match two objects within this squared distance, (0.35 * 512)**2,
        make the two twins: the same print under two names.
    usual_look
        Similarity of looks that another product reaches anyhow: stands in for it where few are
        stored.
    look_min_objects
        With fewer objects stored, a look that resembles one of them most may suggest it only.
    min_print_keypoints
        A query with fewer keypoints carries too little print for it to have to agree. Photographs
        of cartons of 350 px have 340 to 600, most plain household objects below 150.
    verify, confidence, printed, all_views
        Constants of the steps that follow.
    """

    distance_cap: int = 65536
    ratio: float = 0.72
    usual_rival: int = 53084
    min_votes: int = 4
    max_views: int = 8
    appearance_views: int = 5
    enough_inliers: int = 10
    twin_cap: int = 32113
    twin_matches: int = 5
    usual_look: float = 0.75
    look_min_objects: int = 20
    min_print_keypoints: int = 200
    verify: VerifyParams = field(default_factory=VerifyParams)
    confidence: ConfidenceParams = field(default_factory=ConfidenceParams)
    printed: PrintParams = field(default_factory=PrintParams)
    all_views: AllViewsParams = field(default_factory=AllViewsParams)


@dataclass(frozen=True, eq=False)
class VerifiedView:
    """A stored view whose matches agree on one movement.

    Parameters
    ----------
    view
        Number in the snapshot.
    places
        Different places that agree.
    query_from_view : (4, 4) float64 or None, m
        The movement in space, where both views have depth.
    is_twin
        Found only by leaving out the rivalry of an object that looks the same.
    """

    view: int
    places: int
    query_from_view: NDArray[np.float64] | None
    is_twin: bool = False


def verified_views(
    features: ViewFeatures,
    snapshot: Snapshot,
    similarity: NDArray[np.float32],
    params: RecogniserParams,
    matches: Matches,
) -> list[VerifiedView]:
    """Return the views that the query may show, in no particular order.

    Parameters
    ----------
    similarity : (V,) float32
        Of the query's look to that of each view, negative where it was removed.
    matches
        Of the query's descriptors in the snapshot.
    """
    search = _Search(features, snapshot, similarity, params)
    fits = search.by_votes(matches)
    if search.is_settled(fits):
        return fits
    alike = np.argsort(-similarity, kind="stable")[: params.appearance_views]
    present = alike[similarity[alike] >= 0].tolist()
    again = dict.fromkeys([*(fit.view for fit in fits), *present])
    fits = _best_of_each(fits + search.in_full(matches, again, snapshot.object_of_view))
    if search.is_settled(fits):
        return fits
    return _best_of_each(fits + search.twins(matches))


def untried_views(
    features: ViewFeatures,
    snapshot: Snapshot,
    similarity: NDArray[np.float32],
    params: RecogniserParams,
    matches: Matches,
    fits: list[VerifiedView],
) -> int:
    """Return how many views had votes enough and were not verified, for want of a settled answer.

    Parameters are those of :func:`verified_views`, and what it returned.
    """
    search = _Search(features, snapshot, similarity, params)
    if search.is_settled(fits):
        return 0
    votes = search.votes(matches)
    order = np.argsort(-votes, kind="stable")[params.max_views :]
    voted = order[votes[order] >= params.min_votes]
    alike = np.argsort(-similarity, kind="stable")[: params.appearance_views]
    return int(np.count_nonzero(~np.isin(voted, alike)))


def _best_of_each(fits: list[VerifiedView]) -> list[VerifiedView]:
    """Return one fit of each view; that as a twin only where it explains far more."""
    best: dict[int, VerifiedView] = {}
    for fit in sorted(fits, key=lambda f: (f.is_twin, -f.places)):
        previous = best.setdefault(fit.view, fit)
        if fit.is_twin and fit.places >= _TWIN_GAIN * previous.places:
            best[fit.view] = fit
    return list(best.values())


@dataclass(frozen=True, eq=False)
class _Search:
    """One query against one snapshot."""

    features: ViewFeatures
    snapshot: Snapshot
    similarity: NDArray[np.float32]
    params: RecogniserParams

    def is_settled(self, fits: list[VerifiedView]) -> bool:
        """Tell whether one object has many places and no other comes near."""
        places: dict[int, int] = {}
        for fit in fits:
            number = int(self.snapshot.object_of_view[fit.view])
            places[number] = max(fit.places, places.get(number, 0))
        best, next_best = sorted([*places.values(), 0, 0], reverse=True)[:2]
        return best >= self.params.enough_inliers and best >= _CLEAR_LEAD * next_best

    def votes(self, matches: Matches) -> NDArray[np.intp]:
        """Return the votes of descriptors for each view."""
        good = self._is_good(matches.nearest, matches.rival)
        return np.bincount(matches.view[good], minlength=len(self.snapshot.alive))

    def by_votes(self, matches: Matches) -> list[VerifiedView]:
        """Verify the views that got most votes."""
        good = self._is_good(matches.nearest, matches.rival)
        votes = self.votes(matches)
        order = np.argsort(-votes, kind="stable")[: self.params.max_views]
        fits = []
        for view in order[votes[order] >= self.params.min_votes].tolist():
            rows = np.flatnonzero(good & (matches.view == view))
            fits.append(self._fit(view, rows, matches.keypoints[rows], matches.points3d[rows]))
        return [fit for fit in fits if fit is not None]

    def in_full(
        self, matches: Matches, views: dict[int, None], labels: NDArray[np.int32]
    ) -> list[VerifiedView]:
        """Compare with single views: in the index, a descriptor votes for one view only."""
        fits = []
        for view in views:
            stored = self.snapshot.stored_view(view)
            if len(stored.descriptors) == 0 or len(self.features) == 0:
                continue
            row, nearest = nearest_rows(self.features.descriptors, stored.descriptors)
            # The ratio rule asks for the nearest of another product. Where the index already gave
            # this product the vote that is its rival, elsewhere the nearest itself.
            is_own = (matches.view >= 0) & (labels[matches.view] == labels[view])
            rows = np.flatnonzero(
                self._is_good(nearest, np.where(is_own, matches.rival, matches.nearest))
            )
            chosen = row[rows]
            fits.append(self._fit(view, rows, stored.keypoints[chosen], stored.points3d[chosen]))
        return [fit for fit in fits if fit is not None]

    def twins(self, matches: Matches) -> list[VerifiedView]:
        """Verify objects that keep each other from being found, as if they were one.

        A product that was stored twice, or two that share a print, match every descriptor about
        equally well; the ratio rule then leaves nothing of either.
        """
        labels = self._labels_with_twins_joined(matches)
        if labels is None:
            return []
        joined = self.snapshot.match(self.features.descriptors, labels)
        shared = (
            np.bincount(labels)[labels]
            > np.bincount(self.snapshot.object_of_view)[self.snapshot.object_of_view]
        )
        likely = np.where(shared & self.snapshot.alive, self.similarity, -1)
        order = np.argsort(-likely, kind="stable")[: 2 * self.params.appearance_views]
        views = dict.fromkeys(order[likely[order] >= 0].tolist())
        return [
            VerifiedView(fit.view, fit.places, fit.query_from_view, is_twin=True)
            for fit in self.in_full(joined, views, labels)
        ]

    def _labels_with_twins_joined(self, matches: Matches) -> NDArray[np.int32] | None:
        objects = self.snapshot.object_of_view
        both = (matches.view >= 0) & (matches.rival_view >= 0)
        both &= matches.rival < self.params.twin_cap
        if np.count_nonzero(both) < self.params.twin_matches:
            return None
        pairs = np.sort([objects[matches.view[both]], objects[matches.rival_view[both]]], axis=0)
        distinct, counts = np.unique(pairs, axis=1, return_counts=True)
        twins = distinct[:, counts >= self.params.twin_matches].T
        if len(twins) == 0:
            return None
        labels = objects.copy()
        for a, b in twins.tolist():
            first, second = labels[objects == a][0], labels[objects == b][0]
            labels[labels == second] = first
        return labels

    def _is_good(
        self, nearest: NDArray[np.integer], rival: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Apply the cap and the ratio rule."""
        params = self.params
        good: NDArray[np.bool_] = (nearest < params.distance_cap) & (
            nearest < params.ratio * np.minimum(rival, params.usual_rival)
        )
        return good

    def _fit(
        self,
        view: int,
        rows: NDArray[np.intp],
        keypoints: NDArray[np.float32],
        points3d: NDArray[np.float32],
    ) -> VerifiedView | None:
        """Verify matches in the image and, where both sides have depth, also in space.

        A word or an emblem that two products share agrees in the image; on bodies of another
        shape it does not agree in space.
        """
        params, side_px = self.params.verify, self.features.side_px
        own, own_points = self.features.keypoints[rows], self.features.points3d[rows]
        affine = fit_affine(own, keypoints, side_px, params)
        if affine is None:
            return None
        agreed, movement = affine.inliers, None
        solid = np.isfinite(own_points).all(axis=1) & np.isfinite(points3d).all(axis=1)
        chosen = np.flatnonzero(agreed & solid)
        if len(chosen) >= params.min_places:
            rigid = fit_rigid(
                own_points[chosen], points3d[chosen], self.features.size_m, params, seed=view
            )
            if rigid is None:
                return None
            # Matches without depth keep what the image said of them; those with depth are judged
            # anew, in space.
            agreed = agreed & ~solid
            agreed[chosen[rigid.inliers]] = True
            movement = rigid.query_from_view
        places = count_places(own[agreed], keypoints[agreed], side_px, params)
        return VerifiedView(view, places, movement) if places >= params.min_places else None
