"""Promises of picks beside what held: over all, by quarters, and after outcomes of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.recognition.metrics import expected_calibration_error
from grasp.arrays import FloatArray
from grasp.learning.calibration import ScoreMap, band_margin
from grasp.spatial.scoring.holding import demanded_share
from grasp.spatial.scoring.promises import FactoryMap, Promises, chance_spread
from simulate.study.intervals import mean_interval, share
from simulate.study.quality.made_hands import studied_hand

__all__ = ["coverage_of", "promise_figures", "scores_of"]

_PLANNED = "planned"
_OWN, _DRAWS, _QUARTERS = 50, 20, 4
_HALVES, _FEWEST, _COVERAGE = 200, 9, 0.9

_FORMER = {"lift": ScoreMap(1.4, 1.0), "carry": ScoreMap(2.1, 0.8)}
"""Maps of scores alone, one for all hands and loads, which the present ones are compared with."""

Results = Sequence[Mapping[str, Any]]


def scores_of(result: Mapping[str, Any], scores: Mapping[str, float]) -> dict[str, float]:
    """Return the scores of a grasp with the load that its object is for the hand, if known."""
    if "load" in scores or "mass" not in result:
        return dict(scores)
    return {**scores, "load": demanded_share(studied_hand(result["hand"]), result["mass"])}


def coverage_of(results: Results) -> dict[str, Any]:
    """Return the share of objects with a planned grasp, of those that any rule found a grasp of.

    An object without a planned grasp counts as one that did not hold. Where results do not say
    whether the sampler found a grasp, the object counts as graspable.
    """
    alone = all(set(result["rules"]) <= {_PLANNED} for result in results)
    graspable = [
        result for result in results
        if result["rules"] or (alone and result.get("graspable", True))
    ]  # fmt: skip
    return share(sum(_PLANNED in result["rules"] for result in graspable), len(graspable))


def promise_figures(results: Results, outcome: str, score: str) -> dict[str, Any]:
    """Compare what was promised of the planned picks of one hand with what held.

    Parameters
    ----------
    results
        Of one hand.
    outcome, score
        ``held`` with ``lift``, or ``carried`` with ``carry``.

    Returns
    -------
    dict
        ``n`` trials; ``error`` and ``promised`` of the raw score, ``error_by_factory`` and
        ``gap_by_factory`` of the chances, the same after 50 own outcomes; ``quarters`` from the
        lowest promises to the highest, before and after own outcomes, with their widest gap;
        ``less_former`` the paired difference of squared errors to maps of the score alone.
    """
    picks = [
        (result, result["rules"][_PLANNED])
        for result in results
        if score in result["rules"].get(_PLANNED, {"promised": {}})["promised"]
    ]
    if not picks:
        return {"n": 0}
    before = Promises.by(studied_hand(picks[0][0]["hand"]))
    scores = [scores_of(result, pick["promised"]) for result, pick in picks]
    held = [np.array(pick[outcome], dtype=bool) for _, pick in picks]
    trials = np.array([len(row) for row in held])
    every, shares = np.concatenate(held), np.array([row.mean() for row in held])
    raw = np.repeat([row[score] for row in scores], trials)
    chances = _chances(before, scores, score)
    mapped = np.repeat(chances, trials)
    former = np.array([_FORMER[score].chance(row[score]) for row in scores])
    quarters = _quarters(chances, shares)
    for quarter, part in zip(quarters, _parts(chances), strict=True):
        quarter["gap_interval95"] = mean_interval((chances - shares)[part])["interval95"]
    return {
        "n": len(every),
        "promised": round(float(raw.mean()), 4),
        "held": round(float(every.mean()), 4),
        "error": round(expected_calibration_error(raw, every), 4),
        "error_by_factory": round(expected_calibration_error(mapped, every), 4),
        "gap_by_factory": round(abs(float(mapped.mean()) - float(every.mean())), 4),
        "quarters": quarters,
        "widest_gap": _widest(quarters),
        "chance_gap": _chance_gap(chances, trials),
        "former_widest_gap": _widest(_quarters(former, shares)),
        "less_former": mean_interval((chances - shares) ** 2 - (former - shares) ** 2),
        **_after_own_outcomes(before, scores, held, score),
        **_covered(chances, shares, before.maps[score]),
    }


def _chances(promises: Promises, scores: Sequence[Mapping[str, float]], score: str) -> FloatArray:
    return np.array([promises.of(row)[f"{score}_chance"] for row in scores])


def _quarters(chances: FloatArray, shares: FloatArray) -> list[dict[str, Any]]:
    """Return mean promise and mean share held of each quarter of the objects, lowest first."""
    return [
        {
            "promised": round(float(chances[part].mean()), 4),
            "held": round(float(shares[part].mean()), 4),
            "n": len(part),
        }
        for part in _parts(chances)
    ]


def _parts(chances: FloatArray) -> list[NDArray[np.intp]]:
    """Return the objects of each quarter, those that are promised least first."""
    order = np.argsort(chances, kind="stable")
    return [part for part in np.array_split(order, _QUARTERS) if len(part)]


def _widest(quarters: Sequence[Mapping[str, Any]]) -> float:
    gaps = [abs(float(quarter["promised"]) - float(quarter["held"])) for quarter in quarters]
    return round(max(gaps), 4)


def _chance_gap(chances: FloatArray, trials: NDArray[np.int64]) -> float:
    """Return the widest gap that right promises would show on so few objects: a mean of draws.

    The trials of one object are taken for independent; as they are alike, chance alone does more.
    """
    rng = np.random.default_rng(0)
    drawn = [
        _widest(_quarters(chances, rng.binomial(trials, chances) / trials)) for _ in range(_DRAWS)
    ]
    return round(float(np.mean(drawn)), 4)


def _after_own_outcomes(
    before: Promises,
    scores: Sequence[Mapping[str, float]],
    held: Sequence[NDArray[np.bool_]],
    score: str,
) -> dict[str, Any]:
    """Return what 50 own outcomes make of the promises of other objects.

    Means over 20 draws: half of the objects give the outcomes, the other half is judged.
    """
    rng = np.random.default_rng(0)
    errors, gaps, quarters = [], [], []
    for _ in range(_DRAWS if len(scores) > 1 else 0):
        order = rng.permutation(len(scores))
        mine, new = order[: len(order) // 2], order[len(order) // 2 :]
        own = [(scores[k], {score: bool(h)}) for k in mine for h in held[k]]
        chosen = rng.permutation(len(own))[:_OWN]
        after = before.after([own[k] for k in chosen])
        chances = _chances(after, [scores[k] for k in new], score)
        repeated = np.repeat(chances, [len(held[k]) for k in new])
        every = np.concatenate([held[k] for k in new])
        errors.append(expected_calibration_error(repeated, every))
        gaps.append(abs(float(repeated.mean()) - float(every.mean())))
        quarters.append(_quarters(chances, np.array([held[k].mean() for k in new])))
    if not errors:
        return {}
    means = [
        {
            key: round(float(np.mean([draw[key] for draw in drawn])), 4)
            for key in ("promised", "held")
        }
        for drawn in zip(*quarters, strict=True)
    ]
    return {
        "error_after_50": round(float(np.mean(errors)), 4),
        "gap_after_50": round(float(np.mean(gaps)), 4),
        "quarters_after_50": means,
        "widest_gap_after_50": _widest(means),
    }


def _covered(chances: FloatArray, shares: FloatArray, factory: FactoryMap) -> dict[str, Any]:
    """Return of how many objects at least the promised share held, nine of ten being aimed at.

    By the factory's shortfall, with an interval, and of how many that promises nothing at all; and
    by one from half of the objects over the other half: the mean over 200 draws, beside what it
    would be if no two objects were alike. That is above .9, as a shortfall is that of some object;
    the rest of the excess comes from ties.
    """
    least = np.array([factory.at_least(float(chance)) for chance in chances])
    hits = share(int((shares >= least - 1e-9).sum()), len(shares))
    coverage = {
        "covered": round(hits["share"], 4),
        "covered_95": hits["interval95"],
        "abstained": round(float((least <= 0).mean()), 4),
    }
    unit = np.array([chance_spread(float(chance)) for chance in chances])
    beside, halves = (chances - shares) / unit, []
    rng = np.random.default_rng(0)
    for _ in range(_HALVES if len(shares) // 2 >= _FEWEST else 0):
        order = rng.permutation(len(shares))
        earlier, new = order[: len(order) // 2], order[len(order) // 2 :]
        margin = band_margin(beside[earlier], np.zeros(len(earlier)), _COVERAGE)
        least = np.maximum(chances[new] - margin * unit[new], 0.0)
        halves.append(float((shares[new] >= least - 1e-9).mean()))
    if halves:
        places = len(shares) // 2 + 1
        rank = np.ceil(places * _COVERAGE - 1e-9)
        coverage["covered_by_halves"] = round(float(np.mean(halves)), 4)
        coverage["expected_by_halves"] = round(float(rank / places), 4)
    return coverage
