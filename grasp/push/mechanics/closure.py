"""Force closure when the second jaw closes (f_beta of Kehoe 2014, 3.3 and 3.4).

Frame of every function: the first jaw's face on y = 0 over [s, s + w], the part above it in contact
over the part's edge [a, e]; the second jaw covers the same window and comes down.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grasp.push.mechanics.contact import CORNER_LEFT, NOTHING, TIE, VERTEX, highest

__all__ = ["FRICTION", "OPEN", "SLIP", "VERTEX_CLOSURE", "closes", "closes_over", "closes_two"]

OPEN, FRICTION, VERTEX_CLOSURE, SLIP = 0, 1, 2, 3
"""Closure modes of Fig. 3.6."""

_LEVEL = 1e-9


@njit(cache=True, nogil=True)
def closes(x, y, n, s, w, a, e, mu, nguyen):  # type: ignore[no-untyped-def]
    """Return the mode of closure with the window at ``s``.

    Parameters
    ----------
    nguyen
        Ask for some contact of the first jaw whose line to the second contact lies in both friction
        cones (Nguyen 1988) instead of a vertical line.
    """
    lo, hi = s, s + w
    c1, c2 = max(a, lo), min(e, hi)
    kind, i, x2, y2 = highest(x, y, n, lo, hi)
    if kind == NOTHING or c2 < c1:
        return OPEN
    slope = 0.0
    j = i + 1 if i + 1 < n else 0
    if kind != VERTEX:
        slope = (y[j] - y[i]) / (x[j] - x[i])
    mode = VERTEX_CLOSURE if kind == VERTEX else FRICTION
    if nguyen:
        if _some_line(x2, y2, c1, c2, slope, mu):
            return mode
    elif abs(slope) <= mu:
        if c1 - TIE <= x2 <= c2 + TIE or _flush(x, y, n, lo, hi, y2, c1, c2):
            return mode
        return OPEN
    if abs(slope) > mu and c1 <= x2 <= c2:
        return _slips_shut(x, y, n, kind == CORNER_LEFT, i, j, lo, w, a, e, mu)
    return OPEN


@njit(cache=True, nogil=True)
def _some_line(x2, y2, c1, c2, slope, mu):  # type: ignore[no-untyped-def]
    """Return whether some line from [c1, c2] on y = 0 to (x2, y2) is inside both cones."""
    if y2 <= 0.0:
        return False
    cone = math.atan(mu)
    tilt = math.atan(-slope)
    low = max(-cone, tilt - cone, math.atan2(x2 - c2, y2))
    high = min(cone, tilt + cone, math.atan2(x2 - c1, y2))
    return low <= high


@njit(cache=True, nogil=True)
def _flush(x, y, n, lo, hi, top, c1, c2):  # type: ignore[no-untyped-def]
    """Return whether a level edge under the second jaw reaches over [c1, c2]."""
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if abs(y[i] - top) <= TIE and abs(y[j] - top) <= TIE:
            left, right = max(min(x[i], x[j]), lo), min(max(x[i], x[j]), hi)
            if left <= right and left <= c2 and right >= c1:
                return True
    return False


@njit(cache=True, nogil=True)
def _is_straight(x, y, i, j, k):  # type: ignore[no-untyped-def]
    """Return whether vertex k continues the line from i to j."""
    ax, ay, bx, by = x[j] - x[i], y[j] - y[i], x[k] - x[j], y[k] - y[j]
    return abs(ax * by - ay * bx) <= _LEVEL * math.hypot(ax, ay) and ax * bx + ay * by > 0.0


@njit(cache=True, nogil=True)
def _slips_shut(x, y, n, left, i, j, lo, w, a, e, mu):  # type: ignore[no-untyped-def]
    """Return SLIP when the corner on the steep edge i-j comes to rest against the edge below it.

    The corner runs down the edge, the window with it, until it lies in the notch at the edge's
    lower vertex q or another feature stops it; there the second jaw must close (Kehoe 2014, 3.4,
    third condition). One slip only.
    """
    if y[j] < y[i]:
        top, q, step = i, j, 1
    else:
        top, q, step = j, i, n - 1
    beyond = (q + step) % n
    # Collinear vertices divide the steep edge without ending it.
    while beyond != top and y[beyond] < y[q] and _is_straight(x, y, top, q, beyond):
        q, beyond = beyond, (beyond + step) % n
    foot = x[q]
    inwards = x[beyond] - foot if left else foot - x[beyond]
    if foot <= lo or foot >= lo + w or inwards <= 0.0:
        return OPEN
    if abs(y[beyond] - y[q]) > mu * inwards:
        return OPEN
    moved = foot if left else foot - w
    # Where the first jaw goes with the window it must meet nothing else.
    for k in range(n):
        m = k + 1 if k + 1 < n else 0
        if (y[k] < -_LEVEL) != (y[m] < -_LEVEL):
            at = x[k] + (x[m] - x[k]) * (-_LEVEL - y[k]) / (y[m] - y[k])
            if moved < at < moved + w:
                return OPEN
    kind, _, x2, peak = highest(x, y, n, moved, moved + w)
    if kind == NOTHING:
        return OPEN
    if peak > y[q] + _LEVEL:
        return _stopped(x, y, n, left, y[q], kind == VERTEX, x2, lo, moved, w, a, e, mu)
    return SLIP if max(a, moved) <= foot <= min(e, moved + w) else OPEN


@njit(cache=True, nogil=True)
def _stopped(x, y, n, left, floor, by_vertex, x2, lo, moved, w, a, e, mu):  # type: ignore[no-untyped-def]
    """Return SLIP when the feature that stops a slip before the notch closes the grasp.

    The window stops somewhere between ``lo`` and ``moved``; what follows must hold for all of it,
    and only one feature may rise above ``floor``.
    """
    far, far_moved = (lo + w, moved + w) if left else (lo, moved)
    low, high = max(a, lo, moved), min(e, lo + w, moved + w)
    rising = 0
    for k in range(n):
        if moved < x[k] < moved + w and y[k] > floor + _LEVEL:
            rising += 1
    height, slope = _top_at(x, y, n, far)
    height_moved, slope_moved = _top_at(x, y, n, far_moved)
    if by_vertex:
        alone = rising == 1 and height_moved <= floor + _LEVEL
        return SLIP if alone and low <= x2 <= high and lo < x2 < lo + w else OPEN
    same = height > -np.inf and slope == slope_moved
    within = a <= min(far, far_moved) and max(far, far_moved) <= e
    return SLIP if rising == 0 and same and abs(slope) <= mu and within else OPEN


@njit(cache=True, nogil=True)
def closes_two(x, y, n, w, length, psi, mu):  # type: ignore[no-untyped-def]
    """Return the mode when the first jaw holds two points: its corner at 0, a vertex at ``length``.

    Parameters
    ----------
    psi
        Angle by which the edge at the corner rises from the jaw, rad. Its normal, not the jaw's,
        counts there; at the vertex the jaw's normal counts.
    """
    kind, i, x2, y2 = highest(x, y, n, 0.0, w)
    if kind == NOTHING or y2 <= 0.0 or x2 < 0.0 or x2 > length:
        return OPEN
    tilt = 0.0
    if kind != VERTEX:
        j = i + 1 if i + 1 < n else 0
        tilt = math.atan(-(y[j] - y[i]) / (x[j] - x[i]))
    cone = math.atan(mu)
    corner, vertex = math.atan2(x2, y2), math.atan2(x2 - length, y2)
    held = (abs(corner + psi) <= cone and abs(corner - tilt) <= cone) or (
        abs(vertex) <= cone and abs(vertex - tilt) <= cone
    )
    if not held:
        return OPEN
    return VERTEX_CLOSURE if kind == VERTEX else FRICTION


@njit(cache=True, nogil=True)
def _top_at(x, y, n, at):  # type: ignore[no-untyped-def]
    """Return height and slope of the upper boundary at x = ``at``; -inf beside the part."""
    best, slope = -np.inf, 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if (x[i] < at) != (x[j] < at):
            k = (y[j] - y[i]) / (x[j] - x[i])
            h = y[i] + (at - x[i]) * k
            if h > best:
                best, slope = h, k
    return best, slope


@njit(cache=True, nogil=True)
def _meeting(height, slope, other, other_slope, low, high):  # type: ignore[no-untyped-def]
    """Return where two heights, given at the middle of (low, high), are equal; else ``low``."""
    if height == -np.inf or other == -np.inf or slope == other_slope:
        return low
    at = (low + high) / 2 + (other - height) / (slope - other_slope)
    return at if low < at < high else low


@njit(cache=True, nogil=True)
def _sort(values, count):  # type: ignore[no-untyped-def]
    """Sort the first few numbers in place; NumPy's sort takes seconds to compile."""
    for i in range(1, count):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value


@njit(cache=True, nogil=True)
def closes_over(x, y, n, shift, w, a, e, mu, nguyen, breaks):  # type: ignore[no-untyped-def]
    """Return the mode at 0 when every window position in [0, shift] closes, else OPEN.

    Closure is constant between the positions where a vertex enters or leaves the window, the jaw's
    end passes the edge's end, or another feature becomes the highest; one position of each piece
    decides.

    Parameters
    ----------
    breaks : (>= 2 n + 3,) float
        Scratch.
    """
    mode = closes(x, y, n, 0.0, w, a, e, mu, nguyen)
    if mode == OPEN or closes(x, y, n, shift, w, a, e, mu, nguyen) == OPEN:
        return OPEN
    breaks[0], breaks[1], m = 0.0, shift, 2
    if 0.0 < e - w < shift:
        breaks[m] = e - w
        m += 1
    for i in range(n):
        if 0.0 < x[i] < shift:
            breaks[m] = x[i]
            m += 1
        if 0.0 < x[i] - w < shift:
            breaks[m] = x[i] - w
            m += 1
    _sort(breaks, m)
    inner = np.empty(5)
    for g in range(m - 1):
        low, high = breaks[g], breaks[g + 1]
        if high - low < TIE:
            continue
        middle = (low + high) / 2
        left, left_slope = _top_at(x, y, n, middle)
        right, right_slope = _top_at(x, y, n, middle + w)
        peak = -np.inf
        for i in range(n):
            if middle < x[i] < middle + w and y[i] > peak:
                peak = y[i]
        inner[0], inner[4] = low, high
        inner[1] = _meeting(left, left_slope, right, right_slope, low, high)
        inner[2] = _meeting(left, left_slope, peak, 0.0, low, high)
        inner[3] = _meeting(right, right_slope, peak, 0.0, low, high)
        _sort(inner, inner.size)
        for k in range(4):
            if inner[k + 1] - inner[k] < TIE:
                continue
            # With inclined lines closure can change inside a piece: look at more of it.
            for part in range(1, 8 if nguyen else 2):
                at = inner[k] + (inner[k + 1] - inner[k]) * part / (8 if nguyen else 2)
                if closes(x, y, n, at, w, a, e, mu, nguyen) == OPEN:
                    return OPEN
    return mode
