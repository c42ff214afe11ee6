"""Causes that cannot be seen, inferred from attempts: where the mass is, and which part is weak.

A failure says more than that this grasp fails. Of a long thing, either nothing hides; or its centre
of mass lies somewhere along it, and whatever is held far from there turns in the hand; or a zone
at one end, of any share of the length, gives way wherever fingers touch it. Each is a hypothesis;
attempts make them more or less likely by Bayes' rule. What follows holds for every hand. A choice
also weighs that it may be none of these (:mod:`grasp.learning.hypotheses`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.learning.hypotheses import (
    CAUSES_PRIOR,
    CENTRES,
    MASSES,
    PRIOR,
    STEP,
    ZONE_NUMBERS,
    ZONES,
    allowed,
    allowed_by_causes,
    log_likelihood,
)

__all__ = [
    "Hidden", "HiddenHypothesis", "decisive_causes", "hidden_causes", "hidden_hypotheses",
    "hidden_share",
]  # fmt: skip

_MIDDLE = 0.06
"""A centre of mass nearer to the middle is not called off-centre."""


def hidden_share(
    places: NDArray[np.float64],
    half_finger: float,
    tried: NDArray[np.float64],
    held: NDArray[np.float64],
    weights: NDArray[np.float64],
    prior: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return by what factor attempts lower the chance of grasps along an object, (n,).

    1 for the grasps for which most speaks, and for all without attempts at this object or others:
    nothing is assumed to hide before something was tried, and where all grasps are in one place
    nothing follows.

    Parameters
    ----------
    places : (n,)
        Of the grasps along the longer side, from its middle, in units of its length.
    half_finger
        Half the width of a finger, in the same units.
    tried : (k,)
        Places of the attempts.
    held : (k,)
        1 for a success, 0 for a failure.
    weights : (k,)
        How far each attempt counts, 0 and up.
    prior : (h,)
        Of the hypotheses, from attempts at other objects
        (:meth:`grasp.learning.population.Population.prior_of`); None = there are none.

    Examples
    --------
    >>> along = np.array([-0.3, 0.0, 0.3])
    >>> failed = np.array([0.0, 0.3])
    >>> hidden_share(along, 0.1, failed, np.zeros(2), np.ones(2)).round(1).tolist()
    [1.0, 0.4, 0.5]
    """
    if len(places) == 0 or (len(tried) == 0 and prior is None):
        return np.ones(len(places))
    left = allowed(places, half_finger)
    likelihood = log_likelihood(allowed(tried, half_finger), held, weights)
    posterior = _updated(PRIOR if prior is None else prior, likelihood)
    # Rounded, so that the order of the attempts does not affect the last bit.
    share = (posterior @ left) / (PRIOR @ left)
    return np.asarray(np.round(share / share.max(), 9))


@dataclass(frozen=True)
class Hidden:
    """A cause that attempts make likely.

    Parameters
    ----------
    kind
        ``mass``: the centre of mass is away from the middle; ``zone``: a part at one end gives way.
    probability
        0..1, given the attempts.
    start, end
        Where along the longer side, from the middle, in units of its length: of a zone, both ends;
        of a centre of mass, one standard deviation to either side of the mean.
    """

    kind: Literal["mass", "zone"]
    probability: float
    start: float
    end: float


@dataclass(frozen=True)
class HiddenHypothesis(Hidden):
    """One hypothesis about what hides, with its chance before anything was tried."""

    number: int

    def share_at(self, place: float, half_finger: float) -> float:
        """Return what it leaves of the chance of a grasp, 0..1.

        Parameters
        ----------
        place, half_finger
            Along the longer side from its middle, and half the finger's width, in units of its
            length.

        Examples
        --------
        >>> mass = next(h for h in hidden_hypotheses() if h.kind == "mass" and h.start > 0.2)
        >>> mass.share_at(mass.start, 0.05) > 0.9 > 0.1 > mass.share_at(-0.4, 0.05)
        True
        """
        return float(allowed_by_causes(np.array([place]), half_finger)[self.number, 0])


def hidden_hypotheses() -> list[HiddenHypothesis]:
    """Return all hypotheses that something hides, without the one that nothing does."""
    masses = [
        HiddenHypothesis("mass", float(CAUSES_PRIOR[k]), centre, centre, k)
        for k, centre in zip(MASSES.tolist(), CENTRES.tolist(), strict=True)
        if abs(centre) > _MIDDLE
    ]
    zones = []
    for k, (end, reach) in zip(ZONE_NUMBERS.tolist(), ZONES.tolist(), strict=True):
        start, stop = sorted((0.5 * end, end * (0.5 - reach)))
        zones.append(HiddenHypothesis("zone", float(CAUSES_PRIOR[k]), start, stop, k))
    return masses + zones


def hidden_causes(
    tried: NDArray[np.float64],
    half_fingers: NDArray[np.float64],
    held: NDArray[np.float64],
    least: float = 0.3,
) -> list[Hidden]:
    """Return the causes that are likely after some attempts, most likely first.

    They are the hypotheses of :func:`hidden_share` that can be named, compared with each other and
    with nothing alone, and taken together by what a person would call one cause: the centre of mass
    is off to one side, or a part at one end is weak.

    Parameters
    ----------
    tried : (k,)
        Places of the attempts along the longer side, from its middle, in units of its length.
    half_fingers : (k,)
        Half the width of the finger of each attempt, in the same units.
    held : (k,)
        1 for a success, 0 for a failure.
    least
        Smallest probability of a cause that is returned.

    Examples
    --------
    >>> failed_in_the_middle_and_right = np.array([0.0, 0.25, -0.3])
    >>> causes = hidden_causes(
    ...     failed_in_the_middle_and_right, np.full(3, 0.05), np.array([0.0, 0.0, 1.0])
    ... )
    >>> [(cause.kind, round(cause.probability, 1)) for cause in causes]
    [('zone', 0.5), ('mass', 0.4)]
    >>> hidden_causes(np.zeros(1), np.full(1, 0.05), np.ones(1))
    []
    """
    # A cause is what explains failures; without any there is nothing to be named.
    if len(tried) == 0 or np.all(held > 0):
        return []
    left = allowed_by_causes(tried, half_fingers)
    posterior = _updated(CAUSES_PRIOR, log_likelihood(left, held, np.ones(len(tried))))
    causes = [cause for cause, _ in _named(posterior)]
    likely = [
        Hidden(
            cause.kind, *(round(v, 9) + 0.0 for v in (cause.probability, cause.start, cause.end))
        )
        for cause in causes
        if cause.probability >= least
    ]
    return sorted(likely, key=lambda cause: (-cause.probability, cause.kind, cause.start))


def decisive_causes(
    places: NDArray[np.float64],
    half_finger: float,
    tried: NDArray[np.float64],
    held: NDArray[np.float64],
    weights: NDArray[np.float64],
    prior: NDArray[np.float64] | None = None,
    least: float = 0.05,
) -> list[Hidden | None]:
    """Return for each grasp the cause that lowers its chance most, None where none does much.

    The parameters are those of :func:`hidden_share`.

    Parameters
    ----------
    least
        By how much attempts must have lowered the chance through that cause, as a share of it.

    Examples
    --------
    >>> right = decisive_causes(
    ...     np.array([0.3, -0.3]), 0.05, np.array([0.25, -0.3]), np.array([0.0, 1.0]), np.ones(2)
    ... )
    >>> [cause and (cause.kind, cause.end) for cause in right]
    [('zone', 0.5), None]
    """
    if len(tried) == 0 and prior is None:
        return [None] * len(places)
    likelihood = log_likelihood(allowed(tried, half_finger), held, weights)
    posterior = _updated(PRIOR if prior is None else prior, likelihood)
    refused = 1.0 - allowed(places, half_finger)
    # By side, as a person would speak of it: nineteen places of a mass are one cause.
    named = list(_named(posterior))
    # What the attempts added, since every hypothesis lowers the chance a little beforehand.
    lost = np.stack([(posterior - PRIOR)[members] @ refused[members] for _, members in named])
    most = np.argmax(np.round(lost, 9), axis=0)
    return [
        named[cause][0] if lost[cause, place] >= least else None
        for place, cause in enumerate(most.tolist())
    ]


def _named(posterior: NDArray[np.float64]) -> Iterator[tuple[Hidden, NDArray[np.intp]]]:
    """Yield what a person would call one cause, with the numbers of its hypotheses."""
    for side in (-1.0, 1.0):
        members = np.flatnonzero(side * CENTRES > _MIDDLE)
        chance, centres = posterior[MASSES[members]], CENTRES[members]
        total = float(chance.sum())
        if total > 0:
            mean = float(chance @ centres) / total
            variance = float(chance @ centres**2) / total - mean**2
            spread = max(variance, STEP**2 / 12) ** 0.5
            yield Hidden("mass", total, mean - spread, mean + spread), MASSES[members]
        members = np.flatnonzero(ZONES[:, 0] == side)
        chance = posterior[ZONE_NUMBERS[members]]
        total = float(chance.sum())
        reach = float(chance @ ZONES[members, 1]) / total if total > 0 else 0.0
        ends = sorted((side * 0.5, side * (0.5 - reach)))
        yield Hidden("zone", total, ends[0], ends[1]), ZONE_NUMBERS[members]


def _updated(prior: NDArray[np.float64], likelihood: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probabilities (h,) of hypotheses after attempts of a log-likelihood (h,)."""
    posterior: NDArray[np.float64] = prior * np.exp(likelihood - likelihood.max())
    posterior /= posterior.sum()
    return posterior
