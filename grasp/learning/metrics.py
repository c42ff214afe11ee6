"""Measures of a grasp learner: attempts to success, first tries, regret, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray

__all__ = [
    "NEVER",
    "Life",
    "Measure",
    "attempts",
    "bootstrap",
    "difference",
    "first_try",
    "regret",
]

Ints = NDArray[np.int64]

NEVER = 13
"""Attempts that count for an object that was not held in twelve."""


@dataclass(frozen=True, eq=False)
class Life:
    """Attempts of one learner at objects, in the order in which it met them.

    Parameters
    ----------
    objects : (n,)
        Numbers of the objects.
    attempts : (n,)
        To the first success; :data:`NEVER` where there was none.
    lost : (n,)
        Regret: over the attempts on an object, the sum of the best candidate's chance less that
        of the candidate tried.
    """

    objects: Ints
    attempts: Ints
    lost: FloatArray

    def __post_init__(self) -> None:
        if not len(self.objects) == len(self.attempts) == len(self.lost):
            raise ValueError("objects, attempts and regret must be of one length")
        if len(self.attempts) and not 1 <= self.attempts.min() <= self.attempts.max() <= NEVER:
            raise ValueError(f"attempts lie in 1..{NEVER}")

    def part(self, chosen: slice | NDArray[np.bool_]) -> Life:
        """Return some of the objects."""
        return Life(self.objects[chosen], self.attempts[chosen], self.lost[chosen])


@dataclass(frozen=True)
class Measure:
    """A mean with its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


def attempts(life: Life) -> FloatArray:
    """Return the attempts to the first success, an object."""
    return life.attempts.astype(np.float64)


def first_try(life: Life) -> FloatArray:
    """Return 1 where the first attempt held, an object."""
    held: FloatArray = (life.attempts == 1).astype(np.float64)
    return held


def regret(life: Life) -> FloatArray:
    """Return the cumulative regret up to each object."""
    return np.asarray(np.cumsum(life.lost))


def bootstrap(
    lives: Sequence[Life],
    measure: Callable[[Life], FloatArray] = attempts,
    draws: int = 1000,
    seed: int = 0,
) -> Measure:
    """Return the mean over lives and objects with its bootstrap interval (Efron 1979).

    Lives are drawn with replacement and, within each, objects: both are samples of what could have
    been met. (`scipy.stats.bootstrap` draws on one level.)

    Examples
    --------
    >>> life = Life(np.arange(4), np.array([1, 1, 2, 4]), np.zeros(4))
    >>> bootstrap([life, life]).value
    2.0
    """
    return _interval([measure(life) for life in lives], draws, seed)


def difference(
    first: Sequence[Life],
    second: Sequence[Life],
    measure: Callable[[Life], FloatArray] = attempts,
    draws: int = 1000,
    seed: int = 0,
) -> Measure:
    """Return the mean of ``first`` less ``second``, object by object, with its interval.

    Raises
    ------
    ValueError
        The lives do not meet the same objects.
    """
    apart = []
    for a, b in zip(first, second, strict=True):
        if sorted(a.objects) != sorted(b.objects):
            raise ValueError("the lives to compare must meet the same objects")
        apart.append(measure(a)[np.argsort(a.objects)] - measure(b)[np.argsort(b.objects)])
    return _interval(apart, draws, seed)


def _interval(values: list[FloatArray], draws: int, seed: int) -> Measure:
    if not values or any(len(row) == 0 for row in values):
        raise ValueError("nothing to measure: a life without objects, or no life")
    rng = np.random.default_rng(seed)
    chosen = rng.integers(len(values), size=(draws, len(values)))
    means = np.empty(chosen.shape)
    for number, row in enumerate(values):
        here = chosen == number
        means[here] = row[rng.integers(len(row), size=(int(here.sum()), len(row)))].mean(axis=1)
    low, high = np.quantile(means.mean(axis=1), (0.025, 0.975))
    return Measure(float(np.mean([row.mean() for row in values])), float(low), float(high))
