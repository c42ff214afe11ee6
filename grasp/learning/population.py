"""Prior of what hides in an object, learned from other objects that were tried before.

Objects come from families, and what a family hides is not known beforehand. Each object that was
tried makes the hypotheses about it more or less likely; the shares of the hypotheses among objects
are a Dirichlet-multinomial mixture, whose weights are found by expectation maximisation (Dempster,
Laird and Rubin 1977; as an empirical Bayes prior: Efron 2010, chapter 1). So causes that do not fit
the objects at hand lose their weight to those that do, or to "none of these".

An end that is weak in one object may be the other one in the next: hypotheses are learned together
with their mirror images. Objects of another size say less.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.learning.hypotheses import MIRRORED, PRIOR, allowed, log_likelihood

__all__ = ["Population", "ProductEvidence", "evidence_of"]

_PSEUDO_PRODUCTS = 1.0
"""Number of objects that the prior is worth."""
_ROUNDS = 4
_BANDWIDTH = 0.3
"""Of the similarity of objects, in the logarithm of their sizes."""


@dataclass(frozen=True, eq=False)
class ProductEvidence:
    """What the attempts at one object say of what hides in it.

    Parameters
    ----------
    name
        By which it can be left out.
    size : (3,)
        Length, width and height, m.
    likelihood : (h,)
        Of the attempts under each hypothesis, in any unit.
    """

    name: str
    size: NDArray[np.float64]
    likelihood: NDArray[np.float64]


def evidence_of(
    name: str,
    size: Sequence[float],
    tried: NDArray[np.float64],
    half_finger: NDArray[np.float64] | float,
    held: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> ProductEvidence:
    """Return what attempts at an object say; see :func:`grasp.learning.causes.hidden_share`."""
    logs = log_likelihood(allowed(tried, half_finger), held, weights)
    return ProductEvidence(name, np.asarray(size, np.float64), np.exp(logs - logs.max()))


class Population:
    """Objects that were tried, of which the next one may be another.

    Parameters
    ----------
    products
        Their order does not matter.

    Examples
    --------
    >>> tried, held = np.array([0.0, 0.3, 0.15]), np.array([0.0, 0.0, 1.0])
    >>> brittle = [
    ...     evidence_of(f"box-{k}", (0.1, 0.03, 0.04), tried, 0.1, held, np.ones(3))
    ...     for k in range(4)
    ... ]
    >>> prior = Population(brittle).prior_of((0.1, 0.03, 0.04))
    >>> bool(prior[0] < 0.5 * PRIOR[0])  # it is less likely that nothing hides
    True
    """

    def __init__(self, products: Sequence[ProductEvidence] = ()) -> None:
        self._products = sorted(products, key=lambda product: product.name)
        self._log_sizes = np.log([product.size for product in self._products]).reshape(-1, 3)
        self._likelihood = np.array([product.likelihood for product in self._products])

    def __len__(self) -> int:
        return len(self._products)

    def prior_of(
        self, size: Sequence[float], without: Callable[[str], bool] = lambda name: False
    ) -> NDArray[np.float64]:
        """Return the prior (h,) of an object of a size (length, width, height), m.

        Parameters
        ----------
        without
            Whether an object of a name is left out: what is asked about is not its own prior.
        """
        counted = np.array([not without(product.name) for product in self._products], bool)
        if not counted.any():
            return PRIOR
        distance = np.linalg.norm(self._log_sizes - np.log(size), axis=1)
        likeness = np.where(counted, np.exp(-(distance**2) / (2 * _BANDWIDTH**2)), 0.0)
        prior = PRIOR
        for _ in range(_ROUNDS):
            # The beliefs about each object are summed without being formed one by one.
            counts = prior * ((likeness / (self._likelihood @ prior)) @ self._likelihood)
            counts = (counts + counts[MIRRORED]) / 2
            prior = (_PSEUDO_PRODUCTS * PRIOR + counts) / (_PSEUDO_PRODUCTS + likeness.sum())
        return np.asarray(prior)
