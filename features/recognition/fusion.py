"""One answer from several looks at the same thing.

A look-alike that passes once seldom passes from another side, and what one photograph hides another
shows: the best two of three decide. But the more looks, the more likely is one in which only what
siblings share is in view: what speaks for an object has to span more of it than in a single look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from features.recognition.confidence import ConfidenceParams, decide
from features.recognition.recogniser import Match, Recognition

__all__ = ["FusionParams", "fuse"]


@dataclass(frozen=True)
class FusionParams:
    """Constants of the fusion, in logarithmic odds.

    Parameters
    ----------
    absent
        Stands for a look in which the object is no candidate.
    decisive
        Mean of the best looks that is accepted where one look alone accepted.
    best
        So many looks count, those that speak most for the object.
    most
        Bound of what one look can say.
    agreeing
        So many looks that accept an object by themselves agree: nothing more is asked of them.
    min_extent
        The widest span of matches, of the object's longer side, among the looks that accept it by
        their print; for less the odds are at most even.
    """

    absent: float = -1.5
    decisive: float = 1.5
    best: int = 2
    most: float = 6.0
    agreeing: int = 2
    min_extent: float = 0.27

    @property
    def min_confidence(self) -> float:
        """Least confidence of an accepted answer of several looks."""
        return _share(self.decisive)


def fuse(
    looks: Sequence[Recognition],
    params: FusionParams | None = None,
    confidence: ConfidenceParams | None = None,
    min_confidence: float | None = None,
) -> Recognition:
    """Return the answer of several looks at one object.

    An object is accepted if two looks accepted it by themselves, or one did and the mean of its
    best looks suffices; and if fewer looks accepted another object. A single look is returned as it
    is.

    Parameters
    ----------
    looks
        Answers, each for one look. Movements of the answer refer to the camera of the first: a
        match that the first look lacks has none.
    min_confidence
        Least confidence of an accepted answer that a single look accepts; default:
        :attr:`FusionParams.decisive`.

    Examples
    --------
    >>> def look(sure):
    ...     match = Match("object:1", "class:box", sure, 9, (), 0.9, None, None, "view:1")
    ...     return Recognition("single", sure >= 0.7, (match,))
    >>> fuse([look(0.85), look(0.2), look(0.9)]).accepted
    True
    >>> fuse([look(0.77), look(0.77)]).accepted, fuse([look(0.85), look(0.2)]).accepted
    (True, False)
    """
    params = params or FusionParams()
    if len(looks) == 1:
        return looks[0]
    seen: dict[str, list[Match]] = {}
    for look in looks:
        for match in look.matches:
            seen.setdefault(match.object_iri, []).append(match)
    here = {match.object_iri: match for match in looks[0].matches}
    fused = []
    for object_iri, matches in seen.items():
        odds = [_odds(match.confidence, params.most) for match in matches]
        odds += [params.absent] * (len(looks) - len(odds))
        mean = float(np.mean(sorted(odds, reverse=True)[: params.best]))
        if _is_narrow(looks, object_iri, params):
            mean = min(mean, 0.0)
        best = max(matches, key=lambda match: match.confidence)
        shown = here.get(object_iri) or replace(
            best, query_from_view=None, difference=None, homography=None, beside=""
        )
        # A word that one look shows in place of another is not outvoted by looks that hide it.
        words = next((match.words for match in matches if match.words is not None), None)
        mean = mean if words is None else min(mean, 0.0)
        fused.append(replace(shown, confidence=_share(mean), words=words))
    fused.sort(key=lambda match: (-match.confidence, match.object_iri))
    first_seen = next((match.object_iri for match in looks[0].matches), "")
    if fused and fused[0].object_iri != first_seen:
        fused = [replace(match, beside="") for match in fused]
    constants = confidence or ConfidenceParams()
    untried = min(look.views_untried for look in looks)
    if len(fused) == 0:
        return Recognition("null", False, views_untried=untried)
    first = fused[0].object_iri
    votes = sum(look.accepts(first) for look in looks)
    least = params.min_confidence if min_confidence is None else min_confidence
    if votes >= params.agreeing:
        least = min(least, constants.threshold)
    outcome, accepted = decide(np.array([m.confidence for m in fused]), least, constants)
    accepted = accepted and votes > sum(look.accepted for look in looks) - votes
    accepted = accepted and fused[0].words is None
    family = next((look.family for look in looks if look.family == first), "")
    return Recognition(
        outcome if accepted or not family else "multiple",
        accepted,
        tuple(fused),
        family="" if accepted else family,
        ask_again=not accepted and fused[0].confidence >= constants.undecided_from,
        views_untried=0 if accepted else untried,
    )


def _is_narrow(looks: Sequence[Recognition], object_iri: str, params: FusionParams) -> bool:
    """Tell whether an object is accepted by print alone, and all of that lies close together."""
    accepting = [look.matches[0] for look in looks if look.accepts(object_iri)]
    if not accepting or not all(match.by_print for match in accepting):
        return False
    return max(match.extent for match in accepting) < params.min_extent


def _share(odds: float) -> float:
    return float(1 / (1 + np.exp(-odds)))


def _odds(confidence: float, most: float) -> float:
    bounded = min(max(confidence, 1e-6), 1 - 1e-6)
    return float(np.clip(np.log(bounded / (1 - bounded)), -most, most))
