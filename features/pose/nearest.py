"""Grid of nearest samples by vector propagation (Danielsson 1980)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["nearest_grid"]

_SURE = 2
_BEFORE = np.array(
    [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) < (0, 0, 0)]
)


def nearest_grid(
    places: NDArray[np.float32], pad_m: float, cells: int
) -> tuple[NDArray[np.int16], NDArray[np.float64], float]:
    """Return for each cell of the padded box the sample nearest to its centre.

    Within a cell or two of the samples it is the nearest; of the cells farther away one in ten gets
    another one, which is farther by less than half a cell's edge.

    Parameters
    ----------
    places : (n, 3) float32, m
        At most 32,767.
    pad_m
        Added on each side of their box.
    cells
        Along its longest side.

    Returns
    -------
    (a, b, c) int16
    (3,) float64, m
        The grid's corner.
    float, m
        Edge of a cell.

    Examples
    --------
    >>> grid, corner, cell = nearest_grid(np.float32([[0, 0, 0], [1, 0, 0]]), 0.5, 8)
    >>> grid.shape, grid[:, 0, 0].tolist()
    ((8, 4, 4), [0, 0, 0, 0, 1, 1, 1, 1])
    """
    low = places.min(axis=0).astype(np.float64) - pad_m
    high = places.max(axis=0).astype(np.float64) + pad_m
    cell = float((high - low).max()) / cells
    shape = np.maximum(np.ceil((high - low) / cell - 1e-9).astype(np.int64), 1)
    nearest = np.full(tuple(shape.tolist()), -1, np.int16)
    away = np.full(nearest.shape, np.inf, np.float32)
    _seed(places, low, cell, nearest, away)
    _pass_on(places, low, cell, nearest, away, _BEFORE)
    return nearest, low, cell


@numba.njit(cache=True, nogil=True, inline="always")
def _offer(sample, places, low, cell, nearest, away, i, j, k):  # type: ignore[no-untyped-def]
    """Give a cell a sample when it is nearer than the one that it has."""
    x = low[0] + (i + 0.5) * cell - places[sample, 0]
    y = low[1] + (j + 0.5) * cell - places[sample, 1]
    z = low[2] + (k + 0.5) * cell - places[sample, 2]
    distance = np.float32(x * x + y * y + z * z)
    if distance < away[i, j, k]:
        away[i, j, k] = distance
        nearest[i, j, k] = sample


@numba.njit(cache=True, nogil=True)
def _seed(places, low, cell, nearest, away):  # type: ignore[no-untyped-def]
    """Give each sample to the cells around it: there, nothing is left to chance."""
    a, b, c = nearest.shape
    for s in range(len(places)):
        i = int((places[s, 0] - low[0]) / cell)
        j = int((places[s, 1] - low[1]) / cell)
        k = int((places[s, 2] - low[2]) / cell)
        for x in range(max(i - _SURE, 0), min(i + _SURE + 1, a)):
            for y in range(max(j - _SURE, 0), min(j + _SURE + 1, b)):
                for z in range(max(k - _SURE, 0), min(k + _SURE + 1, c)):
                    _offer(s, places, low, cell, nearest, away, x, y, z)


@numba.njit(cache=True, nogil=True)
def _pass_on(places, low, cell, nearest, away, before):  # type: ignore[no-untyped-def]
    """Offer each cell what its neighbours have, from the first cell to the last and back."""
    a, b, c = nearest.shape
    for sign in (1, -1):
        for n in range(a * b * c):
            m = n if sign > 0 else a * b * c - 1 - n
            i, j, k = m // (b * c), m // c % b, m % c
            for q in range(len(before)):
                x, y, z = i + sign * before[q, 0], j + sign * before[q, 1], k + sign * before[q, 2]
                if x < 0 or y < 0 or z < 0 or x >= a or y >= b or z >= c:
                    continue
                sample = nearest[x, y, z]
                if sample >= 0 and sample != nearest[i, j, k]:
                    _offer(sample, places, low, cell, nearest, away, i, j, k)
