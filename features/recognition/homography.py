"""How many matches of two images agree on one homography.

Random samples of four (Fischler and Bolles 1981). Who only asks whether at least so many agree
need not draw as often as who knows nothing: the number of draws follows from that question. A
sample whose corners turn differently in the two images is dropped before anything is measured,
and a good one is fitted again to what agrees within a wider, then narrower reach (Chum 2003).
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

__all__ = ["count_agreeing"]

Points = NDArray[np.float64]

_MISSED = 0.0001
"""Chance that no sample of a homography which enough agree on is drawn."""

_MAX_DRAWS = 2000
_REACHES = (3.0, 2.0, 1.4, 1.0)
"""Within how many tolerances matches are fitted again, round by round; the last is repeated."""

_ROUNDS = 8
_SLACK = 8
"""A sample is fitted again if at most so many fewer agree than on the best before."""

_MIN_TURN = 20.0
"""Twice the area of three corners, in square pixels, below which they lie on a line."""

_CENTRE, _SCALE = 256.0, 256.0
"""Of coordinates while fitting: pixels squared and multiplied would drown the ones beside them."""


def count_agreeing(
    source: NDArray[np.floating], target: NDArray[np.floating], least: int, tolerance_px: float
) -> int:
    """Return how many matches agree on one homography, if enough do.

    Parameters
    ----------
    source, target : (n, 2), px
        Places that match, of images with some hundreds of pixels a side.
    least
        What counts as enough, at least 5. The answer is exact only in this: where at least so
        many agree, a number as high is returned with a chance of .9999 for a noiseless map.
    tolerance_px
        How far from its place a point may be mapped, in the target image.

    Returns
    -------
    int
        0 where fewer than ``least`` match at all; may lie below ``least``.

    Raises
    ------
    ValueError
        If ``least`` is below 5: any four agree.

    Examples
    --------
    >>> places = np.random.default_rng(0).uniform(0, 400, (30, 2))
    >>> moved = places @ [[0.9, 0.1], [-0.1, 0.9]] + 20
    >>> moved[20:] += 50
    >>> moved[25:] += 30
    >>> count_agreeing(places, moved, 15, 2.0)
    20
    """
    if least < 5:
        raise ValueError(f"least is {least}; any four matches agree, so it must be 5 or more")
    if len(source) < least:
        return 0
    return int(
        _consensus(
            np.ascontiguousarray(source, np.float64),
            np.ascontiguousarray(target, np.float64),
            *(least, tolerance_px**2),
        )
    )


@nb.njit(cache=True, nogil=True)
def _consensus(source: Points, target: Points, least: int, tolerance: float) -> int:
    n = len(source)
    left, right = np.empty((3, 3)), np.empty((3, 3))
    mapping, fitted = np.empty((3, 3)), np.empty((3, 3))
    system, corners = np.empty((8, 9)), np.empty(4, np.int64)
    best, draw, draws = 0, 0, _draws(least / n)
    state = np.uint64(0x9E3779B97F4A7C15)  # the same draws in every call
    while draw < draws:
        draw += 1
        state = _draw_four(state, n, corners)
        if not _turn_alike(source, target, corners):
            continue
        _from_unit_square(source, corners, left)
        _from_unit_square(target, corners, right)
        _compose(left, right, mapping)
        agreed = _agreeing(mapping, source, target, tolerance)
        if agreed >= 5 and agreed >= best - _SLACK:
            for round_ in range(_ROUNDS):
                reach = _REACHES[min(round_, len(_REACHES) - 1)]
                if not _fit(mapping, source, target, reach * reach * tolerance, system, fitted):
                    break
                count = _agreeing(fitted, source, target, tolerance)
                if count <= agreed and round_ >= len(_REACHES):
                    break
                agreed = max(agreed, count)
                mapping[:] = fitted
        if agreed > best:
            best = agreed
            draws = min(draws, _draws(max(best, least) / n))
    return best


@nb.njit(cache=True, nogil=True)
def _draws(share: float) -> int:
    """Return how many samples of four hold one of only agreeing matches, but for ``_MISSED``."""
    good = share**4
    if good >= 1.0:
        return 1
    return min(_MAX_DRAWS, int(math.log(_MISSED) / math.log(1.0 - good)) + 1)


@nb.njit(cache=True, nogil=True)
def _draw_four(state: np.uint64, n: int, corners: NDArray[np.int64]) -> np.uint64:
    """Write four different numbers below n, and return the generator's next state (xorshift64)."""
    drawn = 0
    while drawn < 4:
        state ^= state << np.uint64(13)
        state ^= state >> np.uint64(7)
        state ^= state << np.uint64(17)
        number = np.int64((state >> np.uint64(33)) % np.uint64(n))
        is_new = True
        for k in range(drawn):
            is_new = is_new and corners[k] != number
        if is_new:
            corners[drawn] = number
            drawn += 1
    return state


@nb.njit(cache=True, nogil=True, inline="always")
def _turn(points: Points, a: int, b: int, c: int) -> Any:
    return (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
        points[b, 1] - points[a, 1]
    ) * (points[c, 0] - points[a, 0])


@nb.njit(cache=True, nogil=True)
def _turn_alike(source: Points, target: Points, corners: NDArray[np.int64]) -> bool:
    """Whether no three corners lie on a line, and all threes turn alike in both images.

    A camera before a plane sees it from one side: no homography between two views turns three
    points the other way (Marquez-Neila 2015).
    """
    for k in range(4):
        a, b, c = corners[k], corners[(k + 1) & 3], corners[(k + 2) & 3]
        here, there = _turn(source, a, b, c), _turn(target, a, b, c)
        if abs(here) < _MIN_TURN or abs(there) < _MIN_TURN or (here > 0) != (there > 0):
            return False
    return True


@nb.njit(cache=True, nogil=True)
def _from_unit_square(points: Points, corners: NDArray[np.int64], mapping: Points) -> None:
    """Write the map of the unit square's corners to four points (Heckbert 1989, 2.2.2)."""
    a, b, c, d = corners[0], corners[1], corners[2], corners[3]
    x0, x1, x2, x3 = points[a, 0], points[b, 0], points[c, 0], points[d, 0]
    y0, y1, y2, y3 = points[a, 1], points[b, 1], points[c, 1], points[d, 1]
    sum_x, sum_y = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    dx1, dx2, dy1, dy2 = x1 - x2, x3 - x2, y1 - y2, y3 - y2
    turn = dx1 * dy2 - dx2 * dy1  # not 0: no three lie on a line
    g, h = (sum_x * dy2 - dx2 * sum_y) / turn, (dx1 * sum_y - sum_x * dy1) / turn
    mapping[0, 0], mapping[0, 1], mapping[0, 2] = x1 - x0 + g * x1, x3 - x0 + h * x3, x0
    mapping[1, 0], mapping[1, 1], mapping[1, 2] = y1 - y0 + g * y1, y3 - y0 + h * y3, y0
    mapping[2, 0], mapping[2, 1], mapping[2, 2] = g, h, 1.0


@nb.njit(cache=True, nogil=True)
def _compose(left: Points, right: Points, mapping: Points) -> None:
    """Write ``right`` after the inverse of ``left``, up to scale: its adjugate serves."""
    for column in range(3):
        i, j = (column + 1) % 3, (column + 2) % 3
        first = left[1, i] * left[2, j] - left[1, j] * left[2, i]
        second = left[2, i] * left[0, j] - left[2, j] * left[0, i]
        third = left[0, i] * left[1, j] - left[0, j] * left[1, i]
        left_row = (first, second, third)
        for k in range(3):
            if column == 0:
                mapping[0, k] = mapping[1, k] = mapping[2, k] = 0.0
            for row in range(3):
                mapping[row, k] += right[row, column] * left_row[k]


@nb.njit(cache=True, nogil=True, inline="always")
def _agrees(mapping: Points, source: Points, target: Points, k: int, tolerance: float) -> Any:
    x, y = source[k, 0], source[k, 1]
    weight = mapping[2, 0] * x + mapping[2, 1] * y + mapping[2, 2]
    across = mapping[0, 0] * x + mapping[0, 1] * y + mapping[0, 2] - weight * target[k, 0]
    down = mapping[1, 0] * x + mapping[1, 1] * y + mapping[1, 2] - weight * target[k, 1]
    return across * across + down * down <= tolerance * weight * weight


@nb.njit(cache=True, nogil=True)
def _agreeing(mapping: Points, source: Points, target: Points, tolerance: float) -> int:
    count = 0
    for k in range(len(source)):
        count += 1 if _agrees(mapping, source, target, k, tolerance) else 0
    return count


@nb.njit(cache=True, nogil=True)
def _normal_equations(sums: Points, system: Points) -> None:
    """Fill in the normal equations (8, 9) of a homography.

    Each match gives two equations, of which most factors are 0 or the same: sums of xx, xy, yy, x,
    y and 1, weighted by 1, u, v and uu + vv, are all that they hold.
    """
    rows = ((0, 1, 3), (1, 2, 4), (3, 4, 5))  # where the products of x, y and 1 stand in the sums
    system[:] = 0.0
    for i in range(3):
        for j in range(3):
            system[i, j] = system[3 + i, 3 + j] = sums[0, rows[i][j]]
        for j in range(2):
            system[i, 6 + j] = system[6 + j, i] = -sums[1, rows[i][j]]
            system[3 + i, 6 + j] = system[6 + j, 3 + i] = -sums[2, rows[i][j]]
        system[i, 8], system[3 + i, 8] = sums[1, rows[i][2]], sums[2, rows[i][2]]
    for i in range(2):
        for j in range(2):
            system[6 + i, 6 + j] = sums[3, rows[i][j]]
        system[6 + i, 8] = -sums[3, rows[i][2]]


@nb.njit(cache=True, nogil=True)
def _fit(
    mapping: Points,
    source: Points,
    target: Points,
    tolerance: float,
    system: Points,
    fitted: Points,
) -> bool:
    """Write the homography of least algebraic error over what agrees with ``mapping``.

    ``system`` (8, 9) is scratch for the normal equations, solved by elimination.
    """
    used = 0
    sums = np.zeros((4, 6))
    for k in range(len(source)):
        if not _agrees(mapping, source, target, k, tolerance):
            continue
        used += 1
        x, y = (source[k, 0] - _CENTRE) / _SCALE, (source[k, 1] - _CENTRE) / _SCALE
        u, v = (target[k, 0] - _CENTRE) / _SCALE, (target[k, 1] - _CENTRE) / _SCALE
        products = (x * x, x * y, y * y, x, y, 1.0)
        weights = (1.0, u, v, u * u + v * v)
        for a in range(4):
            for b in range(6):
                sums[a, b] += weights[a] * products[b]
    if used < 5:
        return False
    _normal_equations(sums, system)
    for a in range(8):
        if system[a, a] < 1e-9:  # positive definite but for points on a line
            return False
        for b in range(a + 1, 8):
            factor = system[b, a] / system[a, a]
            for c in range(a, 9):
                system[b, c] -= factor * system[a, c]
    for a in range(7, -1, -1):
        total = system[a, 8]
        for b in range(a + 1, 8):
            total -= system[a, b] * fitted[b // 3, b % 3]
        fitted[a // 3, a % 3] = total / system[a, a]
    fitted[2, 2] = 1.0
    for row in range(3):  # back from centred coordinates of the source …
        shift = (fitted[row, 0] + fitted[row, 1]) * _CENTRE / _SCALE
        fitted[row, 0] /= _SCALE
        fitted[row, 1] /= _SCALE
        fitted[row, 2] -= shift
    for column in range(3):  # … and of the target
        fitted[0, column] = _SCALE * fitted[0, column] + _CENTRE * fitted[2, column]
        fitted[1, column] = _SCALE * fitted[1, column] + _CENTRE * fitted[2, column]
    return True
