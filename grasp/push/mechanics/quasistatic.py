"""Quasi-static simulation of a push grasp (Kehoe 2014, 3.8; after Dogar and Srinivasa 2010).

Inertia is negligible: the part moves only as far as the jaws push it. The support's friction enters
through its limit surface (Goyal, Ruina and Papadopoulos 1991), here either an ellipsoid, for which
the motion is proportional to (force x, force y, moment / c^2), or the exact surface of friction at
a few points that carry the weight. Both are contact problems in displacements, solved by projected
Gauss-Seidel with an inverse mass matrix; for points the matrix is found by iteration, each point
resisting with its weight over its speed.

Only the relative motion of part and jaws means anything. Lengths are in one unit, usually radii.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grasp.push.mechanics.contact import NOTHING, highest, lowest

__all__ = ["CLOSED", "LOST", "NOT_HELD", "NO_POINTS", "simulate", "simulate_on_points"]

CLOSED, NOT_HELD, LOST, INVALID = 41, -41, -42, -15

NO_POINTS = np.zeros((0, 3))
"""Supports of an ellipsoidal limit surface."""

_MOST = 32
_STILL_STEPS, _JAMMED_STEPS = 5, 40
_POINT_ROUNDS = 12


@njit(cache=True, nogil=True)
def _corner_edge(px, py, n, x, y, up, near):  # type: ignore[no-untyped-def]
    """Return the edge that a jaw's corner meets and the corner's depth behind it.

    The jaw moves along y, so the edge is the one that the corner's vertical path crosses: the next
    one ahead of a corner outside, the last one behind a corner that entered within ``near``. A
    corner deeper inside was met from the side; there the nearest edge counts.

    Returns
    -------
    Index of the edge or -1, and the depth, negative outside.
    """
    behind, ahead = np.inf, np.inf
    entered, next_edge, passed = -1, -1, 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if (px[i] < x) == (px[j] < x):
            continue
        gap = (py[i] + (x - px[i]) / (px[j] - px[i]) * (py[j] - py[i]) - y) * up
        if gap > 0.0:
            if gap < ahead:
                ahead, next_edge = gap, i
        else:
            passed += 1
            if -gap < behind:
                behind, entered = -gap, i
    at = next_edge
    if passed % 2:
        at = entered if behind <= near else _nearest_edge(px, py, n, x, y, up)
    if at < 0:
        return -1, 0.0
    j = at + 1 if at + 1 < n else 0
    ex, ey = px[j] - px[at], py[j] - py[at]
    return at, ((y - py[at]) * ex - (x - px[at]) * ey) / math.hypot(ex, ey)


@njit(cache=True, nogil=True)
def _nearest_edge(px, py, n, x, y, up):  # type: ignore[no-untyped-def]
    """Return the nearest edge with a foot of (x, y) if it faces the jaw, else -1."""
    nearest, at = np.inf, -1
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        ex, ey = px[j] - px[i], py[j] - py[i]
        t = ((x - px[i]) * ex + (y - py[i]) * ey) / (ex * ex + ey * ey)
        if 0.0 < t < 1.0:
            gap = math.hypot(x - px[i] - t * ex, y - py[i] - t * ey)
            if gap < nearest:
                nearest, at = gap, i
    if at < 0:
        return -1
    return at if (px[at + 1 if at + 1 < n else 0] - px[at]) * up > 0.0 else -1


@njit(cache=True, nogil=True)
def _jaw_contacts(px, py, n, lo, hi, face, up, speed, skin, c, m):  # type: ignore[no-untyped-def]
    """Append the contacts of one jaw to ``c``; return how many there are now.

    Parameters
    ----------
    face, up
        Height of the jaw's face; +1 = it moves up.
    speed
        How far the face moved in this step; levers are those from before it did.
    c : (_MOST, 6)
        Rows: x, y, inward normal x, y, penetration, jaw (``up``).
    """
    w = hi - lo
    near = 3.0 * skin
    for i in range(n):
        if lo < px[i] < hi:
            gap = (py[i] - face) * up
            # Deep inside the jaw's end its corner, not its face, is the contact.
            inside = min(px[i] - lo, hi - px[i])
            if -0.6 * w < gap < skin and (gap >= -near or inside >= -0.5 * gap) and m < _MOST:
                c[m, 0], c[m, 1], c[m, 2], c[m, 3] = px[i], py[i], 0.0, up
                c[m, 4], c[m, 5] = -gap, up
                m += 1
    for k in range(2):
        x = lo if k == 0 else hi
        at, depth = _corner_edge(px, py, n, x, face, up, near)
        if at < 0 or not -skin < depth < 0.5 * w or m >= _MOST:
            continue
        j = at + 1 if at + 1 < n else 0
        ex, ey = px[j] - px[at], py[j] - py[at]
        length = math.hypot(ex, ey)
        c[m, 0], c[m, 1], c[m, 2], c[m, 3] = x, face - speed, -ey / length, ex / length
        c[m, 4], c[m, 5] = depth, up
        m += 1
    return m


@njit(cache=True, nogil=True)
def _relax(c, m, mx, my, w, mu, up_speed, down_speed, slop, tolerance, lam, lat, row, d):  # type: ignore[no-untyped-def]
    """Write the least displacement ``d`` that resolves the contacts, friction clamped to its cone.

    Parameters
    ----------
    w : (3, 3)
        Inverse mass matrix.
    lam, lat : (_MOST,)
        Normal and tangential multipliers; written.
    row : (_MOST, 12)
        Scratch: levers, responses and stiffnesses of both directions of a contact.
    """
    d[0], d[1], d[2] = 0.0, 0.0, 0.0
    for q in range(m):
        rx, ry = c[q, 0] - mx, c[q, 1] - my
        lam[q], lat[q] = 0.0, 0.0
        for side in range(2):
            jx, jy = (c[q, 2], c[q, 3]) if side == 0 else (-c[q, 3], c[q, 2])
            jr = rx * jy - ry * jx
            o = 6 * side
            row[q, o] = jr
            stiffness = 0.0
            for k in range(3):
                response = w[k, 0] * jx + w[k, 1] * jy + w[k, 2] * jr
                row[q, o + 1 + k] = response
                stiffness += response * (jx if k == 0 else (jy if k == 1 else jr))
            row[q, o + 4] = stiffness
    for _ in range(30 if m > 1 else 12):
        change = 0.0
        for q in range(m):
            nx, ny = c[q, 2], c[q, 3]
            gap = slop - c[q, 4] + d[0] * nx + d[1] * ny + d[2] * row[q, 0]
            new = max(lam[q] - gap / row[q, 4], 0.0)
            step = new - lam[q]
            lam[q] = new
            for k in range(3):
                d[k] += step * row[q, 1 + k]
            speed = up_speed if c[q, 5] > 0.0 else down_speed
            slide = -d[0] * ny + d[1] * nx + d[2] * row[q, 6] - speed * nx
            limit = mu * lam[q]
            new = min(max(lat[q] - slide / row[q, 10], -limit), limit)
            turn = new - lat[q]
            lat[q] = new
            for k in range(3):
                d[k] += turn * row[q, 7 + k]
            change = max(change, abs(step) * row[q, 4], abs(turn) * row[q, 10])
        if change < tolerance:
            break


@njit(cache=True, nogil=True)
def _point_matrix(points, c, s, d, floor, w):  # type: ignore[no-untyped-def]
    """Write the inverse of the resistance of weighted points that move by ``d``.

    A point with weight N and speed v resists with N / v, so that its force has the size of its
    friction whatever the speed.
    """
    a00, a02, a12, a22 = 0.0, 0.0, 0.0, 0.0
    for k in range(points.shape[0]):
        x = c * points[k, 0] - s * points[k, 1]
        y = s * points[k, 0] + c * points[k, 1]
        speed = math.hypot(d[0] - d[2] * y, d[1] + d[2] * x)
        g = points[k, 2] / (speed + floor)
        a00 += g
        a02 -= g * y
        a12 += g * x
        a22 += g * (x * x + y * y)
    det = a00 * (a00 * a22 - a02 * a02 - a12 * a12)
    w[0, 0] = (a00 * a22 - a12 * a12) / det
    w[0, 1] = w[1, 0] = a02 * a12 / det
    w[1, 1] = (a00 * a22 - a02 * a02) / det
    w[0, 2] = w[2, 0] = -a00 * a02 / det
    w[1, 2] = w[2, 1] = -a00 * a12 / det
    w[2, 2] = a00 * a00 / det
    scale = 2.0 / (w[0, 0] + w[1, 1])
    for i in range(3):
        for j in range(3):
            w[i, j] *= scale


@njit(cache=True, nogil=True)
def _held(c, lam, m, mu):  # type: ignore[no-untyped-def]
    """Return whether two loaded contacts across the jaws pass Nguyen's planar test (Nguyen 1988).

    Where a jaw is flush with an edge, the point of it opposite the other contact is one, too.
    """
    cone = 1.0 / math.sqrt(1.0 + mu * mu) - 1e-6
    for p in range(m):
        if lam[p] <= 0.0:
            continue
        left = right = c[p, 0]
        for k in range(m):
            # Contacts of one face with vertices have its normal; what is between them is flush.
            if lam[k] > 0.0 and c[k, 5] == c[p, 5] and c[k, 2] == 0.0 and c[p, 2] == 0.0:
                left, right = min(left, c[k, 0]), max(right, c[k, 0])
        for q in range(m):
            if lam[q] <= 0.0 or c[q, 5] == c[p, 5]:
                continue
            for place in range(2):
                x = c[p, 0] if place == 0 else min(max(c[q, 0], left), right)
                lx, ly = c[q, 0] - x, c[q, 1] - c[p, 1]
                length = math.hypot(lx, ly)
                if length < 1e-12:
                    continue
                first = (lx * c[p, 2] + ly * c[p, 3]) / length
                second = -(lx * c[q, 2] + ly * c[q, 3]) / length
                if first >= cone and second >= cone:
                    return True
    return False


@njit(cache=True, nogil=True)
def simulate_trial(vx, vy, mx0, my0, grasp, w, mu, c2, diameter, step, points, body, scratch):  # type: ignore[no-untyped-def]
    """Return CLOSED, NOT_HELD or LOST for one grasp on one part.

    Parameters
    ----------
    vx, vy : (n,); mx0, my0; grasp : (5,)
        As for the conservative test.
    c2
        Squared ratio of largest moment to largest force of an ellipsoidal limit surface.
    points : (k, 3)
        Supports relative to the centre of mass with weights that sum to 1; none = ellipsoid.
    body : (4, n), scratch : (_MOST, 20)
        Overwritten.
    """
    n = vx.size
    gx, gy, dx, dy = grasp[0], grasp[1], grasp[2], grasp[3]
    lo = 0.0 if grasp[4] > 0.0 else -w
    hi = lo + w
    bx, by, px, py = body[0], body[1], body[2], body[3]
    contacts, lam, lat, row = scratch[:, :6], scratch[:, 6], scratch[:, 7], scratch[:, 8:]
    mx, my = (mx0 - gx) * dy - (my0 - gy) * dx, (mx0 - gx) * dx + (my0 - gy) * dy
    for i in range(n):
        px[i] = (vx[i] - gx) * dy - (vy[i] - gy) * dx
        py[i] = (vx[i] - gx) * dx + (vy[i] - gy) * dy
        bx[i], by[i] = px[i] - mx, py[i] - my
    kind, _, _, face = lowest(px, py, n, lo, hi)
    if kind == NOTHING:
        return LOST
    feet = points.shape[0]
    local = np.empty((feet, 3))
    for k in range(feet):
        local[k, 0] = points[k, 0] * dy - points[k, 1] * dx
        local[k, 1] = points[k, 0] * dx + points[k, 1] * dy
        local[k, 2] = points[k, 2]
    mass = np.zeros((3, 3))
    mass[0, 0], mass[1, 1], mass[2, 2] = 1.0, 1.0, 1.0 / c2
    d, before = np.zeros(3), np.zeros(3)
    lever = math.sqrt(c2)
    other, closing = 1e9, False
    turn, travel, still, jammed = 0.0, 0.0, 0, 0
    skin, slop = 2.0 * step, 0.02 * step
    for _ in range(int(6.0 * diameter / step) + 100):
        if closing:
            other -= step
        else:
            face += step
            travel += step
        c, s = math.cos(turn), math.sin(turn)
        for i in range(n):
            px[i], py[i] = c * bx[i] - s * by[i] + mx, s * bx[i] + c * by[i] + my
        up, down = (0.0, -step) if closing else (step, 0.0)
        m = _jaw_contacts(px, py, n, lo, hi, face, 1.0, up, skin, contacts, 0)
        if closing:
            m = _jaw_contacts(px, py, n, lo, hi, other, -1.0, down, skin, contacts, m)
        if m == 0:
            if closing or travel > 4.0 * step:
                return LOST
            continue
        for around in range(_POINT_ROUNDS if feet else 1):
            if feet:
                _point_matrix(local, c, s, d, 1e-3 * step, mass)
            _relax(contacts, m, mx, my, mass, mu, up, down, slop, 1e-5 * step, lam, lat, row, d)
            if feet:
                moved = 0.0
                for k in range(3):
                    moved = max(moved, abs(d[k] - before[k]))
                    # Half a step towards the new solution keeps the iteration from swinging.
                    if around:
                        d[k] = 0.5 * (d[k] + before[k])
                    before[k] = d[k]
                if moved < 1e-4 * step:
                    break
        mx, my, turn = mx + d[0], my + d[1], turn + d[2]
        first, second, deepest = False, False, 0.0
        for q in range(m):
            deepest = max(deepest, contacts[q, 4])
            if lam[q] > 0.0:
                if contacts[q, 5] > 0.0:
                    first = True
                else:
                    second = True
        if not closing:
            quiet = abs(d[2]) * lever < 1e-4 * step and abs(d[0]) < 1e-3 * step
            still = still + 1 if quiet else 0
            if (still >= _STILL_STEPS and first) or travel > 3.0 * diameter:
                kind, _, _, top = highest(px, py, n, lo, hi)
                if kind == NOTHING:
                    return LOST
                closing, other = True, top + d[1] + step
            continue
        if other <= face + step:
            return NOT_HELD
        if first and second:
            # A part in force closure moves no more, so the first such contact decides.
            if _held(contacts, lam, m, mu):
                return CLOSED
            jammed += deepest > 3.0 * step
            if jammed > _JAMMED_STEPS:
                return NOT_HELD
    return NOT_HELD


@njit(cache=True, nogil=True)
def simulate(vx, vy, com, valid, grasps, w, mu, c2, diameter, step, out):  # type: ignore[no-untyped-def]
    """Write the codes (g, N) of all grasps on all parts; an ellipsoidal limit surface."""
    parts, n = vx.shape
    body, scratch = np.empty((4, n)), np.empty((_MOST, 20))
    points = np.zeros((0, 3))
    for k in range(parts):
        for g in range(grasps.shape[0]):
            out[g, k] = INVALID
            if valid[k]:
                out[g, k] = simulate_trial(
                    vx[k], vy[k], com[k, 0], com[k, 1], grasps[g], w, mu, c2, diameter, step,
                    points, body, scratch,
                )  # fmt: skip


@njit(cache=True, nogil=True)
def simulate_on_points(vx, vy, com, grasps, w, mu, diameter, step, points, out):  # type: ignore[no-untyped-def]
    """Write the codes (N,) of pairs (grasp k, part k), each standing on points (N, k, 3)."""
    parts, n = vx.shape
    body, scratch = np.empty((4, n)), np.empty((_MOST, 20))
    for k in range(parts):
        out[k] = simulate_trial(
            vx[k], vy[k], com[k, 0], com[k, 1], grasps[k], w, mu, 0.16, diameter, step,
            points[k], body, scratch,
        )  # fmt: skip
