"""Chances that a grasp holds, promised from its scores: by the factory, then by a hand's outcomes.

What is promised has to hold in the lowest quarter, too, and by a hand that nobody tried: the
factory's maps were fitted over many generated hands at once, heavy objects and poor grasps
included. How much those hands differed is the prior of a hand's own map: its outcomes move it from
the factory's (:func:`grasp.learning.calibration.fit_map`), the more the more there are, and with it
everything that is promised. Two hands that were tried more often have maps of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from grasp.learning.calibration import ScoreMap, fit_map
from grasp.spatial.gripper import ParallelGripper

__all__ = [
    "FACTORY",
    "TRIED",
    "UNTRIED",
    "FactoryMap",
    "Outcome",
    "Promises",
    "chance_spread",
]

_LOWEST, _HIGHEST = 0.001, 0.98
_USUAL_LOAD = 0.224
"""Weight over what friction bears, where it is not known: the middle of 10 to 50 %."""
_LIGHTEST = 0.05
"""Of what the maps were fitted on; lighter things count as that."""
_STROKE_M, _STROKES_M = 0.08, (0.04, 0.14)
"""Stroke that the maps refer to, and strokes that they were fitted on; others count as those."""
_USUAL_TAPER, _STEEPEST = 0.2, 1.5
"""Where it is not known, as of grasps in the graph; and what steeper ones count as."""
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
    stroke
        Change with the logarithm of a hand's stroke over 80 mm: the same errors of the pose weigh
        more on a small hand.
    shortfall
        How many times ``sqrt(p (1 - p) + .02)`` nine of ten objects stay at most below a chance p.
    taper
        Change with the friction that pads use up by leaning against each other; at most 0. A load
        near the hand's limit is carried by pads that lie flat, and slips out of those that lean.
    lapse
        Share of trials that fail however good the grasp is.
    """

    offset: float
    above: float
    below: float
    load: float
    stroke: float
    shortfall: float
    taper: float = 0.0
    lapse: float = 0.0

    @staticmethod
    def terms(
        score: float, load: float | None, stroke: float, taper: float | None = None
    ) -> tuple[float, ...]:
        """Return what :attr:`numbers` are multiplied by in the log odds."""
        inside = min(max(float(score), _LOWEST), _HIGHEST)
        x = float(np.log(inside / (1 - inside)))
        share = max(_USUAL_LOAD if load is None else load, _LIGHTEST)
        size = min(max(stroke, _STROKES_M[0]), _STROKES_M[1]) / _STROKE_M
        lean = min(_USUAL_TAPER if taper is None else taper, _STEEPEST)
        return 1.0, max(x, 0.0), min(x, 0.0), float(np.log(share)), float(np.log(size)), lean

    @property
    def numbers(self) -> tuple[float, ...]:
        """Offset, both slopes, and changes with load, stroke and taper."""
        return self.offset, self.above, self.below, self.load, self.stroke, self.taper

    def chance(
        self,
        score: float,
        load: float | None = None,
        stroke: float = _STROKE_M,
        taper: float | None = None,
    ) -> float:
        """Return the chance of a score.

        Parameters
        ----------
        load
            Weight over what friction bears; None = a usual one.
        stroke
            Of the hand, m.
        taper
            Friction that the pads use up by leaning against each other, as a share; None = a usual
            one.
        """
        odds = float(np.dot(self.numbers, self.terms(score, load, stroke, taper)))
        return float((1 - self.lapse) / (1 + np.exp(-odds)))

    def at_least(self, chance: float) -> float:
        """Return the share of trials in which nine of ten objects with a chance hold at least."""
        return max(chance - self.shortfall * chance_spread(chance), 0.0)


def chance_spread(chance: float) -> float:
    """Return the spread, sqrt(p (1 - p) + .02), in which shortfalls of a chance are measured."""
    return float(np.sqrt(chance * (1 - chance) + _FLOOR))


FACTORY: Mapping[str, FactoryMap] = {
    "lift": FactoryMap(1.97, 0.88, 0.45, 0.0, 0.82, 0.78),
    "carry": FactoryMap(1.16, 0.51, 0.67, -0.92, 1.39, 0.82),
}
"""From 1,002 grasps of 518 generated objects by 24 generated hands: the first of each object, three
times, and another of its plan; a third of the objects with 5 to 90 % of the weight that
friction bears (``rtask study grasp-quality --made 24``)."""

_LIFT = FactoryMap(0.0, 0.957, 0.495, 0.0, 0.0, 0.76, lapse=0.02)
_CARRY = FactoryMap(0.0, 0.591, 0.628, -1.358, 0.0, 0.7, taper=-1.983, lapse=0.026)

TRIED: Mapping[str, Mapping[str, FactoryMap]] = {
    "panda_hand": {"lift": replace(_LIFT, offset=1.789), "carry": replace(_CARRY, offset=0.908)},
    "nao_hand": {"lift": replace(_LIFT, offset=1.961), "carry": replace(_CARRY, offset=0.902)},
}
"""Maps of hands by type, from the first grasps of 244 generated objects, carried out four times
each, with the maps of 676 earlier grasps as prior (``rtask study grasp-quality --alone --fit``).
With a term for leaning pads the two hands hardly differ in carrying."""

UNTRIED: Mapping[str, ScoreMap] = {
    "lift": ScoreMap(0.0, 1.0, (0.24**2, 0.12**2)),
    "carry": ScoreMap(0.0, 1.0, (0.45**2, 0.24**2)),
}
"""The own maps of a hand without outcomes, in the logit of the factory's chance. Deviations are one
and a half times those of the 24 hands, as real ones differ in what is the same there: the stuff of
their pads, how stiff they are and how they are driven."""

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
            With ``lift`` and ``carry``, and where they are known with ``load``, weight over what
            friction bears, and ``taper``, friction that leaning pads use up.
        """
        chances = {}
        for name in self.maps:
            if name in scores:
                chance = self._factory_chance(name, scores)
                chances[name] = self.own[name].chance(chance) if name in self.own else chance
        if len(chances) == len(self.maps):
            # What is carried was lifted. Where own outcomes tell of carrying alone, they decide.
            if "lift" in self.own or "carry" not in self.own:
                chances["carry"] = min(chances["carry"], chances["lift"])
            else:
                chances["lift"] = max(chances["carry"], chances["lift"])
        promised: dict[str, float] = {}
        for name, chance in chances.items():
            promised[f"{name}_chance"] = chance
            promised[f"{name}_at_least"] = self.maps[name].at_least(chance)
        return promised

    def after(self, outcomes: Iterable[Outcome]) -> Promises:
        """Return the promises that all outcomes of the hand teach, which may come in any order.

        Outcomes that these promises grew from already do not count again: give all of them.
        """
        scored: dict[str, list[tuple[float, bool]]] = {name: [] for name in FACTORY}
        for scores, held in outcomes:
            # A lift that was never carried any further says nothing of carrying.
            for name in FACTORY:
                if name in held and name in scores:
                    scored[name].append((self._factory_chance(name, scores), bool(held[name])))
        # A hand of a tried type differs less from its map than any hand from the general one.
        prior = dict.fromkeys(FACTORY, _OF_TRIED) if self.hand in TRIED else UNTRIED
        own = {name: fit_map(rows, prior[name]) for name, rows in scored.items() if rows}
        return Promises(self.stroke, self.hand, own)

    def _factory_chance(self, name: str, scores: Mapping[str, float]) -> float:
        known = scores.get("load"), self.stroke, scores.get("taper")
        chance = self.maps[name].chance(scores[name], *known)
        if name == "carry" and "lift" in scores:
            # By its own map alone, a thing of few grams that pads meet badly is carried always.
            return min(chance, self._factory_chance("lift", scores))
        return chance
