"""Continuous states as numbered cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Bins"]


class Bins:
    """A regular grid of cells, centred on zero in every dimension.

    The width of a cell is ``(high - low) / parts``, its number ``trunc((x +- width / 2) / width)``
    with the sign of x; so zero is the middle of a cell, and integers are cells of width one.

    Parameters
    ----------
    low, high : (d,)
        Range of each feature.
    parts : (d,)
        How many widths the range is.

    Raises
    ------
    ValueError
        A range that is empty or not finite.

    Examples
    --------
    >>> bins = Bins((0, 0), (5, 10), (5, 10))
    >>> bins.count, bins.number((2, 6)), bins.centre(28)
    (66, 28, array([2., 6.]))
    """

    def __init__(self, low: Sequence[float], high: Sequence[float], parts: Sequence[int]) -> None:
        self.low = np.asarray(low, dtype=np.float64)
        self.high = np.asarray(high, dtype=np.float64)
        self.width = (self.high - self.low) / np.asarray(parts)
        if not np.all(np.isfinite(self.width)) or np.any(self.width <= 0):
            raise ValueError(f"empty or infinite range: {low} to {high} in {parts} parts")
        self.first = self._cell(self.low)
        self.shape: tuple[int, ...] = tuple(int(n) for n in self._cell(self.high) - self.first + 1)

    @property
    def count(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))

    def _cell(self, state: NDArray[np.float64]) -> NDArray[np.int64]:
        shifted = (state + np.copysign(self.width / 2, state)) / self.width
        # A state at a cell's edge must not fall to either side by rounding.
        return np.asarray(np.trunc(shifted + np.copysign(1e-9, state)), dtype=np.int64)

    def number(self, state: ArrayLike) -> int:
        """Return the number of the cell that holds a state (d,); outside: the nearest.

        Raises
        ------
        ValueError
            A state that is not finite or has another number of features.
        """
        values = np.asarray(state, dtype=np.float64)
        if values.shape != self.low.shape or not np.all(np.isfinite(values)):
            raise ValueError(f"expected {len(self.low)} finite features, got {values}")
        cell = self._cell(values) - self.first
        clipped = np.clip(cell, 0, np.asarray(self.shape) - 1)
        return int(np.ravel_multi_index(tuple(clipped), self.shape))

    def centre(self, number: int) -> NDArray[np.float64]:
        """Return the middle (d,) of a cell."""
        cell = np.array(np.unravel_index(number, self.shape)) + self.first
        return np.asarray(cell * self.width, dtype=np.float64)

    def centres(self) -> NDArray[np.float64]:
        """Return the middles (count, d) of all cells, in the order of their numbers."""
        grid = np.indices(self.shape).reshape(len(self.shape), -1).T + self.first
        return np.asarray(grid * self.width, dtype=np.float64)
