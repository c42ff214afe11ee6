"""Curves on a jaw: they roll on it instead of ending at every facet.

Each facet of a curve, taken for a flat side, would have to hold the centre of mass above itself
and a vertical line to the other jaw: the more finely a curve is drawn, the less its grasps would
be worth. Here the part tips from facet to facet, as long as it sticks at the vertex in between,
until the centre of mass lies above the facet that it rests on. For a smooth curve that is the
next minimum of the distance to the centre of mass in the sense of rotation.
"""

from __future__ import annotations

import math

from numba import njit

from grasp.push.mechanics.edge_frame import LEVEL, obstructed, reach, to_edge_frame

__all__ = ["ENDS", "LEAVES_JAW", "MEETS", "RESTS", "SLIPS", "roll"]

RESTS, ENDS, SLIPS, LEAVES_JAW, MEETS = 0, 1, 2, 3, 4
"""How rolling ends: at rest; at a corner; by slipping; at the jaw's end; at another feature."""


@njit(cache=True, nogil=True)
def roll(x, y, n, i, j, a, f, r, lo, w, mu, tips, facets):  # type: ignore[no-untyped-def]
    """Let a part that lies on the edge i-j tip over vertices of a curve until it is at rest.

    Parameters
    ----------
    x, y : (n,) float
        In the frame of the edge, x from i to j; moved into that of the edge it comes to rest on.
    a
        Where the straight side that the edge belongs to begins.
    f, r
        Centre of mass along the edge and above it.
    lo, w
        Where the jaw begins, and its width.
    tips, facets : (n,) bool
        Vertices of curves, and edges that are facets of them (`grasp.push.curves.Curves`).

    Returns
    -------
    How it ends (`RESTS` ..); in the frame of the last edge, where its side begins and ends and
    where the jaw begins; whether the edge is a facet of a curve.
    """
    step = 1 if (i + 1) % n == j else n - 1
    for _ in range(n):
        on_curve = facets[i if step == 1 else j]
        j = reach(x, y, n, i, j)
        if f <= x[j]:
            return RESTS, a, x[j], lo, on_curve
        if not tips[j]:
            return ENDS, a, x[j], lo, on_curve
        k = (j + step) % n
        ox, oy = x[j], y[j]
        dx, dy = x[k] - ox, y[k] - oy
        # A deviation may bend a curve inwards: the jaw then meets the next facet, not its vertex.
        if dx <= 0.0 or dy < -LEVEL:
            return MEETS, a, ox, lo, on_curve
        length = math.hypot(dx, dy)
        tx, ty = dx / length, dy / length
        f -= ox
        if f > mu * r:
            return SLIPS, a, ox, lo, on_curve
        f, r = f * tx + r * ty, -f * ty + r * tx
        a, lo = 0.0, lo - ox
        if f > mu * r:
            return SLIPS, a, length, lo, on_curve
        if f > lo + w:
            return LEAVES_JAW, a, length, lo, on_curve
        to_edge_frame(x, y, n, ox, oy, 1.0, tx, ty)
        if obstructed(x, y, n, j, k, lo + w, ty / tx):
            return MEETS, a, length, lo, on_curve
        i, j = j, k
    return LEAVES_JAW, a, x[j], lo, False
