"""Continuous states as numbered cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Bins"]

# A state at a cell's edge must not fall to either side by rounding.
_EDGE = 1e-9
_WHOLE, _Array = np.dtype(np.int64), np.ndarray


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
        self._axes: list[tuple[float, float, int, int]] = list(
            zip((self.width / 2).tolist(), self.width.tolist(), self.first.tolist(), self.shape,
                strict=True)
        )  # fmt: skip
        self._known: dict[bytes, int] = {}  # states of whole numbers, at most one a cell

    @property
    def count(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))

    def _cell(self, state: NDArray[np.float64]) -> NDArray[np.int64]:
        shifted = (state + np.copysign(self.width / 2, state)) / self.width
        return np.asarray(np.trunc(shifted + np.copysign(_EDGE, state)), dtype=np.int64)

    def number(self, state: ArrayLike) -> int:
        """Return the number of the cell that holds a state (d,); outside: the nearest.

        Raises
        ------
        ValueError
            A state that is not finite or has another number of features.
        """
        # Learners ask this several times a step, nearly always for a state that is known.
        if not (isinstance(state, _Array) and state.dtype is _WHOLE and state.ndim == 1):
            return self._number(np.asarray(state, dtype=np.float64))
        try:
            return self._known[state.tobytes()]
        except KeyError:
            cell = self._number(state)
            if len(self._known) < self.count:
                self._known[state.tobytes()] = cell
            return cell

    def _number(self, values: NDArray[Any]) -> int:
        if values.shape != self.low.shape:
            raise ValueError(f"expected {len(self.low)} finite features, got {values}")
        number = 0
        try:
            # As in _cell, but without arrays, as learners ask this several times a step.
            for x, (half, width, first, count) in zip(values.tolist(), self._axes, strict=True):
                if x >= 0:
                    cell = int((x + half) / width + _EDGE) - first
                else:
                    cell = int((x - half) / width - _EDGE) - first
                number = number * count + (0 if cell < 0 else cell if cell < count else count - 1)
        except (ValueError, OverflowError):  # int() of what is not finite
            raise ValueError(f"expected {len(self.low)} finite features, got {values}") from None
        return number

    def centre(self, number: int) -> NDArray[np.float64]:
        """Return the middle (d,) of a cell."""
        cell = np.array(np.unravel_index(number, self.shape)) + self.first
        return np.asarray(cell * self.width, dtype=np.float64)

    def centres(self) -> NDArray[np.float64]:
        """Return the middles (count, d) of all cells, in the order of their numbers."""
        grid = np.indices(self.shape).reshape(len(self.shape), -1).T + self.first
        return np.asarray(grid * self.width, dtype=np.float64)
