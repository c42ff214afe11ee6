"""Placements by the cell of space that they are in, so that those nearby are found at any age.

Cells are cubes of each frame. A placement that lasts for a year has as many events in its interval
as happened anywhere in that year; only those of the cells around it are looked at.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["CELL_M", "Cells", "cells_around"]

CELL_M = 0.2
"""Edge of a cell, m: what is at most so far away is in the same or an adjacent one."""
_PRIMES = (np.int64(73_856_093), np.int64(19_349_663), np.int64(83_492_791), np.int64(49_979_693))
_AROUND = np.array(list(itertools.product((-1, 0, 1), repeat=3)), np.int64)

Cell = tuple[int, int, int, int]
"""Number of the frame, and of the cell along x, y and z."""


def cell_of(frame: int, x: float, y: float, z: float) -> Cell:
    """Return the cell of a position, m, in a frame."""
    return frame, math.floor(x / CELL_M), math.floor(y / CELL_M), math.floor(z / CELL_M)


def cells_around(cell: Cell) -> list[Cell]:
    """Return a cell and the 26 around it."""
    frame, *spot = cell
    return [(frame, x, y, z) for x, y, z in (_AROUND + np.array(spot, np.int64)).tolist()]


class Cells:
    """Rows of the index of placements, sorted by cell and then by a time.

    Parameters
    ----------
    frames : (n,) int
    positions : (n, 3) float, m
    times_s : (n,) float
        Unix times.

    Examples
    --------
    >>> spots = np.array([[0.05, 0.05, 0.0], [0.1, -0.1, 0.0], [3.0, 0.0, 0.0]], np.float32)
    >>> cells = Cells(np.zeros(3, np.int32), spots, np.array([5.0, 4.0, 5.0]))
    >>> cells.rows_near(cell_of(0, 0.0, 0.0, 0.0), 4.5, 9.0).tolist()
    [0]
    """

    def __init__(
        self,
        frames: NDArray[np.int32],
        positions: NDArray[np.float32],
        times_s: NDArray[np.float64],
    ) -> None:
        spots = np.floor(positions.astype(np.float64) / CELL_M).astype(np.int64)
        keys = _keys(frames.astype(np.int64), spots)
        self._rows = np.lexsort((times_s, keys))
        self._keys = keys[self._rows]
        self._times_s = times_s[self._rows]

    def rows_near(self, cell: Cell, since_s: float, until_s: float) -> NDArray[np.intp]:
        """Return the rows in and around a cell whose time is after one instant, and by another.

        There may be some of other cells among them, since cells are told apart by a hash.
        """
        frame, *spot = cell
        around = _AROUND + np.array(spot, np.int64)
        # Unique, or rows of two cells with the same hash would be returned twice.
        keys = np.unique(_keys(np.full(len(around), frame, np.int64), around))
        lows = np.searchsorted(self._keys, keys, side="left")
        highs = np.searchsorted(self._keys, keys, side="right")
        rows = []
        for low, high in zip(lows.tolist(), highs.tolist(), strict=True):
            if low < high:
                times = self._times_s[low:high]
                first, last = np.searchsorted(times, [since_s, until_s], side="right")
                rows.append(self._rows[low + first : low + last])
        return np.concatenate(rows) if rows else np.empty(0, np.intp)


def _keys(frames: NDArray[np.int64], spots: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a hash of each cell; spots are (n, 3)."""
    keys = frames * _PRIMES[0]
    for axis, prime in enumerate(_PRIMES[1:]):
        keys = keys ^ (spots[:, axis] * prime)
    return keys
