"""One answer from several looks at the same thing.

A look-alike that passes once seldom passes from another side, and what one photograph hides another
shows: the best two of three decide.
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
        Mean of the best looks that is accepted.
    best
        So many looks count, those that speak most for the object.
    most
        Bound of what one look can say.
    """

    absent: float = -1.5
    decisive: float = 1.5
    best: int = 2
    most: float = 6.0


def fuse(
    looks: Sequence[Recognition],
    params: FusionParams | None = None,
    confidence: ConfidenceParams | None = None,
) -> Recognition:
    """Return the answer of several looks at one object, with the matches of the best look of each.

    A single look is returned as it is.

    Examples
    --------
    >>> def look(sure):
    ...     match = Match("object:1", "class:box", sure, 9, (), 0.9, None, None, "view:1")
    ...     return Recognition("single", False, (match,))
    >>> fuse([look(0.85), look(0.2), look(0.9)]).accepted
    True
    >>> fuse([look(0.85), look(0.2)]).accepted
    False
    """
    params = params or FusionParams()
    if len(looks) == 1:
        return looks[0]
    seen: dict[str, list[Match]] = {}
    for look in looks:
        for match in look.matches:
            seen.setdefault(match.object_iri, []).append(match)
    found = []
    for matches in seen.values():
        odds = [_odds(match.confidence, params.most) for match in matches]
        odds += [params.absent] * (len(looks) - len(odds))
        mean = float(np.mean(sorted(odds, reverse=True)[: params.best]))
        best = max(matches, key=lambda match: match.confidence)
        found.append(replace(best, confidence=float(1 / (1 + np.exp(-mean)))))
    found.sort(key=lambda match: (-match.confidence, match.object_iri))
    least = float(1 / (1 + np.exp(-params.decisive)))
    constants = confidence or ConfidenceParams()
    outcome, accepted = decide(np.array([m.confidence for m in found]), least, constants)
    if len(found) == 0:
        return Recognition("null", False)
    family = next((look.family for look in looks if look.family == found[0].object_iri), "")
    return Recognition(
        outcome if accepted or not family else "multiple",
        accepted,
        tuple(found),
        family="" if accepted else family,
        ask_again=not accepted and found[0].confidence >= constants.undecided_from,
    )


def _odds(confidence: float, most: float) -> float:
    bounded = min(max(confidence, 1e-6), 1 - 1e-6)
    return float(np.clip(np.log(bounded / (1 - bounded)), -most, most))
