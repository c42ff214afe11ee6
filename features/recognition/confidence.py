"""From evidence to a confidence, and from confidences to a decision (Kehoe 2014, 4.3).

The constants are shipped; no training step is needed to use them. How they were fitted and what
they achieve stands in ``docs/recognition.md``, with the command that shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["ConfidenceParams", "Evidence", "confidences", "decide", "is_size_plausible"]

Outcome = Literal["null", "single", "multiple"]


@dataclass(frozen=True)
class Evidence:
    """What speaks for one stored object.

    Parameters
    ----------
    inliers
        Places of its best view whose matches agree on one movement.
    rival_inliers
        The most that any other object has.
    appearance
        Similarity of colours and shapes to its most similar view, 0 to 1.
    appearance_lead
        The same minus that of the most similar other object.
    size_ok
        Whether the measured size fits the stored ones; None without depth.
    size_gap
        Absolute logarithm of the measured size over that of the most similar view; None without
        depth. Two views from the same side measure the same.
    keypoints
        Of the query: where there are many and geometry found nothing, the look says nothing.
    is_twin
        Another object carries the same print: which of the two it is cannot be seen.
    """

    inliers: int
    rival_inliers: int
    appearance: float
    appearance_lead: float
    size_ok: bool | None = None
    size_gap: float | None = None
    keypoints: int = 0
    is_twin: bool = False


@dataclass(frozen=True)
class ConfidenceParams:
    """Constants of the decision.

    Parameters
    ----------
    inliers, rival, appearance, lead, offset
        Weights of the logistic function in :func:`confidences`.
    place_inliers, place_rival, place_offset
        Weights of a logistic function of places alone, where the size is known to fit: what turned
        another side, or stands in another light, looks different and is the same.
    look_lead, look_gap, look_offset
        Weights of another logistic function, for objects without texture: it speaks only when
        the size is known to fit, the similarity reaches ``look_least``, and the query has at most
        ``look_most_keypoints``.
    look_least, look_most_keypoints
        See above; what carries a print is to be recognised by it.
    threshold
        Kehoe's c_I: the least confidence of an accepted answer.
    listed
        The least confidence of an object in the match set.
    most_rival_share
        Second best confidence over best from which on the answer is ambiguous.
    decisive_inliers
        Fewer inliers may suggest an object, but not decide, unless the size is known to fit.
    undecided
        The most confidence without that, and of twins.
    """

    inliers: float = 2.79
    rival: float = -1.18
    appearance: float = 6.87
    lead: float = 11.22
    offset: float = -12.03
    place_inliers: float = 2.2
    place_rival: float = -1.8
    place_offset: float = -5.8
    look_lead: float = 23.2
    look_gap: float = -30.6
    look_offset: float = -0.4
    look_least: float = 0.87
    look_most_keypoints: int = 80
    threshold: float = 0.7
    listed: float = 0.2
    most_rival_share: float = 0.5
    decisive_inliers: int = 4
    undecided: float = 0.69


def features_of(evidence: Sequence[Evidence]) -> NDArray[np.float64]:
    """Return the inputs (k, 4) of the logistic function."""
    rows = [
        (
            np.log2(1 + e.inliers),
            np.log2(1 + e.rival_inliers),
            max(e.appearance, 0.5),
            np.clip(e.appearance_lead, -0.2, 0.2),
        )
        for e in evidence
    ]
    return np.array(rows, np.float64).reshape(-1, 4)


def confidences(
    evidence: Sequence[Evidence], params: ConfidenceParams | None = None
) -> NDArray[np.float64]:
    """Return how sure the evidence makes that the object is each of those, (k,) in 0..1.

    Examples
    --------
    >>> many, few = Evidence(20, 0, 0.8, 0.1), Evidence(4, 12, 0.6, -0.1)
    >>> (confidences([many, few]) > 0.7).tolist()
    [True, False]
    """
    params = params or ConfidenceParams()
    weights = (params.inliers, params.rival, params.appearance, params.lead)
    score = features_of(evidence) @ np.array(weights) + params.offset
    confidence: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-np.clip(score, -60, 60)))
    for k, e in enumerate(evidence):
        if e.size_ok is False:
            confidence[k] = 0.0
            continue
        confidence[k] = max(confidence[k], _by_look(e, params), _by_places(e, params))
        if e.is_twin or (e.inliers < params.decisive_inliers and not e.size_ok):
            confidence[k] = min(confidence[k], params.undecided)
    return confidence


def _by_places(e: Evidence, params: ConfidenceParams) -> float:
    """Return how sure the agreeing places alone make, where the size fits."""
    if not e.size_ok or e.inliers < params.decisive_inliers:
        return 0.0
    score = (
        params.place_inliers * np.log2(1 + e.inliers)
        + params.place_rival * np.log2(1 + e.rival_inliers)
        + params.place_offset
    )
    return float(1.0 / (1.0 + np.exp(-score)))


def _by_look(e: Evidence, params: ConfidenceParams) -> float:
    """Return how sure the look alone makes, where the size is measured too."""
    if not e.size_ok or e.size_gap is None:
        return 0.0
    if e.appearance < params.look_least or e.keypoints > params.look_most_keypoints:
        return 0.0
    lead = min(max(e.appearance_lead, -0.2), 0.2)
    gap = min(e.size_gap, 0.5)
    score = params.look_lead * lead + params.look_gap * gap + params.look_offset
    return float(1.0 / (1.0 + np.exp(-score)))


def is_size_plausible(size_m: float, is_cut: bool, stored_m: NDArray[np.floating]) -> bool | None:
    """Compare the visible diagonal with those of an object's stored views.

    Parameters
    ----------
    size_m
        Of the query, NaN without depth.
    is_cut
        The query shows only part of its object: then it may be smaller, never larger.
    stored_m : (k,) float, m
        NaN without depth.

    Returns
    -------
    bool or None
        None when either side has no size.
    """
    known = stored_m[np.isfinite(stored_m)]
    if not np.isfinite(size_m) or len(known) == 0:
        return None
    slack = min(0.010, 0.15 * float(known.max()))
    if size_m > 1.15 * float(known.max()) + slack:
        return False
    return bool(is_cut or size_m >= 0.85 * float(known.min()) - slack)


def decide(
    ranked: NDArray[np.floating], min_confidence: float, params: ConfidenceParams | None = None
) -> tuple[Outcome, bool]:
    """Return Kehoe's outcome and whether the best answer is accepted.

    Parameters
    ----------
    ranked : (k,) float
        Confidences, best first.

    Examples
    --------
    >>> decide(np.array([0.95, 0.1]), 0.7), decide(np.array([0.95, 0.6]), 0.7)
    (('single', True), ('multiple', False))
    """
    params = params or ConfidenceParams()
    listed = ranked[ranked >= params.listed]
    if len(listed) == 0:
        return "null", False
    second = float(ranked[1]) if len(ranked) > 1 else 0.0
    clear = second < params.most_rival_share * float(ranked[0])
    accepted = bool(ranked[0] >= min_confidence and clear)
    return ("single" if len(listed) == 1 else "multiple"), accepted
