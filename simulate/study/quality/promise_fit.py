"""Fit of what the factory promises, over many hands, and of how much hands differ from it.

A hierarchical model: the map of :class:`grasp.spatial.scoring.promises.FactoryMap` is that of hands
at large, and each hand has an offset and a slope of its own in the logit of the factory's chance,
drawn from normal distributions about 0 and 1. Both are fitted in turn by an EM algorithm with
Laplace's approximation, the outcomes of one grasp counting less the more alike they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from grasp.arrays import FloatArray
from grasp.learning.calibration import ScoreMap, band_margin, fit_map
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.scoring.promises import FactoryMap, chance_spread
from simulate.study.quality.made_hands import studied_hand

__all__ = ["FittedPromises", "TriedGrasp", "fit_promises", "tried_grasps"]

_ROUNDS, _RIDGE = 30, 1e-3
_START = FactoryMap(0.5, 0.8, 0.6, -0.5, 0.0, 0.7)
_SURE, _COVERAGE = 0.02, 0.9


@dataclass(frozen=True)
class TriedGrasp:
    """One grasp with its score, the load that it bore, and how many of its trials held."""

    hand: ParallelGripper
    score: float
    load: float
    taper: float | None
    held: int
    trials: int
    is_pick: bool

    def chance_by(self, factory: FactoryMap) -> float:
        """Return the chance that a map makes of it."""
        return factory.chance(self.score, self.load, self.hand.max_opening, self.taper)


@dataclass(frozen=True)
class FittedPromises:
    """The factory's map, and the standard deviations of hands' own offsets and slopes about it.

    Parameters
    ----------
    likeness
        Correlation of the outcomes of one grasp, given its chance.
    """

    factory: FactoryMap
    offset_std: float
    slope_std: float
    likeness: float
    grasps: int
    hands: int

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as JSON data, rounded."""
        numbers = {**asdict(self.factory), **{k: v for k, v in asdict(self).items()
                                              if k != "factory"}}  # fmt: skip
        return {k: round(float(v), 4) for k, v in numbers.items()}


def tried_grasps(
    results: Sequence[Mapping[str, Any]], outcome: str, score: str
) -> list[TriedGrasp]:
    """Return the picks and the other grasps of results whose scores are known.

    Parameters
    ----------
    outcome, score
        ``held`` with ``lift``, or ``carried`` with ``carry``.
    """
    grasps = []
    for result in results:
        picked = result["rules"].get("planned")
        entries = [] if picked is None else [(picked["promised"], picked, True)]
        entries += [(entry, entry, False) for entry in result.get("ranked", ())]
        for scores, tried, is_pick in entries:
            if score in scores and "load" in scores:
                held = [bool(h) for h in tried[outcome]]
                hand, at = studied_hand(result["hand"]), float(scores[score])
                load = float(scores["load"])
                taper = scores.get("taper")
                grasps.append(TriedGrasp(hand, at, load, taper, sum(held), len(held), is_pick))
    return grasps


def fit_promises(grasps: Sequence[TriedGrasp]) -> FittedPromises:
    """Fit the factory's map and the differences of hands; at least nine picks are wanted.

    Raises
    ------
    ValueError
        There are too few grasps.
    """
    if sum(g.is_pick for g in grasps) < 9:
        raise ValueError("expected at least nine picks with scores and loads")
    names = sorted({g.hand.name for g in grasps})
    factory, likeness = _START, 0.0
    own = {name: ScoreMap(0.0, 1.0, (0.25, 0.04)) for name in names}
    stds = np.array([0.5, 0.2])
    for _ in range(_ROUNDS):
        factory = _fit_factory(factory, grasps, own, likeness)
        prior = ScoreMap(0.0, 1.0, (float(stds[0] ** 2), float(stds[1] ** 2)))
        own = {name: _own_map(factory, [g for g in grasps if g.hand.name == name], prior, likeness)
               for name in names}  # fmt: skip
        moments = np.array([
            [m.offset**2 + m.variances[0], (m.slope - 1) ** 2 + m.variances[1]]
            for m in own.values()
        ])  # fmt: skip
        stds = np.sqrt(np.maximum(moments.mean(axis=0), 1e-4))
        likeness = _likeness(factory, grasps, own)
    return FittedPromises(
        replace(factory, shortfall=_shortfall(factory, grasps)),
        float(stds[0]), float(stds[1]), likeness, len(grasps), len(names),
    )  # fmt: skip


def _weight(trials: int, likeness: float) -> float:
    """Return what one of several alike outcomes counts."""
    return 1.0 / (1.0 + (trials - 1) * likeness)


def _fit_factory(
    factory: FactoryMap, grasps: Sequence[TriedGrasp], own: Mapping[str, ScoreMap], likeness: float
) -> FactoryMap:
    basis = np.array([
        FactoryMap.terms(g.score, g.load, g.hand.max_opening, g.taper) for g in grasps
    ])  # fmt: skip
    offset = np.array([own[g.hand.name].offset for g in grasps])
    slope = np.array([own[g.hand.name].slope for g in grasps])
    held, trials = np.array([(g.held, g.trials) for g in grasps], dtype=np.float64).T
    weight = np.array([_weight(g.trials, likeness) for g in grasps])

    def loss(numbers: FloatArray) -> tuple[float, FloatArray]:
        odds = offset + slope * (basis @ numbers)
        p = 1 / (1 + np.exp(-odds))
        logs = held * np.log(np.maximum(p, 1e-12)) + (trials - held) * np.log(
            np.maximum(1 - p, 1e-12)
        )
        gradient = basis.T @ (weight * slope * (trials * p - held))
        return (
            float(-(weight * logs).sum() + _RIDGE * numbers @ numbers),
            gradient + 2 * _RIDGE * numbers,
        )

    free = (None, None)
    bounds = [free, (0, None), (0, None), (None, 0), free, (None, 0)]
    best = minimize(loss, np.array(factory.numbers), jac=True, method="L-BFGS-B", bounds=bounds).x
    numbers = [float(number) for number in best]
    names = ("offset", "above", "below", "load", "stroke", "taper")
    return replace(factory, **dict(zip(names, numbers, strict=True)))


def _own_map(
    factory: FactoryMap, grasps: Sequence[TriedGrasp], prior: ScoreMap, likeness: float
) -> ScoreMap:
    outcomes, weights = [], []
    for g in grasps:
        chance = g.chance_by(factory)
        for held, count in ((True, g.held), (False, g.trials - g.held)):
            outcomes.append((chance, held))
            weights.append(count * _weight(g.trials, likeness))
    return fit_map(outcomes, prior, weights)


def _likeness(
    factory: FactoryMap, grasps: Sequence[TriedGrasp], own: Mapping[str, ScoreMap]
) -> float:
    """Return the correlation of outcomes of one grasp, by moments."""
    over, pairs = 0.0, 0.0
    for g in grasps:
        p = own[g.hand.name].chance(g.chance_by(factory))
        spread = p * (1 - p)
        if g.trials > 1 and spread > _SURE:
            over += (g.held - g.trials * p) ** 2 - g.trials * spread
            pairs += g.trials * (g.trials - 1) * spread
    return float(np.clip(over / pairs, 0.0, 0.9)) if pairs else 0.0


def _shortfall(factory: FactoryMap, grasps: Sequence[TriedGrasp]) -> float:
    """Return how many spreads nine of ten picks stay at most below their chance."""
    picks = [g for g in grasps if g.is_pick]
    chances = np.array([g.chance_by(factory) for g in picks])
    shares = np.array([g.held / g.trials for g in picks])
    spread = np.array([chance_spread(float(chance)) for chance in chances])
    return band_margin((chances - shares) / spread, np.zeros(len(picks)), _COVERAGE)
