"""A robot's own map from a planner's score to the chance that a grasp holds.

Scores order grasps; whether .8 means four of five depends on the robot, its hand and its world. The
map is a line in the logit of the score (Platt 1999) whose two numbers start where a prior has them
and move with the robot's own outcomes: the most probable values under a Gaussian prior. It is
computed from all outcomes together, so that it can be rebuilt from them exactly.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from grasp.arrays import FloatArray

__all__ = ["IDENTITY", "ScoreMap", "band_margin", "fit_map"]

_EDGE = 0.02
_OFFSET_STD, _SLOPE_STD = 0.5, 0.2
_ITERATIONS, _SETTLED = 100, 1e-13
_LOWER_Z = 1.6448536269514722


@dataclass(frozen=True)
class ScoreMap:
    """Chance = logistic(offset + slope logit(score)), with how sure both numbers are.

    Parameters
    ----------
    offset, slope
        a and b; b is never negative.
    variances
        Of a and b.
    covariance
        Of a with b.
    outcomes
        From how many it grew.

    Examples
    --------
    >>> round(IDENTITY.chance(0.7), 6), IDENTITY.lower(0.7) < 0.7
    (0.7, True)
    """

    offset: float = 0.0
    slope: float = 1.0
    variances: tuple[float, float] = (_OFFSET_STD**2, _SLOPE_STD**2)
    covariance: float = 0.0
    outcomes: int = 0

    def chance(self, score: float) -> float:
        """Return the chance that a grasp with a score holds; scores count within .02 and .98."""
        return _logistic(self.offset + self.slope * _logit(score))

    def lower(self, score: float) -> float:
        """Return the one-sided 95 % bound below the chance."""
        x = _logit(score)
        spread = self.variances[0] + 2 * x * self.covariance + x * x * self.variances[1]
        return _logistic(self.offset + self.slope * x - _LOWER_Z * float(np.sqrt(max(spread, 0.0))))


IDENTITY = ScoreMap()
"""The map of a robot without outcomes: scores are believed."""


def fit_map(
    outcomes: Iterable[tuple[float, bool]],
    prior: ScoreMap = IDENTITY,
    weights: Sequence[float] | None = None,
) -> ScoreMap:
    """Return the most probable map after outcomes, which may come in any order.

    Parameters
    ----------
    outcomes
        Score of a grasp, and whether it held; those whose score is not finite do not count.
    prior
        Means and variances of both numbers before; taken as independent.
    weights
        What each outcome counts, such as less for several of one object; None = 1.

    Examples
    --------
    >>> optimist = fit_map([(0.9, True), (0.9, False)] * 20)
    >>> round(optimist.chance(0.9), 1), optimist.outcomes
    (0.6, 40)
    """
    # Sorted, so that sums round the same whatever the order.
    rows = list(outcomes)
    given = [1.0] * len(rows) if weights is None else [float(weight) for weight in weights]
    observed = sorted(
        (float(s), bool(held), weight)
        for (s, held), weight in zip(rows, given, strict=True)
        if np.isfinite(s) and weight > 0
    )
    if not observed:
        return prior
    x = np.array([_logit(score) for score, _, _ in observed])
    y = np.array([held for _, held, _ in observed], dtype=np.float64)
    counts = np.array([weight for _, _, weight in observed])
    start = np.array([prior.offset, prior.slope])
    precision = 1.0 / np.array(prior.variances)
    best = _newton(x, y, counts, start, precision, free=True)
    if best[1] < 0:
        best = _newton(x, y, counts, np.array([prior.offset, 0.0]), precision, free=False)
    p = 1 / (1 + np.exp(-(best[0] + best[1] * x)))
    covariance = np.linalg.inv(_curvature(x, p * (1 - p) * counts, precision))
    return ScoreMap(
        float(best[0]), float(best[1]), (float(covariance[0, 0]), float(covariance[1, 1])),
        float(covariance[0, 1]), prior.outcomes + len(observed),
    )  # fmt: skip


def band_margin(chances: FloatArray, shares: FloatArray, coverage: float = 0.9) -> float:
    """Return by how much to lower chances so that most shares are at least what is promised.

    Split conformal prediction (Lei et al. 2018): of new objects that are drawn like these, at least
    ``coverage`` hold in at least the share ``chance - margin`` of their trials, whatever is wrong
    with the chances.

    Parameters
    ----------
    chances, shares : (n,)
        Of one grasp of each object: the chance promised, and the share of its trials that held.

    Raises
    ------
    ValueError
        There are too few objects for that coverage: 9 for .9, 19 for .95.

    Examples
    --------
    >>> band_margin(np.full(19, 0.8), np.linspace(0.1, 1.0, 19))  # second worst: 0.15
    0.65
    """
    over = np.sort(np.asarray(chances, dtype=np.float64) - np.asarray(shares, dtype=np.float64))
    rank = int(np.ceil((len(over) + 1) * coverage - 1e-9))
    if not 1 <= rank <= len(over):
        raise ValueError(f"{len(over)} objects are too few for a coverage of {coverage:g}")
    return round(float(over[rank - 1]), 12)


def _newton(
    x: FloatArray,
    y: FloatArray,
    counts: FloatArray,
    start: FloatArray,
    precision: FloatArray,
    free: bool,
) -> FloatArray:
    """Maximise the posterior; with ``free`` off the slope stays as it is."""
    at = start.copy()
    for _ in range(_ITERATIONS):
        p = 1 / (1 + np.exp(-(at[0] + at[1] * x)))
        rest = counts * (y - p)
        slope = np.array([rest.sum(), (rest * x).sum()]) - precision * (at - start)
        curvature = _curvature(x, counts * p * (1 - p), precision)
        step = np.linalg.solve(curvature, slope)
        if not free:
            step = np.array([slope[0] / curvature[0, 0], 0.0])
        # A full step may overshoot far from the optimum; half the prior's width never does.
        step *= min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-300))
        at = at + step
        if float(np.abs(step).max()) < _SETTLED:
            break
    return at


def _curvature(x: FloatArray, w: FloatArray, precision: FloatArray) -> FloatArray:
    cross = (w * x).sum()
    return np.array([[w.sum(), cross], [cross, (w * x * x).sum()]]) + np.diag(precision)


def _logit(score: float) -> float:
    inside = min(max(float(score), _EDGE), 1 - _EDGE)
    return float(np.log(inside / (1 - inside)))


def _logistic(value: float) -> float:
    return float(1 / (1 + np.exp(-value)))
