"""Fit of what the factory promises, over many hands, and of how much hands differ from it.

A hierarchical model: the maps of :class:`grasp.spatial.scoring.promises.FactoryMap` are those of
hands at large, and each hand has an offset and a slope of its own in the log odds, drawn from
normal distributions about 0 and 1. Both are fitted in turn by an EM algorithm with Laplace's
approximation, the outcomes of one grasp counting less the more alike they are. Whether an object is
lifted is fitted first, then whether it is carried where it was lifted, then how much hands differ
in both together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from grasp.arrays import FloatArray
from grasp.learning.calibration import ScoreMap, band_margin, fit_map
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.scoring.promises import RESTS_ON, FactoryMap, chance_spread, factory_chance
from simulate.study.quality.made_hands import studied_hand

__all__ = ["FittedPromises", "TriedGrasp", "fit_promises", "tried_grasps"]

_ROUNDS, _RIDGE, _FEWEST = 30, 0.3, 9
_START = FactoryMap(0.5, 0.8, 0.6, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7)
_SURE, _COVERAGE = 0.02, 0.9
_SPREAD = ScoreMap(0.0, 1.0, (0.25, 0.04))


@dataclass(frozen=True, eq=False)
class TriedGrasp:
    """One grasp with its scores, and how many of its trials lifted and carried."""

    hand: ParallelGripper
    scores: Mapping[str, float]
    lifted: int
    carried: int
    trials: int
    is_pick: bool


@dataclass(frozen=True)
class FittedPromises:
    """The factory's map of lifting or carrying, and how much hands differ from what it promises.

    Parameters
    ----------
    factory
        Of hands at large.
    by_hand
        The same with the own offset and slope of each type of hand.
    offset_std, slope_std
        Of hands' own maps in the logit of the whole chance.
    likeness
        Correlation of the outcomes of one grasp, given its chance.
    """

    factory: FactoryMap
    by_hand: Mapping[str, FactoryMap]
    offset_std: float
    slope_std: float
    likeness: float
    grasps: int

    def to_json(self) -> dict[str, Any]:
        """Return the numbers of hands at large as JSON data, rounded."""
        numbers = {
            **asdict(self.factory), "offset_std": self.offset_std, "slope_std": self.slope_std,
            "likeness": self.likeness, "grasps": self.grasps, "hands": len(self.by_hand),
        }  # fmt: skip
        return {k: round(float(v), 4) for k, v in numbers.items()}


@dataclass(frozen=True, eq=False)
class _Trials:
    """Outcomes to fit one map on: (n, t) terms, and of each grasp how many of its trials held."""

    hands: tuple[str, ...]
    basis: FloatArray
    held: FloatArray
    trials: FloatArray

    @classmethod
    def of(cls, grasps: Sequence[TriedGrasp], name: str) -> _Trials:
        rows = [(g, g.trials if name == "lift" else g.lifted) for g in grasps]
        rows = [(g, trials) for g, trials in rows if trials]
        terms = [FactoryMap.terms(name, g.scores, g.hand.max_opening) for g, _ in rows]
        held = [g.lifted if name == "lift" else g.carried for g, _ in rows]
        return cls(
            tuple(g.hand.gripper_type for g, _ in rows), np.array(terms),
            np.array(held, dtype=np.float64), np.array([t for _, t in rows], dtype=np.float64),
        )  # fmt: skip

    def weights(self, likeness: float) -> FloatArray:
        """Return what each of several alike outcomes counts (n,)."""
        return np.asarray(1.0 / (1.0 + (self.trials - 1) * likeness))


def tried_grasps(results: Sequence[Mapping[str, Any]]) -> list[TriedGrasp]:
    """Return the picks and the other grasps of results whose scores are known."""
    grasps = []
    for result in results:
        picked = result["rules"].get("planned")
        entries = [] if picked is None else [(picked["promised"], picked, True)]
        entries += [(entry, entry, False) for entry in result.get("ranked", ())]
        for scores, tried, is_pick in entries:
            if all(name in scores for name in RESTS_ON):
                shares = {name: float(scores[name]) for name in RESTS_ON}
                lifted, carried = sum(tried["held"]), sum(tried["carried"])
                hand = studied_hand(result["hand"])
                trials = len(tried["held"])
                grasps.append(TriedGrasp(hand, shares, lifted, carried, trials, is_pick))
    return grasps


def fit_promises(grasps: Sequence[TriedGrasp]) -> dict[str, FittedPromises]:
    """Fit the factory's maps of ``lift`` and ``carry``; at least nine picks are wanted.

    Raises
    ------
    ValueError
        There are too few grasps, or too few that lifted.
    """
    if sum(g.is_pick and g.lifted > 0 for g in grasps) < _FEWEST:
        raise ValueError("expected at least nine picks with scores that lifted")
    maps: dict[str, FactoryMap] = {}
    fitted: dict[str, FittedPromises] = {}
    for name in ("lift", "carry"):
        rows = _Trials.of(grasps, name)
        factory, own, likeness = _fit(rows)
        maps[name] = factory
        by_hand = {hand: _moved(factory, own[hand]) for hand in own}
        whole, stds = _whole(grasps, maps, name, likeness)
        factory = replace(factory, shortfall=_shortfall(grasps, whole, name))
        by_hand = {
            hand: replace(theirs, shortfall=factory.shortfall) for hand, theirs in by_hand.items()
        }
        fitted[name] = FittedPromises(factory, by_hand, *stds, likeness, len(grasps))
    return fitted


def _moved(factory: FactoryMap, own: ScoreMap) -> FactoryMap:
    """Return a map whose log odds are offset and stretched by those of a hand."""
    numbers = own.slope * np.array(factory.numbers)
    numbers[0] += own.offset
    return _with_numbers(factory, numbers)


def _with_numbers(factory: FactoryMap, numbers: FloatArray) -> FactoryMap:
    names = [f.name for f in fields(factory) if f.name != "shortfall"]
    return replace(factory, **dict(zip(names, map(float, numbers), strict=True)))


def _fit(rows: _Trials) -> tuple[FactoryMap, dict[str, ScoreMap], float]:
    """Return hands' common map, their own maps, and the likeness of outcomes of one grasp."""
    factory, likeness, stds = _START, 0.0, np.array([0.5, 0.2])
    own = dict.fromkeys(sorted(set(rows.hands)), _SPREAD)
    for _ in range(_ROUNDS):
        factory = _fit_factory(factory, rows, own, likeness)
        chances = _logistic(rows.basis @ np.array(factory.numbers))
        own, stds = _fit_own(rows, chances, stds, likeness)
        likeness = _likeness(rows, chances, own)
    return factory, own, likeness


def _logistic(odds: FloatArray) -> FloatArray:
    return np.asarray(1 / (1 + np.exp(-odds)))


def _fit_factory(
    factory: FactoryMap, rows: _Trials, own: Mapping[str, ScoreMap], likeness: float
) -> FactoryMap:
    basis, held, trials = rows.basis, rows.held, rows.trials
    offset = np.array([own[hand].offset for hand in rows.hands])
    slope = np.array([own[hand].slope for hand in rows.hands])
    weight = rows.weights(likeness)

    def loss(numbers: FloatArray) -> tuple[float, FloatArray]:
        odds = offset + slope * (basis @ numbers)
        logs = trials * np.logaddexp(0, odds) - held * odds
        gradient = basis.T @ (weight * slope * (trials * _logistic(odds) - held))
        return (
            float((weight * logs).sum() + _RIDGE * numbers @ numbers),
            gradient + 2 * _RIDGE * numbers,
        )

    free = (None, None)
    # Less weight, a larger patch, less lean and a shorter lever never make a grasp worse.
    up, down = (0, None), (None, 0)
    bounds = [free, up, up, down, down, free, up, down, down]
    best = minimize(loss, np.array(factory.numbers), jac=True, method="L-BFGS-B", bounds=bounds)
    return _with_numbers(factory, best.x)


def _fit_own(
    rows: _Trials, chances: FloatArray, stds: FloatArray, likeness: float
) -> tuple[dict[str, ScoreMap], FloatArray]:
    """Return hands' own maps from the common chances, and their deviations, one step further."""
    prior = ScoreMap(0.0, 1.0, (float(stds[0] ** 2), float(stds[1] ** 2)))
    weights, hands = rows.weights(likeness), np.array(rows.hands)
    own = {}
    for hand in sorted(set(rows.hands)):
        mine = np.flatnonzero(hands == hand)
        outcomes, counts = [], []
        for k in mine:
            for held, count in ((True, rows.held[k]), (False, rows.trials[k] - rows.held[k])):
                outcomes.append((float(chances[k]), held))
                counts.append(float(count * weights[k]))
        own[str(hand)] = fit_map(outcomes, prior, counts)
    moments = np.array([
        [m.offset**2 + m.variances[0], (m.slope - 1) ** 2 + m.variances[1]] for m in own.values()
    ])  # fmt: skip
    return own, np.sqrt(np.maximum(moments.mean(axis=0), 1e-4))


def _likeness(rows: _Trials, chances: FloatArray, own: Mapping[str, ScoreMap]) -> float:
    """Return the correlation of outcomes of one grasp, by moments."""
    p = np.array([
        own[hand].chance(float(chance)) for hand, chance in zip(rows.hands, chances, strict=True)
    ])  # fmt: skip
    spread = p * (1 - p)
    unsure = (rows.trials > 1) & (spread > _SURE)
    n, spread = rows.trials[unsure], spread[unsure]
    over = ((rows.held[unsure] - n * p[unsure]) ** 2 - n * spread).sum()
    pairs = (n * (n - 1) * spread).sum()
    return float(np.clip(over / pairs, 0.0, 0.9)) if pairs else 0.0


def _whole(
    grasps: Sequence[TriedGrasp], maps: Mapping[str, FactoryMap], name: str, likeness: float
) -> tuple[FloatArray, tuple[float, float]]:
    """Return the whole chances (n,) by hands' common maps, and how much hands differ from them."""
    chances = np.array([factory_chance(maps, name, g.scores, g.hand.max_opening) for g in grasps])
    held = [g.lifted if name == "lift" else g.carried for g in grasps]
    rows = _Trials(
        tuple(g.hand.gripper_type for g in grasps), np.zeros((len(grasps), 0)),
        np.array(held, dtype=np.float64), np.array([g.trials for g in grasps], dtype=np.float64),
    )  # fmt: skip
    stds = np.array([0.5, 0.2])
    for _ in range(_ROUNDS):
        _, stds = _fit_own(rows, chances, stds, likeness)
    return chances, (float(stds[0]), float(stds[1]))


def _shortfall(grasps: Sequence[TriedGrasp], chances: FloatArray, name: str) -> float:
    """Return how many spreads nine of ten picks stay at most below their chance."""
    picks = [(g, float(chance)) for g, chance in zip(grasps, chances, strict=True) if g.is_pick]
    shares = np.array([(g.lifted if name == "lift" else g.carried) / g.trials for g, _ in picks])
    spread = np.array([chance_spread(chance) for _, chance in picks])
    over = np.array([chance for _, chance in picks]) - shares
    return band_margin(over / spread, np.zeros(len(picks)), _COVERAGE)
