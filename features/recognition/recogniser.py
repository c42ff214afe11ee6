"""Recognition of the stored object that a view shows (Gatto 2016, 3.2.4; Kehoe 2014, 4.3)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics
from features.recognition.candidates import (
    RecogniserParams,
    VerifiedView,
    untried_views,
    verified_views,
)
from features.recognition.comparison.all_views import agreement_of_views, odds_of_views
from features.recognition.comparison.beside import BesideParams, place_beside
from features.recognition.comparison.confidence import within_requirements
from features.recognition.comparison.evidence import Difference
from features.recognition.comparison.printed import PrintedView, printed_objects, proposed_views
from features.recognition.comparison.store_facts import StoreFacts
from features.recognition.comparison.twins import Twins
from features.recognition.confidence import (
    confidences,
    decide,
)
from features.recognition.index.cascade import match_flat, match_tables
from features.recognition.index.recognition_index import RecognitionIndex
from features.recognition.index.snapshot import Matches, Snapshot
from features.recognition.ranking import MAX_CHOSEN, Candidate, First, Ranking, chosen
from features.recognition.views.stored import stored_features
from features.recognition.views.view import ViewFeatures, describe_view
from features.words.contradiction import WordContradiction

__all__ = ["Match", "Recogniser", "RecogniserParams", "Recognition", "warm_up"]

# Less says nothing, not even what it looks like.
_MIN_NAMED = 0.001
_FACTS_FILE = "facts.sqlite"
_PRINTED_PER_OBJECT, _PRINTED_FITS = 2, 4
"""Views whose print is compared: so many that were voted for, and so many that were verified."""


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
        Matches of the best view that agree on one map of the image; without a picture of the view,
        the places that agree on one movement.
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
    difference
        Where the print contradicts that view most, None where it does not or was not compared.
    by_print
        The confidence is that of the print, compared place by place: it means the same however few
        objects are stored.
    extent
        Square root of the area between the matches whose print was compared, of the longer side of
        the object in the query; 0 where none was.
    is_in_other_light
        The colours are more like the object's in another light than their own; only where shapes
        are compared as well.
    homography : (3, 3) float64 or None, px
        Map of the best view's image into the query's, where their print was compared.
    words
        A word of the query in the place of another one of the object: it is a sibling. None where
        words were not read, or say nothing against it.
    beside
        Where this object is seen from the first one, as "to the right": two things are in the
        picture. Empty for the first one, and for what resembles that.
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
    difference: Difference | None = None
    by_print: bool = False
    extent: float = 0.0
    is_in_other_light: bool = False
    homography: NDArray[np.float64] | None = None
    words: WordContradiction | None = None
    beside: str = ""


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
    family
        IRI of an object that the view looks like and differs from in print; empty where there is
        none. The first match's ``difference`` says where.
    ask_again
        Another view may decide: nothing is accepted, and the first match is not unlikely.
    views_untried
        Stored views that share some print with this one and were not compared, because others share
        more: where nothing is accepted, that it is none of theirs is not decided.
    """

    outcome: Literal["null", "single", "multiple"]
    accepted: bool
    matches: tuple[Match, ...] = ()
    family: str = ""
    ask_again: bool = False
    views_untried: int = 0

    def accepts(self, object_iri: str) -> bool:
        """Tell whether the answer is that object."""
        return self.accepted and self.matches[0].object_iri == object_iri

    @property
    def is_in_other_light(self) -> bool:
        """Whether a doubt remains and the first match was stored in another light."""
        return self.ask_again and self.matches[0].is_in_other_light

    @property
    def differs(self) -> str:
        """Where the view differs from the object of its family, in words; empty without one."""
        first = self._of_family
        return "" if first is None or first.difference is None else first.difference.place

    @property
    def words(self) -> WordContradiction | None:
        """Words by which the view differs from the object of its family; None without such."""
        return None if self._of_family is None else self._of_family.words

    @property
    def _of_family(self) -> Match | None:
        """The first match, where that is the object of the family."""
        first = self.matches[0] if self.family and self.matches else None
        return first if first is not None and first.object_iri == self.family else None


class Recogniser:
    """Recognises views against an index; what it keeps of stored views lies beside the index.

    Examples
    --------
    >>> from features.recognition.views.view import describe_view
    >>> chess = ((np.indices((80, 80)) // 10).sum(axis=0) % 2 * 255).astype(np.uint8)
    >>> Recogniser(RecognitionIndex()).recognise(describe_view(chess, chess >= 0)).outcome
    'null'
    """

    def __init__(self, index: RecognitionIndex, params: RecogniserParams | None = None) -> None:
        self.index = index
        self.params = params or RecogniserParams()
        path = index.file_beside(_FACTS_FILE, lambda: self._facts.close())
        self._facts = StoreFacts(self.params.distance_cap, path)
        self._twins = Twins(self._facts)

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
        candidates, untried = self.gather_counted(features, snapshot)
        evidence = [c.evidence for c in candidates]
        confidence = confidences(evidence, constants)
        order = np.argsort(-confidence, kind="stable")
        outcome, accepted = decide(confidence[order], least, constants)
        printed = candidates[order[0]].printed if accepted else None
        if printed is not None and self._twins.of_view(snapshot, printed.view):
            # Of two objects with one print, the one that looks more alike does so by chance.
            outcome, accepted = "multiple", False
        beside = _beside(features, snapshot, [candidates[k] for k in order])
        # A neighbour has little of the query's print for itself, and is named all the same.
        matches = [
            _as_match(
                candidates[k],
                snapshot,
                float(confidence[k]),
                beside.get(candidates[k].object_number, ""),
            )
            for k in order[:max_results]
            if confidence[k] >= _MIN_NAMED or candidates[k].object_number in beside
        ]
        family = "" if accepted else self._family(candidates, confidence, snapshot)
        if family:
            outcome = "multiple"
        first = matches[0].confidence if matches else 0.0
        return Recognition(
            outcome, accepted, tuple(matches), family,
            ask_again=not accepted and first >= constants.undecided_from,
            views_untried=0 if accepted else untried,
        )  # fmt: skip

    def prepare(self, view_iris: Collection[str]) -> None:
        """Compare new views with those that are stored now, rather than in the next query.

        Parameters
        ----------
        view_iris
            Views that were added to the index; others are passed over.
        """
        snapshot = self.index.snapshot()
        alive = np.flatnonzero(snapshot.alive).tolist()
        requested = set(view_iris)
        self._facts.prepare(snapshot, [k for k in alive if snapshot.view_iris[k] in requested])

    def compare_outdated(self, most: int) -> int:
        """Compare some of the stored views that no query should have to compare.

        After many views came at once, nothing is known of them; after many came one by one, what
        was known of the older ones no longer holds.

        Parameters
        ----------
        most
            Views to compare in this call.

        Returns
        -------
        int
            Views that are left.
        """
        snapshot = self.index.snapshot()
        outdated = self._facts.outdated(snapshot)
        self._facts.compare(snapshot, outdated[:most])
        return max(len(outdated) - most, 0)

    def same_print(self, view_iri: str) -> tuple[str, ...]:
        """Return the IRIs of other objects that carry the print of a view's object, sorted."""
        snapshot = self.index.snapshot()
        alive = np.flatnonzero(snapshot.alive).tolist()
        views = [view for view in alive if snapshot.view_iris[view] == view_iri]
        others = {
            object_iri for view in views for object_iri in self._twins.of_object(snapshot, view)
        }
        return tuple(sorted(snapshot.object_iris[number] for number in others))

    def forget_comparisons(self) -> None:
        """Delete what lies beside the index: its next recogniser compares stored views again."""
        self._facts.forget()

    def _family(
        self,
        candidates: list[Candidate],
        confidence: NDArray[np.float64],
        snapshot: Snapshot,
    ) -> str:
        """Return the object that would be accepted if nothing contradicted, else nothing."""
        if len(candidates) == 0:
            return ""
        first = candidates[int(np.argmax(confidence))]
        odds = first.evidence.family_odds
        if odds is None or first.printed is None or first.printed.evidence.difference is None:
            return ""
        is_near = odds >= self.params.confidence.family_odds
        return snapshot.object_iris[first.object_number] if is_near else ""

    def gather(self, features: ViewFeatures, snapshot: Snapshot) -> list[Candidate]:
        """Return the three objects of most inliers and the three of most similar look."""
        return self.gather_counted(features, snapshot)[0]

    def gather_counted(
        self, features: ViewFeatures, snapshot: Snapshot
    ) -> tuple[list[Candidate], int]:
        """Return the candidates, and how many views with votes enough were not compared."""
        if not snapshot.alive.any():
            return [], 0
        similarity = snapshot.appearance(features.appearance)
        matches = snapshot.match(features.descriptors)
        fits = verified_views(features, snapshot, similarity, self.params, matches)
        untried = untried_views(features, snapshot, similarity, self.params, matches, fits)
        ranking = Ranking(features, snapshot, similarity, fits, self.params)
        first = ranking.first()
        printed = self._printed(features, snapshot, matches, fits, first)
        objects = [
            ranking.candidate(number, printed.get(number)) for number in chosen(first, printed)
        ]
        if features.is_mask_guessed:
            objects = [self._by_all_views(features, snapshot, number) for number in objects]
        return objects, untried

    def _by_all_views(
        self, features: ViewFeatures, snapshot: Snapshot, candidate: Candidate
    ) -> Candidate:
        """Return a candidate with the odds of print by all its views, where there are enough."""
        odds, printed, params = (
            candidate.evidence.print_odds,
            candidate.printed,
            self.params.all_views,
        )
        if odds is None or printed is None or odds <= params.min_odds:
            return candidate
        number = candidate.object_number
        agreement = agreement_of_views(features, snapshot, self._facts, number, params)
        if agreement is None:
            return candidate
        odds = odds_of_views(odds, agreement, params)
        odds = within_requirements(odds, printed.evidence, self.params.printed, True)
        return replace(candidate, evidence=replace(candidate.evidence, print_odds=odds))

    def _printed(
        self,
        features: ViewFeatures,
        snapshot: Snapshot,
        matches: Matches,
        fits: list[VerifiedView],
        first: First,
    ) -> dict[int, PrintedView]:
        """Return the objects whose print agrees, by number; at least those that are chosen."""
        if not features.picture:
            return {}
        params = self.params
        proposed = proposed_views(
            matches, snapshot, params.distance_cap, params.max_views, _PRINTED_PER_OBJECT
        )
        best = sorted(fits, key=lambda fit: (-fit.places, fit.view))[:_PRINTED_FITS]
        views = dict.fromkeys([*(fit.view for fit in best), *proposed])
        chosen_objects = {*first.by_places, *first.by_look}
        return printed_objects(features, snapshot, self._facts, views, chosen_objects, MAX_CHOSEN)


def _beside(
    features: ViewFeatures, snapshot: Snapshot, candidates: list[Candidate]
) -> dict[int, str]:
    """Return where other things are seen than the first of the candidates, by object number."""
    params = BesideParams()
    first = next(iter(candidates), None)
    if first is None or first.printed is None or len(first.printed.alignment) < params.min_matches:
        return {}
    accepted = first.printed.alignment, snapshot.stored_view(first.printed.view)
    places = {}
    for candidate in candidates[1:]:
        printed = candidate.printed
        if printed is None or candidate.evidence.inliers < params.min_places:
            continue
        other = printed.alignment, snapshot.stored_view(printed.view)
        place = place_beside(features, accepted, other, params)
        if place:
            places[candidate.object_number] = place
    return places


def _as_match(
    candidate: Candidate, snapshot: Snapshot, confidence: float, beside: str = ""
) -> Match:
    """Return the answer's entry."""
    views = candidate.views
    inliers, difference = candidate.evidence.inliers, None
    if candidate.printed is not None:
        difference = candidate.printed.evidence.difference
        inliers = candidate.printed.evidence.matches
    movement = next((fit.query_from_view for fit in candidate.fits if fit.view == views[0]), None)
    if movement is None and candidate.printed is not None:
        movement = candidate.printed.query_from_view
    return Match(
        object_iri=snapshot.object_iris[candidate.object_number],
        class_iri=snapshot.class_iris[snapshot.class_of_view[views[0]]],
        confidence=confidence,
        inliers=inliers,
        views=tuple(snapshot.view_iris[view] for view in views),
        appearance=candidate.evidence.appearance,
        size_ok=candidate.evidence.size_ok,
        query_from_view=movement,
        view_iri=snapshot.view_iris[views[0]],
        difference=difference,
        by_print=candidate.evidence.passes_on_print(confidence),
        extent=0.0 if candidate.printed is None else candidate.printed.evidence.extent,
        is_in_other_light=candidate.is_in_other_light,
        homography=None
        if candidate.printed is None
        else candidate.printed.alignment.query_from_view,
        beside=beside,
    )


def warm_up() -> None:
    """Compile the kernels now, not in the first query (about ten seconds, once a machine)."""
    rng = np.random.default_rng(0)
    image = (rng.random((24, 24)).repeat(8, axis=0).repeat(8, axis=1) * 255).astype(np.uint8)
    features = describe_view(image, np.ones(image.shape, bool))
    side = len(image)
    camera = Intrinsics(side, side, 2.0 * side, 2.0 * side, side / 2, side / 2)
    stored_features(features, Frame(np.full(image.shape, 0.3, np.float32), camera))
    with RecognitionIndex() as index:
        index.add("view:warm", "object:warm", "class:warm", features)
        Recogniser(index).recognise(features)
        index.save()
        snapshot = index.snapshot()
    block, labels = snapshot.parts[0].block, snapshot.object_of_view
    alive = snapshot.parts[0].alive
    assert block.tables is not None
    offsets, rows = block.tables
    # An index of one view is compared in full; these are for larger ones.
    match_tables(
        *(block.descriptors, block.codes, block.buckets, block.descriptors, block.codes, offsets),
        *(rows, labels, block.view_of_row, alive, True),
    )
    match_flat(
        *(block.descriptors, block.codes, block.descriptors, block.codes),
        *(labels, block.view_of_row, alive),
    )
