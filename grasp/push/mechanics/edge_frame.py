"""A part in the frame of the edge that lies on the jaw, and what a jaw that turns up to it meets.

The edge lies on y = 0 with the jaw's face below it and the part above. Where the jaw's right end
pushes, x is mirrored.
"""

from __future__ import annotations

from numba import njit

__all__ = ["LEVEL", "clip", "obstructed", "reach", "to_edge_frame"]

LEVEL = 1e-9
"""Heights and slopes below this, in part radii, count as none."""


@njit(cache=True, nogil=True)
def clip(t0, t1, at, step):  # type: ignore[no-untyped-def]
    """Cut the interval of t to where at + step t > 0."""
    if step == 0.0:
        return (t0, t1) if at > 0.0 else (1.0, 0.0)
    t = -at / step
    if step > 0.0:
        return max(t0, t), t1
    return t0, min(t1, t)


@njit(cache=True, nogil=True)
def obstructed(x, y, n, i0, i1, far, slope):  # type: ignore[no-untyped-def]
    """Return whether an edge other than i0-i1 enters 0 < x < far, -slope x < y < 0."""
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if (y[i] > -LEVEL and y[j] > -LEVEL) or (i == i0 and j == i1) or (i == i1 and j == i0):
            continue
        dx, dy = x[j] - x[i], y[j] - y[i]
        t0, t1 = clip(0.0, 1.0, -LEVEL - y[i], -dy)
        t0, t1 = clip(t0, t1, x[i], dx)
        t0, t1 = clip(t0, t1, far - x[i], -dx)
        t0, t1 = clip(t0, t1, y[i] + slope * x[i] + LEVEL, dy + slope * dx)
        if t0 < t1:
            return True
    return False


@njit(cache=True, nogil=True)
def to_edge_frame(x, y, n, ox, oy, mirror, tx, ty):  # type: ignore[no-untyped-def]
    """Move vertices in place: origin to (ox, oy), mirrored in x, x along (tx, ty)."""
    for i in range(n):
        ax, ay = (x[i] - ox) * mirror, y[i] - oy
        x[i] = ax * tx + ay * ty
        y[i] = -ax * ty + ay * tx


@njit(cache=True, nogil=True)
def reach(x, y, n, i, j):  # type: ignore[no-untyped-def]
    """Return the vertex at the end of the straight boundary on y = 0 from vertex i through j.

    Collinear vertices divide an edge without changing the part.
    """
    step = 1 if (i + 1) % n == j else n - 1
    end = j
    k = (j + step) % n
    while k != i and abs(y[k]) <= LEVEL and (x[k] - x[end]) * (x[end] - x[i]) > 0.0:
        end = k
        k = (k + step) % n
    return end
