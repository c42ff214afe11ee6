"""Rank correlation of scores with the shares that held, over all grasps and within objects.

How high it can be depends on how much there is to rank: where nearly all grasps of an object hold,
a few trials of each differ by luck. So it is set beside the spread of the outcomes, and beside the
correlation that the same scores would have if their chances were the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from grasp.spatial.scoring.promises import FACTORY
from simulate.study.intervals import bootstrap, mean_interval

__all__ = ["OUTCOMES", "rank_correlations"]

OUTCOMES = {"held": "lift", "carried": "carry"}
"""Outcomes of a trial, and the score that promises each."""

_FEWEST = 3
_REPEATS = 100


def rank_correlations(results: Sequence[Mapping[str, Any]], outcome: str) -> dict[str, Any]:
    """Return Spearman's correlation of score and share held, with 95 % bootstrap over objects.

    Parameters
    ----------
    results
        Of objects, each with the grasps in ``ranked``: their scores and outcomes.
    outcome
        ``held`` or ``carried``.

    Returns
    -------
    dict
        ``over`` pools the grasps of all objects, ``within`` is the mean over the objects with three
        grasps or more whose scores and shares differ. Each has ``mean``, ``n`` and ``interval95``;
        ``grasps`` counts them.
    """
    tables = [
        np.array(
            [[entry[OUTCOMES[outcome]], np.mean(entry[outcome])] for entry in result["ranked"]]
        )
        for result in results
        if len(result.get("ranked", ())) > 0
    ]
    within = [
        rho for table in tables if len(table) >= _FEWEST
        if (rho := _spearman(table[:, 0], table[:, 1])) is not None
    ]  # fmt: skip
    return {
        "over": _over(tables),
        "within": mean_interval(within),
        "grasps": sum(len(table) for table in tables),
        "spread": _spread(tables),
        "attainable": _attainable(results, outcome),
    }


def _spread(tables: Sequence[np.ndarray]) -> dict[str, float]:
    """Return the shares of grasps that held always and never, and of objects with equal grasps."""
    if not tables:
        return {}
    shares = np.concatenate(tables)[:, 1]
    alike = [np.ptp(table[:, 1]) == 0 for table in tables if len(table) >= _FEWEST]
    return {
        "always held": round(float((shares == 1).mean()), 4),
        "never held": round(float((shares == 0).mean()), 4),
        "objects all alike": round(float(np.mean(alike)), 4) if alike else 0.0,
    }


def _attainable(results: Sequence[Mapping[str, Any]], outcome: str) -> dict[str, float | None]:
    """Return the mean correlations of the same scores with outcomes drawn from their chances."""
    score, rng = OUTCOMES[outcome], np.random.default_rng(0)
    chance = FACTORY[score].chance
    over, within = list[float](), list[float]()
    for _ in range(_REPEATS):
        drawn = [
            np.array([
                [entry[score], rng.binomial(n, chance(entry[score], entry.get("load"))) / n]
                for entry in result["ranked"] if (n := len(entry[outcome]))
            ])
            for result in results if len(result.get("ranked", ())) > 0
        ]  # fmt: skip
        if drawn and (rho := _spearman(*np.concatenate(drawn).T)) is not None:
            over.append(rho)
        each = [_spearman(table[:, 0], table[:, 1]) for table in drawn if len(table) >= _FEWEST]
        correlations = [rho for rho in each if rho is not None]
        if correlations:
            within.append(float(np.mean(correlations)))
    return {
        name: round(float(np.mean(values)), 4) if values else None
        for name, values in (("over", over), ("within", within))
    }


def _over(tables: Sequence[np.ndarray]) -> dict[str, Any]:
    def pooled(chosen: np.ndarray) -> float:
        every = np.concatenate([tables[int(k)] for k in chosen])
        rho = _spearman(every[:, 0], every[:, 1])
        return 0.0 if rho is None else rho

    every = None if not tables else _spearman(*np.concatenate(tables).T)
    if every is None:
        return {"mean": None, "n": 0, "interval95": None}
    low, high = bootstrap(pooled, len(tables))
    return {
        "mean": round(every, 4),
        "n": len(tables),
        "interval95": [round(low, 4), round(high, 4)],
    }


def _spearman(scores: ArrayLike, shares: ArrayLike) -> float | None:
    """Return the correlation of ranks; None where all of one side are equal.

    >>> _spearman([0.1, 0.5, 0.9], [0.0, 0.5, 1.0])
    1.0
    >>> _spearman([0.1, 0.5, 0.9], [1.0, 1.0, 1.0]) is None
    True
    """
    if np.ptp(scores) == 0 or np.ptp(shares) == 0:
        return None
    return round(float(stats.spearmanr(scores, shares).statistic), 12)
