"""First contact of a jaw with a part (f_C of Kehoe 2014, 3.3).

All coordinates are in a frame with x along the jaw's face and y along its motion; the jaw comes
from infinity and covers lo <= x <= hi.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["CORNER_LEFT", "CORNER_RIGHT", "NOTHING", "TIE", "VERTEX", "highest", "lowest"]

NOTHING, CORNER_LEFT, CORNER_RIGHT, VERTEX = 0, 1, 2, 3

TIE = 1e-10
"""Heights closer than this, in part radii, count as equal; a tie goes to the vertex."""


@njit(cache=True, nogil=True)
def lowest(x, y, n, lo, hi):  # type: ignore[no-untyped-def]
    """Return what a jaw that moves up touches first.

    Parameters
    ----------
    x, y : (>= n,) float
        Vertices in the jaw frame.

    Returns
    -------
    Kind, index of the vertex or of the edge's first vertex, x and y of the contact.
    """
    vertex, left, right = np.inf, np.inf, np.inf
    at_vertex, at_left, at_right = -1, -1, -1
    j = n - 1
    xj, yj = x[j], y[j]
    for i in range(n):
        xi, yi = x[i], y[i]
        if xi > lo and xi < hi and yi < vertex:
            vertex, at_vertex = yi, i
        if (xj < lo) != (xi < lo):
            h = yj + (lo - xj) / (xi - xj) * (yi - yj)
            if h < left:
                left, at_left = h, j
        if (xj < hi) != (xi < hi):
            h = yj + (hi - xj) / (xi - xj) * (yi - yj)
            if h < right:
                right, at_right = h, j
        j, xj, yj = i, xi, yi
    if at_vertex >= 0 and vertex <= min(left, right) + TIE:
        return VERTEX, at_vertex, x[at_vertex], vertex
    if at_left >= 0 and left <= right:
        return CORNER_LEFT, at_left, lo, left
    if at_right >= 0:
        return CORNER_RIGHT, at_right, hi, right
    return NOTHING, -1, 0.0, 0.0


@njit(cache=True, nogil=True)
def highest(x, y, n, lo, hi):  # type: ignore[no-untyped-def]
    """Return what a jaw that comes down touches first; as `lowest`."""
    vertex, left, right = -np.inf, -np.inf, -np.inf
    at_vertex, at_left, at_right = -1, -1, -1
    j = n - 1
    xj, yj = x[j], y[j]
    for i in range(n):
        xi, yi = x[i], y[i]
        if xi > lo and xi < hi and yi > vertex:
            vertex, at_vertex = yi, i
        if (xj < lo) != (xi < lo):
            h = yj + (lo - xj) / (xi - xj) * (yi - yj)
            if h > left:
                left, at_left = h, j
        if (xj < hi) != (xi < hi):
            h = yj + (hi - xj) / (xi - xj) * (yi - yj)
            if h > right:
                right, at_right = h, j
        j, xj, yj = i, xi, yi
    if at_vertex >= 0 and vertex >= max(left, right) - TIE:
        return VERTEX, at_vertex, x[at_vertex], vertex
    if at_left >= 0 and left >= right:
        return CORNER_LEFT, at_left, lo, left
    if at_right >= 0:
        return CORNER_RIGHT, at_right, hi, right
    return NOTHING, -1, 0.0, 0.0
