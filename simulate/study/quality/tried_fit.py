"""Fit of the promises of hands that are tried often, each with an offset of its own.

Slopes, the weight of leaning pads and the share of lapses are common to the hands. The prior is
what 676 earlier grasps gave, loosened: they had few light things, and no term for pads that lean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from grasp.arrays import FloatArray
from grasp.learning.calibration import band_margin
from grasp.spatial.scoring.promises import FactoryMap, chance_spread
from simulate.study.quality.objects import FAMILIES
from simulate.study.quality.promise_fit import TriedGrasp, tried_grasps

__all__ = ["fit_tried", "is_generated"]

_EARLIER: Mapping[str, FactoryMap] = {
    "lift": FactoryMap(1.56, 0.95, 0.40, 0.0, 0.0, 0.7),
    "carry": FactoryMap(0.52, 0.576, 0.616, -1.078, 0.0, 0.7),
}
_LOOSE = np.array([0.6, 0.3, 0.2, 0.4, 2.0, 1.0])
"""Standard deviations of offsets, both slopes, and weights of load, taper and lapses."""
_LIKENESS = 0.4
"""Correlation of the outcomes of one grasp: four of them count as two."""
_MOST_LAPSES, _COVERAGE = 0.1, 0.9


def is_generated(result: Mapping[str, Any]) -> bool:
    """Tell whether the object of a result is a generated one, on which alone maps are fitted."""
    family, _, number = str(result["object"]).partition("-")
    return family in FAMILIES and number.isdigit()


def fit_tried(
    results: Sequence[Mapping[str, Any]], outcome: str, score: str
) -> dict[str, FactoryMap]:
    """Return the map of each hand, from its picks on generated objects.

    Parameters
    ----------
    outcome, score
        ``held`` with ``lift``, or ``carried`` with ``carry``.

    Raises
    ------
    ValueError
        There are fewer than nine picks.
    """
    generated = [result for result in results if is_generated(result)]
    grasps = [g for g in tried_grasps(generated, outcome, score) if g.is_pick]
    names = sorted({g.hand.gripper_type for g in grasps})
    numbers = _most_probable(grasps, names, _EARLIER[score])
    maps = {name: _map_of(numbers, k, len(names)) for k, name in enumerate(names)}
    chances = np.array([g.chance_by(maps[g.hand.gripper_type]) for g in grasps])
    shares = np.array([g.held / g.trials for g in grasps])
    spread = np.array([chance_spread(float(chance)) for chance in chances])
    shortfall = band_margin((chances - shares) / spread, np.zeros(len(grasps)), _COVERAGE)
    return {name: replace(made, shortfall=shortfall) for name, made in maps.items()}


def _most_probable(
    grasps: Sequence[TriedGrasp], names: Sequence[str], earlier: FactoryMap
) -> FloatArray:
    """Return an offset for each hand, both slopes, weights of load and taper, and lapses."""
    terms = np.array([FactoryMap.terms(g.score, g.load, 0.08, g.taper) for g in grasps])
    hand = np.array([[g.hand.gripper_type == name for name in names] for g in grasps])
    basis = np.concatenate([hand, terms[:, [1, 2, 3, 5]]], axis=1)
    held, trials = np.array([(g.held, g.trials) for g in grasps], dtype=np.float64).T
    counts = 1 / (1 + (trials - 1) * _LIKENESS)
    start = np.array([
        *[earlier.offset] * len(names), earlier.above, earlier.below, earlier.load, 0.0, 0.0,
    ])  # fmt: skip
    loose = np.concatenate([np.full(len(names), _LOOSE[0]), _LOOSE[1:]])

    def loss(numbers: FloatArray) -> float:
        p = (1 - numbers[-1]) / (1 + np.exp(-(basis @ numbers[:-1])))
        p = np.clip(p, 1e-9, 1 - 1e-9)
        logs = held * np.log(p) + (trials - held) * np.log(1 - p)
        return float(-(counts * logs).sum() + 0.5 * (((numbers - start) / loose) ** 2).sum())

    # More friction used up, or more weight, never makes a grasp better; lifting asks for neither.
    down = (0.0, 0.0) if earlier.load == 0 else (None, 0.0)
    bounds = [*[(None, None)] * len(names), (0, None), (0, None), down, down, (0, _MOST_LAPSES)]
    return np.asarray(minimize(loss, start, method="L-BFGS-B", bounds=bounds).x)


def _map_of(numbers: FloatArray, hand: int, hands: int) -> FactoryMap:
    above, below, load, taper, lapse = (round(float(v), 3) for v in numbers[hands:])
    offset = round(float(numbers[hand]), 3)
    return FactoryMap(offset, above, below, load, 0.0, 0.0, taper, lapse)
