"""Chances that a grasp holds, promised from its scores: by the factory, then by a hand's outcomes.

What is promised has to hold in the lowest quarter, too, on objects unlike those of the fit, and by
a hand that nobody tried: the factory's maps were fitted over many generated hands and many kinds of
generated objects at once, heavy ones and poor grasps included. They say how likely a grasp lifts
an object, and how likely it carries one that it lifted. How much the hands differed is the prior of
a hand's own map: its outcomes move it from the factory's
(:func:`grasp.learning.calibration.fit_map`), the more the more there are, and with it everything
that is promised. Two hands that were tried more often have maps of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from grasp.learning.calibration import ScoreMap, fit_map
from grasp.spatial.gripper import ParallelGripper

__all__ = [
    "FACTORY",
    "RESTS_ON",
    "TRIED",
    "UNTRIED",
    "FactoryMap",
    "Outcome",
    "Promises",
    "chance_spread",
    "factory_chance",
]

_LOWEST, _HIGHEST = 0.001, 0.98
_USUAL_LOAD = 0.224
"""Weight over what friction bears, where it is not known: the middle of 10 to 50 %."""
_LIGHTEST = 0.01
"""Of what the maps were fitted on; lighter things count as that."""
_HEAVY = {"lift": 0.4, "carry": 0.15}
"""From where weight is felt beyond what the score makes of it."""
_STROKE_M, _STROKES_M = 0.08, (0.04, 0.14)
"""Stroke that the maps refer to, and strokes that they were fitted on; others count as those."""
_USUAL = {"patch": 0.1, "taper": 0.12, "lever": 0.08}
"""What evaluations that do not tell how the pads meet the object count as; the lever in strokes."""
_LEAST, _STEEPEST = 0.02, 1.5
_FLOOR = 0.02
"""Of the variance, so that a chance of 1 is no certainty."""

RESTS_ON = ("lift", "carry", "load", "patch", "taper", "lever")
"""Names of the scores of a grasp that promises rest on; see
:func:`grasp.spatial.scoring.holding.with_holding`."""

Outcome = tuple[Mapping[str, float], Mapping[str, bool]]
"""Scores of a grasp that was carried out, and whether it held: ``lift``, ``carry`` or both."""


@dataclass(frozen=True)
class FactoryMap:
    """Log odds that a grasp lifts an object, or that it carries one which it lifted.

    A broken line in the logit of the grasp's score, and what the score misses: it takes pads for
    stiffer, and light objects for surer, than they are.

    Parameters
    ----------
    offset
        At a score of .5 and usual values of all else.
    above, below
        Slopes where the score is above .5, and below; never negative.
    heavy, light
        Changes with the logarithm of the weight over 40 % of what friction bears for lifting, over
        15 % for carrying: above, and below.
    stroke
        Change with the logarithm of a hand's stroke over 80 mm: the same errors of the pose weigh
        more on a small hand.
    patch, lever
        Changes with the logarithms of how much of a pad meets the object, and of the distance to
        the centre of mass in strokes.
    taper
        Change with how much of the friction the pads use up by leaning.
    shortfall
        How many times ``sqrt(p (1 - p) + .02)`` nine of ten objects stay at most below a chance p.
    """

    offset: float
    above: float
    below: float
    heavy: float
    light: float
    stroke: float
    patch: float
    taper: float
    lever: float
    shortfall: float

    @staticmethod
    def terms(name: str, scores: Mapping[str, float], stroke: float) -> tuple[float, ...]:
        """Return what the numbers before the shortfall are multiplied by in the log odds.

        Parameters
        ----------
        name
            ``lift`` or ``carry``.
        scores
            Of a grasp; those of :data:`RESTS_ON` that are missing count as usual.
        stroke
            Of the hand, m.
        """
        score = scores[name] if name in scores else scores["carry"]
        inside = min(max(float(score), _LOWEST), _HIGHEST)
        x = float(np.log(inside / (1 - inside)))
        weight = float(np.log(max(scores.get("load", _USUAL_LOAD), _LIGHTEST) / _HEAVY[name]))
        size = min(max(stroke, _STROKES_M[0]), _STROKES_M[1]) / _STROKE_M
        patch = scores.get("patch", _USUAL["patch"])
        taper = min(scores.get("taper", _USUAL["taper"]), _STEEPEST) - _USUAL["taper"]
        lever = scores["lever"] / stroke if "lever" in scores else _USUAL["lever"]
        return (
            1.0, max(x, 0.0), min(x, 0.0), max(weight, 0.0), min(weight, 0.0),
            float(np.log(size)), _log_over(patch, "patch"), taper, _log_over(lever, "lever"),
        )  # fmt: skip

    @property
    def numbers(self) -> tuple[float, ...]:
        """All but the shortfall, in the order of :meth:`terms`."""
        return tuple(getattr(self, f.name) for f in fields(self) if f.name != "shortfall")

    def odds(self, name: str, scores: Mapping[str, float], stroke: float) -> float:
        """Return the log odds of a grasp with these scores."""
        return float(np.dot(self.numbers, self.terms(name, scores, stroke)))

    def at_least(self, chance: float) -> float:
        """Return the share of trials in which nine of ten objects with a chance hold at least."""
        return max(chance - self.shortfall * chance_spread(chance), 0.0)


def chance_spread(chance: float) -> float:
    """Return the spread, sqrt(p (1 - p) + .02), in which shortfalls of a chance are measured."""
    return float(np.sqrt(chance * (1 - chance) + _FLOOR))


def factory_chance(
    maps: Mapping[str, FactoryMap], name: str, scores: Mapping[str, float], stroke: float
) -> float:
    """Return the chance that a grasp lifts an object or, by ``carry``, that it carries it as well.

    What is not lifted is not carried: that chance is one of both, and never the larger.
    """
    chance = _logistic(maps["lift"].odds("lift", scores, stroke))
    if name == "carry":
        chance *= _logistic(maps["carry"].odds("carry", scores, stroke))
    return chance


def _log_over(value: float, name: str) -> float:
    return float(np.log((value + _LEAST) / (_USUAL[name] + _LEAST)))


def _logistic(odds: float) -> float:
    return float(1 / (1 + np.exp(-odds)))


FACTORY: Mapping[str, FactoryMap] = {
    "lift": FactoryMap(2.167, 0.650, 0.357, -1.325, 0.0, 0.687, 1.290, -1.252, -0.112, 0.768),
    "carry": FactoryMap(4.052, 0.142, 0.385, -2.549, 0.0, 1.329, 1.602, -0.338, -0.320, 0.684),
}  # fmt: skip
"""From 3,753 grasps of 2,854 generated objects by 24 generated hands and the two below, the first
of each plan three or four times, some others of a plan once: ten neat families with 5 to 90 % of
the weight that friction bears, and eleven kinds of a wider family (``rtask study grasp-quality``,
with ``--made 24`` and with ``--varied``)."""

TRIED: Mapping[str, Mapping[str, FactoryMap]] = {
    "panda_hand": {
        "lift": FactoryMap(2.013, 0.663, 0.364, -1.350, 0.0, 0.701, 1.315, -1.276, -0.114, 0.768),
        "carry": FactoryMap(4.460, 0.162, 0.439, -2.912, 0.0, 1.518, 1.830, -0.386, -0.366, 0.684),
    },
    "nao_hand": {
        "lift": FactoryMap(2.348, 0.678, 0.372, -1.382, 0.0, 0.717, 1.346, -1.306, -0.117, 0.768),
        "carry": FactoryMap(5.535, 0.187, 0.507, -3.364, 0.0, 1.754, 2.114, -0.446, -0.423, 0.684),
    },
}  # fmt: skip
"""Maps of hands by type: the factory's, with the own offset and slope that the same fit found for
hands that were tried on some thousand objects each."""

UNTRIED: Mapping[str, ScoreMap] = {
    "lift": ScoreMap(0.0, 1.0, (0.24**2, 0.12**2)),
    "carry": ScoreMap(0.0, 1.0, (0.54**2, 0.24**2)),
}
"""The own maps of a hand without outcomes, in the logit of the factory's chance. Deviations are one
and a half times those of the 26 hands, and not below those of an earlier fit, as real ones differ
in what is the same there: the stuff of their pads, how stiff they are, how they are driven."""

_OF_TRIED = ScoreMap(0.0, 1.0, (0.5**2, 0.3**2))
"""The same of hands of a type that was tried; 50 outcomes were shown to do no harm with it."""


@dataclass(frozen=True)
class Promises:
    """What is promised of grasps by one hand.

    Parameters
    ----------
    stroke
        Of the hand, m.
    hand
        Its type, which may be one of :data:`TRIED`.
    own
        Maps from the factory's chances, by name of the score; none = :data:`UNTRIED`.

    Examples
    --------
    >>> before = Promises()
    >>> scores = {"lift": 0.9, "carry": 0.6, "load": 0.3}
    >>> after = before.after([(scores, {"lift": False, "carry": False})] * 20)
    >>> [after.of(scores)[k] < before.of(scores)[k] for k in ("lift_chance", "carry_at_least")]
    [True, True]
    """

    stroke: float = _STROKE_M
    hand: str = ""
    own: Mapping[str, ScoreMap] = field(default_factory=dict)

    @classmethod
    def by(cls, gripper: ParallelGripper) -> Promises:
        """Return the promises of a gripper without own outcomes."""
        return cls(gripper.max_opening, gripper.gripper_type)

    @property
    def maps(self) -> Mapping[str, FactoryMap]:
        """The factory's maps for this hand, by name of the score."""
        return TRIED.get(self.hand, FACTORY)

    @property
    def outcomes(self) -> int:
        """From how many outcomes they grew, of the score that has more."""
        return max((score_map.outcomes for score_map in self.own.values()), default=0)

    def of(self, scores: Mapping[str, float]) -> dict[str, float]:
        """Return ``lift_chance``, ``lift_at_least`` and those of ``carry``, from a grasp's scores.

        Parameters
        ----------
        scores
            With ``lift`` and ``carry``, and with ``load``, weight over what friction bears, where
            it is known.
        """
        promised: dict[str, float] = {}
        for name, factory in self.maps.items():
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
        prior = dict.fromkeys(FACTORY, _OF_TRIED) if self.hand in TRIED else UNTRIED
        own = {name: fit_map(rows, prior[name]) for name, rows in scored.items() if rows}
        return Promises(self.stroke, self.hand, own)

    def _factory_chance(self, name: str, scores: Mapping[str, float]) -> float:
        return factory_chance(self.maps, name, scores, self.stroke)
