"""Which stored object does this view show? (Gatto 2016, 3.2.4; Kehoe 2014, 4.3)"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from features.recognition.cascade import match_flat, squared_distances
from features.recognition.confidence import (
    ConfidenceParams,
    Evidence,
    confidences,
    decide,
    is_size_plausible,
)
from features.recognition.index import RecognitionIndex
from features.recognition.snapshot import Matches, Snapshot
from features.recognition.verify import VerifyParams, fit_affine, fit_rigid
from features.recognition.view import ViewFeatures, describe_view

__all__ = ["Match", "Recogniser", "RecogniserParams", "Recognition", "warm_up"]


@dataclass(frozen=True)
class RecogniserParams:
    """How candidates are found and checked.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT beyond which nothing matches: (0.5 * 512)**2. It also stands
        in for a rival that is farther: among few objects nothing else is near, and the ratio rule
        alone would let everything through.
    ratio
        Lowe's ratio, on squared distances.
    least_votes, most_views
        Views with so many votes are verified, the best ones first.
    appearance_views
        Views of most similar look that are compared in full when votes were few.
    enough_inliers
        With so many, no second look is taken.
    verify, confidence
        Constants of the two steps that follow.
    """

    distance_cap: int = 65536
    ratio: float = 0.72
    least_votes: int = 4
    most_views: int = 8
    appearance_views: int = 5
    enough_inliers: int = 10
    verify: VerifyParams = field(default_factory=VerifyParams)
    confidence: ConfidenceParams = field(default_factory=ConfidenceParams)


@dataclass(frozen=True, eq=False)
class Match:
    """One object that the view may show.

    Parameters
    ----------
    object_iri, class_iri
        As stored.
    confidence
        0 to 1, see :mod:`features.recognition.confidence`.
    inliers
        Places of the best view whose matches agree on one movement.
    views
        IRIs of all its views that were verified, best first; without any the most similar one.
    appearance
        Similarity of colours and shapes, 0 to 1.
    size_ok
        Whether the size fits; None without depth.
    query_from_view : (4, 4) float64 or None, m
        Movement of the best view's camera frame into the query's: carries stored grasps over.
    view_iri
        The best view.
    """

    object_iri: str
    class_iri: str
    confidence: float
    inliers: int
    views: tuple[str, ...]
    appearance: float
    size_ok: bool | None
    query_from_view: NDArray[np.float64] | None
    view_iri: str


@dataclass(frozen=True)
class Recognition:
    """The answer.

    Parameters
    ----------
    outcome
        ``"null"``, ``"single"`` or ``"multiple"``: how many objects are in the match set.
    accepted
        The first match reaches the threshold and is clear of the second.
    matches
        Best first; also those below the threshold, so that a caller can say what it looks like.
    """

    outcome: Literal["null", "single", "multiple"]
    accepted: bool
    matches: tuple[Match, ...] = ()


@dataclass(frozen=True, eq=False)
class _Verified:
    """A stored view whose matches agree."""

    view: int
    inliers: int
    query_from_view: NDArray[np.float64] | None


class Recogniser:
    """Recognises views against an index; keeps no state of its own.

    Examples
    --------
    >>> from features.recognition.view import describe_view
    >>> chess = ((np.indices((80, 80)) // 10).sum(axis=0) % 2 * 255).astype(np.uint8)
    >>> Recogniser(RecognitionIndex()).recognise(describe_view(chess, chess >= 0)).outcome
    'null'
    """

    def __init__(self, index: RecognitionIndex, params: RecogniserParams | None = None) -> None:
        self.index = index
        self.params = params or RecogniserParams()

    def recognise(
        self,
        features: ViewFeatures,
        min_confidence: float | None = None,
        max_results: int = 10,
    ) -> Recognition:
        """Compare a view with everything that is stored.

        Parameters
        ----------
        min_confidence
            Kehoe's c_I, default :attr:`ConfidenceParams.threshold`.
        max_results
            The most matches in the answer.
        """
        constants = self.params.confidence
        least = constants.threshold if min_confidence is None else min_confidence
        snapshot = self.index.snapshot()
        candidates = self.gather(features, snapshot)
        evidence = [c.evidence for c in candidates]
        confidence = confidences(evidence, constants)
        order = np.argsort(-confidence, kind="stable")
        outcome, accepted = decide(confidence[order], least, constants)
        matches = [
            candidates[k].as_match(snapshot, float(confidence[k]))
            for k in order[:max_results]
            if confidence[k] > 0
        ]
        return Recognition(outcome, accepted, tuple(matches))

    def gather(self, features: ViewFeatures, snapshot: Snapshot) -> list[Candidate]:
        """Return the three objects of most inliers and the three of most similar look."""
        if not snapshot.alive.any():
            return []
        similarity = snapshot.appearance(features.appearance)
        verified = self._verify(features, snapshot, similarity)
        best: dict[int, list[_Verified]] = {}
        for fit in sorted(verified, key=lambda f: (-f.inliers, f.view)):
            best.setdefault(int(snapshot.object_of_view[fit.view]), []).append(fit)
        look = np.full(len(snapshot.object_iris), -1.0)
        np.maximum.at(look, snapshot.object_of_view, similarity)
        by_look = [int(o) for o in np.argsort(-look, kind="stable")[:4] if look[o] >= 0]
        by_inliers = sorted(best, key=lambda o: -best[o][0].inliers)
        chosen = list(dict.fromkeys(by_inliers[:3] + by_look[:3]))
        return [
            _candidate(features, snapshot, similarity, obj, best, look, by_look) for obj in chosen
        ]

    def _verify(
        self, features: ViewFeatures, snapshot: Snapshot, similarity: NDArray[np.float32]
    ) -> list[_Verified]:
        params = self.params
        matches = snapshot.match(features.descriptors)
        good = self._is_good(matches.nearest, matches.rival)
        votes = np.bincount(matches.view[good], minlength=len(snapshot.alive))
        voted = np.argsort(-votes, kind="stable")[: params.most_views]
        voted = voted[votes[voted] >= params.least_votes]
        verified = []
        for view in voted.tolist():
            rows = np.flatnonzero(good & (matches.view == view))
            fit = self._fit(features, view, rows, matches.keypoints[rows], matches.points3d[rows])
            if fit is not None:
                verified.append(fit)
        if max((fit.inliers for fit in verified), default=0) >= params.enough_inliers:
            return verified
        alike = np.argsort(-similarity, kind="stable")[: params.appearance_views]
        again = dict.fromkeys(
            [fit.view for fit in verified] + alike[similarity[alike] >= 0].tolist()
        )
        closer = [self._look_again(features, snapshot, matches, view) for view in again]
        most: dict[int, _Verified] = {}
        for fit in [*verified, *(fit for fit in closer if fit is not None)]:
            if fit.view not in most or fit.inliers > most[fit.view].inliers:
                most[fit.view] = fit
        return list(most.values())

    def _is_good(
        self, nearest: NDArray[np.integer], rival: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Apply the cap and the ratio rule; where nothing else is near, the cap stands in."""
        cap = self.params.distance_cap
        good: NDArray[np.bool_] = (nearest < cap) & (
            nearest < self.params.ratio * np.minimum(rival, 1.2 * cap)
        )
        return good

    def _look_again(
        self, features: ViewFeatures, snapshot: Snapshot, matches: Matches, view: int
    ) -> _Verified | None:
        """Compare with one view in full: the index lets a descriptor vote for one view only."""
        stored = snapshot.stored_view(view)
        if len(stored.descriptors) == 0 or len(features) == 0:
            return None
        distances = squared_distances(features.descriptors, stored.descriptors)
        row = distances.argmin(axis=1)
        nearest = distances[np.arange(len(row)), row].astype(np.int64)
        label = snapshot.object_of_view
        is_own = (matches.view >= 0) & (label[matches.view] == label[view])
        rival = np.where(is_own, matches.rival, matches.nearest)
        rows = np.flatnonzero(self._is_good(nearest, rival))
        return self._fit(
            features, view, rows, stored.keypoints[row[rows]], stored.points3d[row[rows]]
        )

    def _fit(
        self,
        features: ViewFeatures,
        view: int,
        rows: NDArray[np.intp],
        keypoints: NDArray[np.float32],
        points3d: NDArray[np.float32],
    ) -> _Verified | None:
        params = self.params.verify
        affine = fit_affine(features.keypoints[rows], keypoints, features.side_px, params)
        if affine is None:
            return None
        agreed = affine.inliers
        rigid = fit_rigid(
            features.points3d[rows[agreed]], points3d[agreed], features.size_m, params, seed=view
        )
        return _Verified(view, affine.places, None if rigid is None else rigid.query_from_view)


@dataclass(frozen=True, eq=False)
class Candidate:
    """An object with what speaks for it, before its confidence."""

    object_number: int
    evidence: Evidence
    fits: tuple[_Verified, ...]
    most_similar_view: int

    def as_match(self, snapshot: Snapshot, confidence: float) -> Match:
        """Return the answer's entry."""
        views = [fit.view for fit in self.fits] or [self.most_similar_view]
        return Match(
            object_iri=snapshot.object_iris[self.object_number],
            class_iri=snapshot.class_iris[snapshot.class_of_view[views[0]]],
            confidence=confidence,
            inliers=self.evidence.inliers,
            views=tuple(snapshot.view_iris[view] for view in views),
            appearance=self.evidence.appearance,
            size_ok=self.evidence.size_ok,
            query_from_view=self.fits[0].query_from_view if self.fits else None,
            view_iri=snapshot.view_iris[views[0]],
        )


def _candidate(
    features: ViewFeatures,
    snapshot: Snapshot,
    similarity: NDArray[np.float32],
    number: int,
    best: dict[int, list[_Verified]],
    look: NDArray[np.float64],
    by_look: list[int],
) -> Candidate:
    fits = tuple(best.get(number, ()))
    others = [fits_[0].inliers for other, fits_ in best.items() if other != number]
    other_look = next((float(look[other]) for other in by_look if other != number), 0.0)
    views = np.flatnonzero((snapshot.object_of_view == number) & snapshot.alive)
    sizes = snapshot.measures(views)[:, 1]
    evidence = Evidence(
        inliers=fits[0].inliers if fits else 0,
        rival_inliers=max(others, default=0),
        appearance=float(look[number]),
        appearance_lead=float(look[number]) - other_look,
        size_ok=is_size_plausible(features.size_m, features.is_cut, sizes),
    )
    return Candidate(number, evidence, fits, int(views[similarity[views].argmax()]))


def warm_up() -> None:
    """Compile the kernels now, not in the first query (about ten seconds, once a machine)."""
    rng = np.random.default_rng(0)
    image = (rng.random((24, 24)).repeat(8, axis=0).repeat(8, axis=1) * 255).astype(np.uint8)
    features = describe_view(image, np.ones(image.shape, bool))
    with RecognitionIndex() as index:
        index.add("view:warm", "object:warm", "class:warm", features)
        recogniser = Recogniser(index)
        recogniser.recognise(features)
        index.save()
        recogniser.recognise(features)
        snapshot = index.snapshot()
    block, labels = snapshot.parts[0].block, snapshot.object_of_view
    alive = snapshot.parts[0].alive
    match_flat(
        *(block.descriptors, block.codes, block.descriptors, block.codes),
        *(labels, block.view_of_row, alive),
    )
