"""State of an object in five numbers: pooled SIFT on components that grow with the views.

Gatto 2016, 3.3.4 takes the first principal components of an object's view as state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray

__all__ = ["GrowingComponents", "State", "pooled"]


DESCRIPTOR = 128
_COMPONENTS = 5
_ENOUGH = 30


def pooled(descriptors: ArrayLike) -> tuple[FloatArray, bool]:
    """Return mean and standard deviation of a view's descriptors, and whether there were any.

    Parameters
    ----------
    descriptors : (n, 128)
        RootSIFT of all keypoints.

    Returns
    -------
    (256,) float, bool
        Zeros and False for a view without keypoints.

    Raises
    ------
    ValueError
        Another shape, or a value that is not finite.
    """
    rows = np.asarray(descriptors, dtype=np.float64).reshape(-1, DESCRIPTOR)
    if not np.all(np.isfinite(rows)):
        raise ValueError("a descriptor is not finite")
    if len(rows) == 0:
        return np.zeros(2 * DESCRIPTOR), False
    return np.concatenate([rows.mean(axis=0), rows.std(axis=0)]), True


@dataclass(frozen=True, eq=False)
class State:
    """Five standardised components (5,) and the version of the components they belong to."""

    features: FloatArray
    version: int


class GrowingComponents:
    """Principal components of all views seen, kept current with every view.

    Until thirty views are known a fixed random projection stands in. Mean and scatter are updated
    exactly, view by view; the version goes up whenever the components are recomputed, at every
    doubling of the number of views, so that states of one version are comparable.

    Parameters
    ----------
    size
        Of a pooled view.
    seed
        Of the random projection.
    """

    def __init__(self, size: int = 2 * DESCRIPTOR, seed: int = 0) -> None:
        self.size = size
        self.version = 0
        self.count = 0
        self._mean = np.zeros(size)
        self._scatter = np.zeros((size, size))
        rng = np.random.default_rng(seed)
        projection, _ = np.linalg.qr(rng.normal(size=(size, _COMPONENTS)))
        self._axes: FloatArray = projection.T
        self._centre = np.zeros(size)
        self._scale = np.ones(_COMPONENTS)
        self._due = _ENOUGH

    def add(self, view: ArrayLike) -> bool:
        """Take in a pooled view (size,); return whether the components changed.

        Raises
        ------
        ValueError
            Another shape, or a value that is not finite.
        """
        row = self._checked(view)
        self.count += 1
        before = row - self._mean
        self._mean += before / self.count
        self._scatter += np.outer(before, row - self._mean)
        if self.count < self._due:
            return False
        self._compute()
        self._due = 2 * self.count
        return True

    def state(self, view: ArrayLike) -> State:
        """Return the components of a pooled view (size,)."""
        row = self._checked(view)
        return State(self._axes @ (row - self._centre) / self._scale, self.version)

    def _checked(self, view: ArrayLike) -> FloatArray:
        row = np.asarray(view, dtype=np.float64)
        if row.shape != (self.size,) or not np.all(np.isfinite(row)):
            raise ValueError(f"expected {self.size} finite numbers, got shape {row.shape}")
        return row

    def _compute(self) -> None:
        values, vectors = np.linalg.eigh(self._scatter / self.count)
        axes = vectors[:, ::-1][:, :_COMPONENTS].T
        largest = np.argmax(np.abs(axes), axis=1)
        self._axes = axes * np.sign(axes[np.arange(_COMPONENTS), largest])[:, None]
        self._scale = np.sqrt(np.maximum(values[::-1][:_COMPONENTS], 1e-12))
        self._centre = self._mean.copy()
        self.version += 1

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        return {
            "numbers": np.array([self.version, self.count, self._due]),
            "mean": self._mean,
            "scatter": self._scatter,
            "axes": self._axes,
            "centre": self._centre,
            "scale": self._scale,
        }

    def take(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        self.version, self.count, self._due = (int(n) for n in arrays["numbers"])
        self._mean, self._scatter = np.array(arrays["mean"]), np.array(arrays["scatter"])
        self._axes, self._centre = np.array(arrays["axes"]), np.array(arrays["centre"])
        self._scale = np.array(arrays["scale"])
