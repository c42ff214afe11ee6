"""95 % intervals of shares (Wilson 1927) and of statistics (percentile bootstrap, Efron 1979)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

__all__ = ["bootstrap", "mean_interval", "share", "wilson"]


def wilson(hits: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share.

    >>> [round(v, 3) for v in wilson(9, 10)]
    [0.596, 0.982]
    """
    if not 0 <= hits <= n:
        raise ValueError(f"{hits} hits of {n} are not a share")
    if n == 0:
        return 0.0, 1.0
    interval = stats.binomtest(hits, n).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def share(hits: int, n: int) -> dict[str, Any]:
    """Return a share with its interval as JSON data."""
    low, high = wilson(hits, n)
    return {
        "hits": hits,
        "n": n,
        "share": hits / n if n else None,
        "interval95": [round(low, 4), round(high, 4)],
    }


def bootstrap(
    statistic: Callable[[NDArray[np.intp]], float], n: int, draws: int = 1000, seed: int = 0
) -> tuple[float, float]:
    """Return the 95 % percentile interval of a statistic of resampled indices 0..n-1.

    Parameters
    ----------
    statistic
        Takes (n,) indices drawn with replacement.
    n
        Size of the sample; of a single one the interval is its value.
    """
    indices = np.arange(n)
    if n == 1:
        return (value := float(statistic(indices))), value
    interval = stats.bootstrap(
        (indices,), statistic, n_resamples=draws, vectorized=False, method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    return float(interval.low), float(interval.high)


def mean_interval(values: ArrayLike) -> dict[str, Any]:
    """Return a mean with its bootstrap interval as JSON data; None without values."""
    array = np.asarray(values, dtype=np.float64)
    if not len(array):
        return {"mean": None, "n": 0, "interval95": None}
    low, high = bootstrap(lambda i: float(array[i].mean()), len(array), 1000, 0)
    return {
        "mean": round(float(array.mean()), 4),
        "n": len(array),
        "interval95": [round(low, 4), round(high, 4)],
    }
