"""What attempts at an object say of what hides in it, and how that lowers the chance of a grasp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp.learning.causes import Hidden, decisive_causes, hidden_share
from grasp.learning.population import Population
from grasp.spatial.gripper import EndEffector
from grasp.spatial.planar import PlanarGrasp
from rtask.engine.decisions import Option
from rtask.engine.memory.experience import Weights
from rtask.engine.remembered import Memory, Remembered

__all__ = ["TriesFromAbove", "hidden_causes_of", "hidden_shares", "tries_from_above"]


@dataclass(frozen=True, eq=False)
class TriesFromAbove:
    """Attempts from above at one object; a grasp in space is another way to hold it.

    Parameters
    ----------
    length
        Of the object, m.
    places : (n,) float64
        Along the object, in units of its length.
    held : (n,) float64
        1 for a success.
    weights : (n,) float64
        What each counts.
    prior : (h,) float64 or None
        Of the hypotheses about what hides in it, from attempts at other objects; None = without.
    """

    length: float
    places: NDArray[np.float64]
    held: NDArray[np.float64]
    weights: NDArray[np.float64]
    prior: NDArray[np.float64] | None = None


def tries_from_above(
    memory: Memory,
    evidence: Sequence[Remembered],
    weights: Weights,
    population: Population | None = None,
) -> TriesFromAbove | None:
    """Return the attempts that say what hides in an object; None if the policy has causes off.

    Parameters
    ----------
    population
        All objects that were tried; those that may be the present one are left out of its prior.
    """
    if not weights.policy.causes:
        return None
    seen = [
        (remembered.x, float(remembered.held), 1.0)
        for remembered in memory.trials
        if remembered.quaternion is None and not remembered.lost
    ]
    seen += [
        (remembered.x, float(tally.held), tally.count * weights.trust(remembered, tally))
        for remembered in evidence
        if not remembered.of_class and remembered.quaternion is None
        for tally in remembered.tallies
        if not tally.lost
    ]
    x, held, weight = np.array(sorted(seen)).reshape(-1, 3).T
    length = weights.size[0]
    prior = None
    if population is not None and len(population) > 0:
        prior = population.prior_of(weights.size, lambda name: name in weights.confidence)
    return TriesFromAbove(length, x / length, held, weight, prior)


def hidden_shares(
    candidates: Sequence[Option], hand: EndEffector, tried: TriesFromAbove | None
) -> NDArray[np.float64]:
    """Return what the attempts leave of each option's quality, (n,)."""
    hidden = np.ones(len(candidates))
    if tried is not None:
        above, places, half_finger = _from_above_among(candidates, hand, tried.length)
        hidden[above] = hidden_share(
            places, half_finger, tried.places, tried.held, tried.weights, tried.prior
        )
    return hidden


def hidden_causes_of(
    candidates: Sequence[Option],
    hand: EndEffector,
    tried: TriesFromAbove | None,
    lowered: NDArray[np.bool_],
) -> list[Hidden | None]:
    """Return the cause that lowered each option's chance most, in metres; None where none did.

    Parameters
    ----------
    lowered : (n,) bool
        Of which options a cause is asked.
    """
    causes: list[Hidden | None] = [None] * len(candidates)
    if tried is not None:
        above, places, half_finger = _from_above_among(candidates, hand, tried.length)
        decisive = decisive_causes(
            places, half_finger, tried.places, tried.held, tried.weights, tried.prior
        )
        for k, cause in zip(above, decisive, strict=True):
            if cause is not None and lowered[k]:
                start, end = cause.start * tried.length, cause.end * tried.length
                causes[k] = replace(cause, start=start, end=end)
    return causes


def _from_above_among(
    candidates: Sequence[Option], hand: EndEffector, length: float
) -> tuple[list[int], NDArray[np.float64], float]:
    """Return which options are from above, their places, and half a finger, by the length."""
    above = [k for k, option in enumerate(candidates) if isinstance(option.grasp, PlanarGrasp)]
    places = np.array([candidates[k].in_object[0] for k in above], np.float64) / length
    return above, places, hand.finger_width / 2 / length
