"""Objects that a query may show, ranked by places, print, look and likeness, with the evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.recognition.candidates import RecogniserParams, VerifiedView
from features.recognition.comparison.confidence import (
    has_same_colours,
    print_score,
    without_contradiction,
)
from features.recognition.comparison.printed import PrintedView
from features.recognition.confidence import Evidence, is_size_plausible, likeness
from features.recognition.index.snapshot import Snapshot
from features.recognition.views.light import light_costs, relit_colours
from features.recognition.views.view import ViewFeatures

__all__ = ["MAX_CHOSEN", "Candidate", "First", "Ranking", "chosen"]

MAX_CHOSEN = 3
"""Objects that are looked at for their places, their print, their look and their likeness."""
_MIN_LIGHT_GAIN = 0.02
"""Gain in similarity from which an answer mentions another light; seldom in the stored one."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """An object with what speaks for it, before its confidence."""

    object_number: int
    evidence: Evidence
    fits: tuple[VerifiedView, ...]
    most_similar_view: int
    printed: PrintedView | None = None
    is_in_other_light: bool = False

    @property
    def views(self) -> tuple[int, ...]:
        """Numbers of the stored views that match, the one that stands for the object first."""
        printed = () if self.printed is None else (self.printed.view,)
        matching = tuple(dict.fromkeys([*printed, *(fit.view for fit in self.fits)]))
        return matching or (self.most_similar_view,)


class First(NamedTuple):
    """Best objects by their places, and by their look or their likeness."""

    by_places: list[int]
    by_look: list[int]


def chosen(first: First, printed: Mapping[int, PrintedView]) -> list[int]:
    """Return the best objects of each sort."""
    by_print = sorted(printed, key=lambda k: -printed[k].evidence.matches)[:MAX_CHOSEN]
    return list(dict.fromkeys([*first.by_places, *by_print, *first.by_look]))


class Ranking:
    """Objects by their verified views and by their looks."""

    def __init__(
        self,
        features: ViewFeatures,
        snapshot: Snapshot,
        similarity: NDArray[np.float32],
        fits: list[VerifiedView],
        params: RecogniserParams,
    ) -> None:
        self._params = params
        self._features, self._snapshot, self._similarity = features, snapshot, similarity
        self._fits: dict[int, list[VerifiedView]] = {}
        for fit in sorted(fits, key=lambda f: (f.is_twin, -f.places, f.view)):
            self._fits.setdefault(int(snapshot.object_of_view[fit.view]), []).append(fit)
        self._look = np.full(len(snapshot.object_iris), -1.0)
        np.maximum.at(self._look, snapshot.object_of_view, similarity)
        order = np.argsort(-self._look, kind="stable")[:4]
        self._has_many = int(np.count_nonzero(self._look >= 0)) >= params.look_min_objects
        self._by_look = [int(number) for number in order if self._look[number] >= 0]
        self._light_gain = np.zeros(len(snapshot.object_iris))  # by another light, of each object
        self._alike = self._likeness_of_objects()

    def first(self) -> First:
        """Return the best objects by places, and by look or likeness."""
        by_places = sorted(self._fits, key=lambda number: -self._fits[number][0].places)
        by_look = dict.fromkeys([*self._by_look[:MAX_CHOSEN], *self._most_alike()[:MAX_CHOSEN]])
        return First(by_places[:MAX_CHOSEN], list(by_look))

    def candidate(self, number: int, printed: PrintedView | None) -> Candidate:
        """Collect what speaks for an object."""
        fits = tuple(self._fits.get(number, ()))
        is_twin = bool(fits) and fits[0].is_twin
        # Twins say the same; what they have in common speaks against neither.
        rivals = [
            others[0].places
            for other, others in self._fits.items()
            if other != number and not (is_twin and others[0].is_twin)
        ]
        next_look = next((float(self._look[k]) for k in self._by_look if k != number), 0.0)
        next_look = max(next_look, self._params.usual_look)
        alike, alike_lead = self._likeness_and_lead(number)
        snapshot, features = self._snapshot, self._features
        views = np.flatnonzero((snapshot.object_of_view == number) & snapshot.alive)
        sizes = snapshot.measures(views)[:, 1]
        most_similar = int(views[self._similarity[views].argmax()])
        likeness = self._likeness(most_similar)
        at_places = self._likeness(fits[0].view) if fits else _Likeness(0.0, None)
        is_smaller = features.is_cut and at_places.is_smaller
        lead = float(self._look[number]) - next_look
        odds = family = None
        if printed is not None:
            printed = printed.with_look(lead)
            constants, is_guessed = self._params.printed, features.is_mask_guessed
            odds = print_score(printed.evidence, constants, is_mask_guessed=is_guessed)
            likely = without_contradiction(printed.evidence)
            family = print_score(likely, constants, is_mask_guessed=is_guessed)
        shown = printed.view if printed is not None else fits[0].view if fits else most_similar
        evidence = Evidence(
            inliers=fits[0].places if fits else 0,
            rival_inliers=max(rivals, default=0),
            appearance=float(self._look[number]),
            appearance_lead=lead,
            colour=likeness.colour,
            place_colour=at_places.colour,
            size_ok=is_size_plausible(features.size_m, features.is_cut, sizes),
            size_gap=likeness.size_gap,
            place_gap=None if is_smaller else at_places.size_gap,
            is_among_many=self._has_many,
            is_twin=is_twin,
            is_solid=bool(fits) and fits[0].query_from_view is not None,
            has_print=bool(features.picture) and len(snapshot.stored_view(shown).picture) > 0,
            is_plain=len(features) < self._params.min_print_keypoints,
            print_odds=odds,
            family_odds=family,
            has_print_colours=printed is not None
            and not features.is_mask_guessed
            and has_same_colours(printed.evidence, self._params.printed),
            likeness=alike,
            likeness_lead=alike_lead,
        )
        is_relit = alike is not None and self._light_gain[number] >= _MIN_LIGHT_GAIN
        return Candidate(number, evidence, fits, most_similar, printed, bool(is_relit))

    def _likeness_of_objects(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
        """Return the likeness of all objects (O,) and which of them have a shape (O,).

        Removed ones have the likeness of nothing. None where the query has no shape.
        """
        if self._features.shape is None:
            return None
        snapshot, numbers = self._snapshot, self._snapshot.object_of_view
        constants = self._params.confidence
        colour, shape = (np.full(len(snapshot.object_iris), -1.0) for _ in "cs")
        lit = relit_colours(self._features.colour, self._features.picture)
        costs = light_costs(constants.light_gain, constants.light_tint)[: len(lit)]
        np.maximum.at(colour, numbers, snapshot.colours(lit[:1], costs[:1]))
        as_seen = colour.copy()
        np.maximum.at(colour, numbers, snapshot.colours(lit, costs))
        self._light_gain = colour - as_seen
        np.maximum.at(shape, numbers, snapshot.shapes(self._features.shape))
        return likeness(colour, shape, constants), shape >= 0

    def _most_alike(self) -> list[int]:
        """Return the objects that are alike in colours and shape, the most alike first."""
        if self._alike is None:
            return []
        alike, has_shape = self._alike
        order = np.argsort(-alike, kind="stable")
        return [int(number) for number in order if has_shape[number] and self._look[number] >= 0]

    def _likeness_and_lead(self, number: int) -> tuple[float | None, float]:
        """Return the likeness of one object, None where it has no shape, and its lead."""
        if self._alike is None or not self._alike[1][number]:
            return None, 0.0
        constants, alike = self._params.confidence, self._alike[0]
        usual = np.array([constants.usual_likeness])
        rival = np.append(np.delete(alike, number), likeness(usual, np.ones(1), constants)).max()
        return float(alike[number]), float(alike[number] - rival)

    def _likeness(self, view: int) -> _Likeness:
        """Compare the query with one view."""
        stored_m = float(self._snapshot.measures(np.array([view]))[0, 1])
        size_m, growth = self._features.size_m, None
        if np.isfinite(size_m) and np.isfinite(stored_m) and min(size_m, stored_m) > 0:
            growth = float(np.log(size_m / stored_m))
        colour = float(self._snapshot.colour(view) @ self._features.colour)
        return _Likeness(colour, growth)


@dataclass(frozen=True)
class _Likeness:
    """Similarity of colours, and logarithm of the size over the view's where both are known."""

    colour: float
    growth: float | None

    @property
    def size_gap(self) -> float | None:
        return None if self.growth is None else abs(self.growth)

    @property
    def is_smaller(self) -> bool:
        return self.growth is not None and self.growth < 0
