"""Chances that a grasp holds, promised from its scores: by the factory, then by a hand's outcomes.

The factory's map was fitted on the first grasps of generated objects and models, heavy ones and
poor grasps included, by hand: what is promised has to hold in the lowest quarter, too. A hand's own
outcomes move the map from there (:func:`grasp.learning.calibration.fit_map`), the more the more
there are, and with it everything that is promised.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from grasp.learning.calibration import ScoreMap, fit_map
from grasp.spatial.gripper import ParallelGripper

__all__ = ["FACTORY", "UNTRIED", "FactoryMap", "Outcome", "Promises", "chance_spread"]

_LOWEST, _HIGHEST = 0.001, 0.98
_USUAL_LOAD = 0.224
"""Weight over what friction bears, where it is not known: the middle of 10 to 50 %."""
_LIGHTEST = 0.05
"""Of what the maps were fitted on; lighter things count as that."""
_FLOOR = 0.02
"""Of the variance, so that a chance of 1 is no certainty."""

Outcome = tuple[Mapping[str, float], Mapping[str, bool]]
"""Scores of a grasp that was carried out, and whether it held: ``lift``, ``carry`` or both."""


@dataclass(frozen=True)
class FactoryMap:
    """Log odds that a grasp holds, a broken line in the logit of its score.

    Parameters
    ----------
    offset
        At a score of .5, the weight being what friction bears.
    above, below
        Slopes where the score is above .5, and below.
    load
        Change with the logarithm of the weight over what friction bears; at most 0.
    hands
        Offsets of hands that were tried, by type. Those of others differ as much.
    shortfall
        How many times ``sqrt(p (1 - p) + .02)`` nine of ten objects stay at most below a chance p.
    """

    offset: float
    above: float
    below: float
    load: float
    hands: Mapping[str, float]
    shortfall: float

    def chance(self, score: float, load: float | None = None, hand: str = "") -> float:
        """Return the chance of a score under a load, weight over what friction bears."""
        inside = min(max(float(score), _LOWEST), _HIGHEST)
        x = float(np.log(inside / (1 - inside)))
        share = max(_USUAL_LOAD if load is None else load, _LIGHTEST)
        odds = self.offset + (self.above if x > 0 else self.below) * x
        odds += self.load * float(np.log(share)) + self.hands.get(hand, 0.0)
        return float(1 / (1 + np.exp(-odds)))

    def at_least(self, chance: float) -> float:
        """Return the share of trials in which nine of ten objects with a chance hold at least."""
        return max(chance - self.shortfall * chance_spread(chance), 0.0)


def chance_spread(chance: float) -> float:
    """Return the spread, sqrt(p (1 - p) + .02), in which shortfalls of a chance are measured."""
    return float(np.sqrt(chance * (1 - chance) + _FLOOR))


FACTORY: Mapping[str, FactoryMap] = {
    "lift": FactoryMap(
        1.56, 0.95, 0.40, 0.0, {"panda_hand": 0.15, "nao_hand": -0.15}, 0.69
    ),
    "carry": FactoryMap(
        0.515, 0.576, 0.616, -1.078, {"panda_hand": 0.17, "nao_hand": -0.17}, 0.70
    ),
}  # fmt: skip
"""From 676 first grasps, half of them by each hand, carried out four times each: generated objects,
a third of them with 5 to 90 % of the weight that friction bears, and every second YCB model."""

UNTRIED = ScoreMap(0.0, 1.0, (0.5**2, 0.3**2))
"""The own map of a hand without outcomes, in the logit of the factory's chance: how much hands
differ from what the factory promises of them."""


@dataclass(frozen=True)
class Promises:
    """What is promised of grasps by one hand.

    Parameters
    ----------
    hand
        Type of the hand.
    own
        Maps from the factory's chances, by name of the score; none = :data:`UNTRIED`.

    Examples
    --------
    >>> before = Promises("panda_hand")
    >>> scores = {"lift": 0.9, "carry": 0.6, "load": 0.3}
    >>> after = before.after([(scores, {"lift": False, "carry": False})] * 20)
    >>> [after.of(scores)[k] < before.of(scores)[k] for k in ("lift_chance", "carry_at_least")]
    [True, True]
    """

    hand: str = ""
    own: Mapping[str, ScoreMap] = field(default_factory=dict)

    @classmethod
    def by(cls, gripper: ParallelGripper) -> Promises:
        """Return the promises of a gripper without own outcomes."""
        return cls(gripper.gripper_type)

    def of(self, scores: Mapping[str, float]) -> dict[str, float]:
        """Return ``lift_chance``, ``lift_at_least`` and those of ``carry``, from a grasp's scores.

        Parameters
        ----------
        scores
            With ``lift`` and ``carry``, and with ``load``, weight over what friction bears, where
            it is known.
        """
        promised: dict[str, float] = {}
        for name, factory in FACTORY.items():
            if name in scores:
                chance = self._factory_chance(name, scores)
                if name in self.own:
                    chance = self.own[name].chance(chance)
                promised[f"{name}_chance"] = chance
                promised[f"{name}_at_least"] = factory.at_least(chance)
        return promised

    def after(self, outcomes: Iterable[Outcome]) -> Promises:
        """Return the promises that all outcomes of the hand teach, which may come in any order.

        Outcomes that these promises grew from already do not count again: give all of them.
        """
        scored: dict[str, list[tuple[float, bool]]] = {name: [] for name in FACTORY}
        for scores, held in outcomes:
            for name in FACTORY:
                if name in held and name in scores:
                    scored[name].append((self._factory_chance(name, scores), bool(held[name])))
        own = {name: fit_map(rows, UNTRIED) for name, rows in scored.items() if rows}
        return Promises(self.hand, own)

    def _factory_chance(self, name: str, scores: Mapping[str, float]) -> float:
        return FACTORY[name].chance(scores[name], scores.get("load"), self.hand)
