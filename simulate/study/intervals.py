"""Intervals for shares and for means: Wilson (1927) and the percentile bootstrap (Efron 1979)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["bootstrap", "mean_interval", "share", "wilson"]

_Z95 = 1.959964


def wilson(hits: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share.

    >>> [round(v, 3) for v in wilson(9, 10)]
    [0.596, 0.982]
    """
    if not 0 <= hits <= n:
        raise ValueError(f"{hits} of {n} is no share")
    if n == 0:
        return 0.0, 1.0
    p, z2 = hits / n, _Z95**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = _Z95 * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return max(middle - half, 0.0), min(middle + half, 1.0)


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
        Takes (n,) indices drawn with repetition.
    """
    rng = np.random.default_rng(seed)
    values = [statistic(rng.integers(0, n, n)) for _ in range(draws)]
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(low), float(high)


def mean_interval(values: ArrayLike, draws: int = 1000, seed: int = 0) -> dict[str, Any]:
    """Return a mean with its bootstrap interval as JSON data; of nothing, None."""
    rows: Sequence[float] | NDArray[np.float64] = np.asarray(values, dtype=np.float64)
    if not len(rows):
        return {"mean": None, "n": 0, "interval95": None}
    array = np.asarray(rows)
    low, high = bootstrap(lambda i: float(array[i].mean()), len(array), draws, seed)
    return {
        "mean": round(float(array.mean()), 4),
        "n": len(array),
        "interval95": [round(low, 4), round(high, 4)],
    }
