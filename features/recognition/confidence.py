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
    """

    inliers: int
    rival_inliers: int
    appearance: float
    appearance_lead: float
    size_ok: bool | None = None


@dataclass(frozen=True)
class ConfidenceParams:
    """Constants of the decision.

    Parameters
    ----------
    inliers, rival, appearance, lead, offset
        Weights of the logistic function in :func:`confidences`.
    threshold
        Kehoe's c_I: the least confidence of an accepted answer.
    listed
        The least confidence of an object in the match set.
    most_rival_share
        Second best confidence over best from which on the answer is ambiguous.
    decisive_inliers
        Fewer inliers may suggest an object, but not decide, unless the size is known to fit.
    undecided
        The most confidence without that.
    """

    inliers: float = 2.87
    rival: float = -0.92
    appearance: float = 2.71
    lead: float = 12.46
    offset: float = -8.48
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
        elif e.inliers < params.decisive_inliers and not e.size_ok:
            confidence[k] = min(confidence[k], params.undecided)
    return confidence


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
