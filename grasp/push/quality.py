"""Estimates of a grasp's probability of success from its trials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from grasp.push.candidates import Grasps

__all__ = ["best_first", "density_quality", "density_weights", "lower_bound"]


def lower_bound(successes: IntArray, tried: IntArray, confidence: float = 0.95) -> FloatArray:
    """Return one-sided lower bounds on probabilities (Clopper and Pearson 1934).

    >>> float(lower_bound(np.array([100]), np.array([100]))[0].round(4))
    0.9705
    """
    # Not scipy.stats.beta, whose checks take longer than a race's batch of trials.
    from scipy.special import betaincinv

    s, n = np.broadcast_arrays(np.asarray(successes), np.asarray(tried))
    out = np.zeros(s.shape)
    some = (s > 0) & (n > 0)
    out[some] = betaincinv(s[some], n[some] - s[some] + 1, 1 - confidence)
    return out


def density_weights(draws: FloatArray) -> FloatArray:
    """Return weights (N,) proportional to the density of the draws (N, ...), largest 1.

    The "weighted percentage" of Kehoe 2014, 3.4. As the draws already follow that density, the
    weighted mean integrates under its square, a Gaussian narrower by sqrt 2, and in many dimensions
    a few draws carry all weight; the plain mean estimates equation 3.1.
    """
    log = -0.5 * (draws.reshape(len(draws), -1) ** 2).sum(axis=1)
    return np.asarray(np.exp(log - log.max()))


def density_quality(success: NDArray[np.bool_], draws: FloatArray) -> FloatArray:
    """Return density-weighted qualities (g,) of successes (g, N)."""
    weights = density_weights(draws)
    return np.asarray(success @ weights / weights.sum())


def best_first(quality: FloatArray, grasps: Grasps, alive: NDArray[np.bool_]) -> IntArray:
    """Return the order of grasps: survivors first, then by quality.

    Among equals the one whose neighbours (contacts and angles) are better, then the lower index:
    the middle of a good region is the safer choice.
    """
    points, turns = grasps.points, grasps.turns
    table = np.zeros((int(points.max()) + 1, int(turns.max()) + 1))
    table[points, turns] = quality
    count = len(table)
    around = np.zeros(len(quality))
    for dp in (-1, 0, 1):
        for dt in (-1, 0, 1):
            t = np.clip(turns + dt, 0, table.shape[1] - 1)
            around += table[(points + dp) % count, t]
    return np.lexsort((np.arange(len(quality)), -np.round(around, 9), -quality, ~alive))
