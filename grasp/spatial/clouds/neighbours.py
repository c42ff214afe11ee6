"""Neighbour search in a cloud by cells in sorted order (compiled).

A cell's key grows with z fastest, so the cells above one another that a query touches are one run
of the sorted order: two binary searches for each column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["PointGrid", "within"]


@dataclass(frozen=True)
class PointGrid:
    """Points sorted into cubic cells.

    Parameters
    ----------
    points : (n, 3) float64, m
    cell
        Edge of a cell, m.
    order, keys : (n,) int64
        Points in ascending order of their cell's key, and those keys.
    low : (3,), m
        Corner of the first cell.
    shape : (3,) int64
        Cells along x, y, z.

    Examples
    --------
    >>> grid = PointGrid.of(np.array([[0.0, 0, 0], [0.01, 0, 0], [0.5, 0, 0]]), 0.01)
    >>> out = np.empty(3, np.int64)
    >>> count = within(*grid.arrays, np.zeros(3), 0.02, out)
    >>> sorted(out[:count].tolist())
    [0, 1]
    """

    points: NDArray[np.float64]
    cell: float
    order: NDArray[np.int64]
    keys: NDArray[np.int64]
    low: NDArray[np.float64]
    shape: NDArray[np.int64]

    @classmethod
    def of(cls, points: NDArray[np.float64], cell: float) -> PointGrid:
        """Sort ``points`` (n, 3), m, finite and within 1e6 cells along each axis."""
        low = points.min(axis=0)
        cells = np.floor((points - low) / cell).astype(np.int64)
        shape = cells.max(axis=0) + 1
        keys = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
        order = np.argsort(keys, kind="stable")
        return cls(points, cell, order, keys[order], low, shape)

    @property
    def arrays(
        self,
    ) -> tuple[
        NDArray[np.float64],
        float,
        NDArray[np.int64],
        NDArray[np.int64],
        NDArray[np.float64],
        NDArray[np.int64],
    ]:
        """The fields in the order that compiled callers take."""
        return self.points, self.cell, self.order, self.keys, self.low, self.shape


@numba.njit(cache=True, nogil=True)
def within(points, cell, order, keys, low, shape, centre, radius, out):  # type: ignore[no-untyped-def]
    """Write the numbers of points within ``radius`` m of ``centre`` (3,) to ``out``; return how
    many, in an order that depends on the grid alone."""
    first = np.empty(3, np.int64)
    last = np.empty(3, np.int64)
    for k in range(3):
        first[k] = max(0, int(np.floor((centre[k] - radius - low[k]) / cell)))
        last[k] = min(shape[k] - 1, int(np.floor((centre[k] + radius - low[k]) / cell)))
    count = 0
    square = radius * radius
    if last[2] < first[2]:
        return 0
    for ix in range(first[0], last[0] + 1):
        for iy in range(first[1], last[1] + 1):
            base = (ix * shape[1] + iy) * shape[2]
            start = np.searchsorted(keys, base + first[2])
            stop_key = base + last[2]
            while start < keys.shape[0] and keys[start] <= stop_key:
                i = order[start]
                dx = points[i, 0] - centre[0]
                dy = points[i, 1] - centre[1]
                dz = points[i, 2] - centre[2]
                if dx * dx + dy * dy + dz * dz <= square:
                    out[count] = i
                    count += 1
                start += 1
    return count
