"""The conservative test of one grasp on one part (f_alpha and f_gamma of Kehoe 2014, 3.3 and 3.4).

Mason (1986): the sense in which a pushed part turns is the majority of three votes, the two rays of
the friction cone at the contact and the ray of pushing, each by the side on which it passes the
centre of mass. That holds for every distribution of pressure under the part, which is why a success
here is a bound from below.

Lengths are in radii of the part.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grasp.push.mechanics.closure import closes, closes_over, closes_two
from grasp.push.mechanics.contact import CORNER_LEFT, NOTHING, VERTEX, lowest
from grasp.push.mechanics.edge_frame import LEVEL, clip, obstructed, reach, to_edge_frame
from grasp.push.mechanics.rolling import ENDS, LEAVES_JAW, RESTS, SLIPS, roll

__all__ = ["CODES", "INVALID", "UNTRIED", "evaluate", "evaluate_one"]

MISSED, BEHIND, OUTSIDE_CONE, TURNS_AWAY, BEYOND_JAW, BEYOND_EDGE = -1, -2, -3, -4, -5, -6
OBSTRUCTED, TWO_POINT_TIPS, MEETS_EDGE, VERTEX_SLIPS, NO_EDGE = -7, -8, -9, -10, -11
NOT_CLOSED, NOT_CLOSED_TWO, PASS_OFF, INVALID, UNTRIED = -12, -13, -14, -15, -128
SLIP_PUSH, VERTEX_PUSH, TWO_POINT = 10, 20, 30

CODES = {
    1: "zero slip, friction closure",
    2: "zero slip, vertex closure",
    3: "zero slip, slip closure",
    11: "slip, friction closure",
    12: "slip, vertex closure",
    13: "slip, slip closure",
    21: "vertex push, friction closure",
    22: "vertex push, vertex closure",
    23: "vertex push, slip closure",
    31: "two points, friction closure",
    32: "two points, vertex closure",
    MISSED: "the jaw misses the part",
    BEHIND: "centre of mass not in front of the edge",
    OUTSIDE_CONE: "contact outside the friction cone",
    TURNS_AWAY: "the part turns away from the jaw",
    BEYOND_JAW: "centre of mass beyond the jaw's end",
    BEYOND_EDGE: "centre of mass beyond the edge's end",
    OBSTRUCTED: "another feature may be met while slipping or turning",
    TWO_POINT_TIPS: "centre of mass not between two contacts",
    MEETS_EDGE: "the jaw's far corner meets an edge",
    VERTEX_SLIPS: "contact at a vertex slips",
    NO_EDGE: "no edge to align with",
    NOT_CLOSED: "no force closure",
    NOT_CLOSED_TWO: "no force closure on two points",
    PASS_OFF: "pass or kind of push switched off",
    INVALID: "perturbed outline crosses itself",
    41: "simulated, closed",
    -41: "simulated, not held",
    -42: "simulated, lost",
    UNTRIED: "not tried",
}
"""Meaning of the result codes: positive = success."""


@njit(cache=True, nogil=True)
def _first_met(x, y, n, i0, i1, w):  # type: ignore[no-untyped-def]
    """Return what a jaw [0, w] that turns up to y = 0 about the origin meets first.

    Returns
    -------
    Index of a vertex, -1 for nothing, -2 when the jaw's far corner meets an edge.
    """
    steepest, hit = 0.0, -1
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if (y[i] > -LEVEL and y[j] > -LEVEL) or (i == i0 and j == i1) or (i == i1 and j == i0):
            continue
        dx, dy = x[j] - x[i], y[j] - y[i]
        t0, t1 = clip(0.0, 1.0, -LEVEL - y[i], -dy)
        t0, t1 = clip(t0, t1, x[i], dx)
        # Cut to the disc of radius w.
        square = dx * dx + dy * dy
        half = x[i] * dx + y[i] * dy
        root = half * half - square * (x[i] * x[i] + y[i] * y[i] - w * w)
        if root <= 0.0:
            continue
        root = math.sqrt(root)
        t0, t1 = max(t0, (-half - root) / square), min(t1, (-half + root) / square)
        if t0 >= t1:
            continue
        for end in range(2):
            t = t0 if end == 0 else t1
            px, py = x[i] + t * dx, y[i] + t * dy
            if px <= 0.0 or py >= -LEVEL:
                continue
            if -py / px > steepest:
                steepest = -py / px
                hit = -2
                if t == 0.0:
                    hit = i
                elif t == 1.0:
                    hit = j
    # A crossing of y = 0 under the aligned jaw is met by its face or far corner before alignment.
    if hit == -1 and obstructed(x, y, n, i0, i1, w, 1e-6):
        return -2
    return hit


@njit(cache=True, nogil=True)
def _corner_push(x, y, n, mx, my, i, w, bx, by, left, mu, passes, nguyen, tips, facets, scratch):  # type: ignore[no-untyped-def]
    """Pass 1: a corner of the jaw on the edge from vertex ``i`` (Kehoe 2014, 3.4, Fig. 3.5)."""
    j = i + 1 if i + 1 < n else 0
    mirror = 1.0 if left else -1.0
    i0, i1 = (i, j) if (x[j] - x[i]) * mirror > 0.0 else (j, i)
    tx, ty = (x[i1] - x[i0]) * mirror, y[i1] - y[i0]
    length = math.hypot(tx, ty)
    tx, ty = tx / length, ty / length
    # First contact makes the edge rise from the corner; rounding alone can say otherwise.
    slope = max(ty / tx, 0.0)
    cx, cy = (mx - bx) * mirror, my - by
    f, r = cx * tx + cy * ty, -cx * ty + cy * tx
    if r <= 0.0:
        return BEHIND
    if slope > mu:
        return OUTSIDE_CONE
    if f < r * slope:
        return TURNS_AWAY
    to_edge_frame(x, y, n, bx, by, mirror, tx, ty)
    a, e = x[reach(x, y, n, i1, i0)], x[reach(x, y, n, i0, i1)]
    aligned = slope <= LEVEL
    if f > mu * r and not aligned:
        if not passes & 4:
            return PASS_OFF
        if facets[i]:
            return VERTEX_SLIPS
        if f > w:
            return BEYOND_JAW
        if f > e:
            return BEYOND_EDGE
        shift = f - mu * r
        if obstructed(x, y, n, i0, i1, w + shift, slope):
            return OBSTRUCTED
        mode = closes_over(x, y, n, shift, w, a, e, mu, nguyen, scratch)
        return mode + SLIP_PUSH if mode > 0 else NOT_CLOSED
    met = -1 if aligned else _first_met(x, y, n, i0, i1, w)
    if met == -2:
        return MEETS_EDGE
    if met >= 0:
        length = math.hypot(x[met], y[met])
        qx, qy = x[met] / length, y[met] / length
        foot = f * qx + r * qy
        if foot < 0.0 or foot > length:
            return TWO_POINT_TIPS
        psi = math.atan2(-y[met], x[met])
        to_edge_frame(x, y, n, 0.0, 0.0, 1.0, qx, qy)
        mode = closes_two(x, y, n, w, length, psi, mu)
        return mode + TWO_POINT if mode > 0 else NOT_CLOSED_TWO
    if f > w:
        return BEYOND_JAW
    return _rest(x, y, n, i0, i1, a, f, r, 0.0, w, mu, nguyen, tips, facets)


@njit(cache=True, nogil=True)
def _rest(x, y, n, i0, i1, a, f, r, lo, w, mu, nguyen, tips, facets):  # type: ignore[no-untyped-def]
    """Return the result of a push that has brought the edge i0-i1 onto the jaw from ``lo`` on."""
    how, a, e, lo, on_curve = roll(x, y, n, i0, i1, a, f, r, lo, w, mu, tips, facets)
    if how != RESTS:
        if how == ENDS:
            return BEYOND_EDGE
        if how == SLIPS:
            return VERTEX_SLIPS
        return BEYOND_JAW if how == LEAVES_JAW else OBSTRUCTED
    # On a facet of a curve the first contact is a point: a vertical line would ask for its width.
    mode = closes(x, y, n, lo, w, a, e, mu, nguyen or on_curve)
    return mode if mode > 0 else NOT_CLOSED


@njit(cache=True, nogil=True)
def _vertex_push(x, y, n, mx, my, i, lo, hi, mu, nguyen, tips, facets):  # type: ignore[no-untyped-def]
    """Pass 2: the jaw's face on vertex ``i``; the part turns to the side of its centre of mass."""
    bx, by = x[i], y[i]
    side = 1.0 if mx >= bx else -1.0
    f, r = (mx - bx) * side, my - by
    if r <= 0.0:
        return BEHIND
    edge, flattest = n, np.inf
    for k in range(2):
        j = (i + 1 if i + 1 < n else 0) if k == 0 else (i - 1 if i > 0 else n - 1)
        run = (x[j] - bx) * side
        if run > 0.0 and (y[j] - by) / run < flattest:
            edge, flattest = j, (y[j] - by) / run
    if edge == n:
        return NO_EDGE
    tx, ty = (x[edge] - bx) * side, y[edge] - by
    length = math.hypot(tx, ty)
    tx, ty = tx / length, ty / length
    foot, above = f * tx + r * ty, -f * ty + r * tx
    aligned = flattest <= LEVEL
    if not aligned and (f > mu * r or foot < 0.0 or foot > mu * above):
        return VERTEX_SLIPS
    ahead = hi - bx if side > 0.0 else bx - lo
    if foot > ahead:
        return BEYOND_JAW
    to_edge_frame(x, y, n, bx, by, side, tx, ty)
    if not aligned and obstructed(x, y, n, i, edge, ahead, max(flattest, 0.0)):
        return OBSTRUCTED
    w = hi - lo
    mode = _rest(x, y, n, i, edge, 0.0, foot, above, ahead - w, w, mu, nguyen, tips, facets)
    return mode + VERTEX_PUSH if mode > 0 else mode


@njit(cache=True, nogil=True)
def evaluate_one(vx, vy, mx, my, grasp, w, mu, passes, nguyen, tips, facets, x, y, scratch):  # type: ignore[no-untyped-def]
    """Return the result code of a grasp on a part.

    Parameters
    ----------
    vx, vy : (n,) float
        Vertices, counter-clockwise.
    mx, my
        Centre of mass.
    grasp : (5,) float
        Contact x, y; direction of approach x, y; +1 = the jaw's left corner is at the contact, -1 =
        its right corner.
    passes
        1 = edge pushes, 2 = vertex pushes, 4 = pushes that may slip; added up.
    tips, facets : (n,) bool
        Vertices of curves, over which the part may tip on, and edges that are facets of them
        (`grasp.push.curves.Curves`).
    x, y : (n,); scratch : (2 n + 3,) float
        Overwritten.
    """
    n = vx.size
    px, py, dx, dy = grasp[0], grasp[1], grasp[2], grasp[3]
    lo = 0.0 if grasp[4] > 0.0 else -w
    hi = lo + w
    for i in range(n):
        ax, ay = vx[i] - px, vy[i] - py
        x[i] = ax * dy - ay * dx
        y[i] = ax * dx + ay * dy
    cx, cy = (mx - px) * dy - (my - py) * dx, (mx - px) * dx + (my - py) * dy
    kind, i, bx, by = lowest(x, y, n, lo, hi)
    if kind == NOTHING:
        return MISSED
    if kind == VERTEX:
        if not passes & 2:
            return PASS_OFF
        return _vertex_push(x, y, n, cx, cy, i, lo, hi, mu, nguyen, tips, facets)
    if not passes & 1:
        return PASS_OFF
    left = kind == CORNER_LEFT
    return _corner_push(
        x, y, n, cx, cy, i, w, bx, by, left, mu, passes, nguyen, tips, facets, scratch
    )


@njit(cache=True, nogil=True)
def evaluate(vx, vy, com, valid, grasps, w, mu, passes, nguyen, tips, facets, out):  # type: ignore[no-untyped-def]
    """Write the codes of all grasps on all perturbed parts.

    Parameters
    ----------
    vx, vy : (N, n) float
    com : (N, 2) float
    valid : (N,) bool
        Outlines that do not cross themselves; the others count as failures.
    grasps : (g, 5) float
    out : (g, N) int8
    """
    parts, n = vx.shape
    x, y, scratch = np.empty(n), np.empty(n), np.empty(2 * n + 4)
    for k in range(parts):
        for g in range(grasps.shape[0]):
            if not valid[k]:
                out[g, k] = INVALID
                continue
            out[g, k] = evaluate_one(
                vx[k], vy[k], com[k, 0], com[k, 1], grasps[g], w, mu, passes, nguyen, tips,
                facets, x, y, scratch,
            )  # fmt: skip
