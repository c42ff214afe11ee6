"""A push grasp in a dynamic model of soft contacts that shares nothing with the solver.

Here force follows from motion: a contact resists with a spring and a damper along its normal, and
with a spring that remembers where it stuck along its tangent, cut off at Coulomb's cone (Cundall
and Strack 1979). So a part that sticks does not creep. The part has inertia, and many points on the
support, whose friction is Coulomb's above a hundredth of the jaws' speed. Nothing is solved for, no
contact is counted, and no geometric test tells the end: a grasp is closed when the jaws, whose
distance shrinks, meet a force that no friction of the support explains.

Units: the radius of the part, its mass, and the time in which friction of the support stops a part
that slides at one radius per unit of time.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grasp.arrays import FloatArray
from grasp.push import PushTest, Tolerance, as_part, sample_grasps
from grasp.push.polygon import triangles
from grasp.push.trials import Trials

__all__ = ["OUTLINES", "closes", "compared", "feet_of"]


def _regular(corners: int) -> FloatArray:
    turn = 2 * np.pi * np.arange(corners) / corners + 0.3
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


OUTLINES: dict[str, FloatArray] = {
    "trapezium": np.array([(-1, -0.5), (1, -0.5), (0.6, 0.5), (-0.6, 0.5)]),
    "steep trapezium": np.array([(-1, -0.4), (1, -0.4), (0.25, 0.4), (-0.25, 0.4)]),
    "pentagon": _regular(5),
    "triangle": _regular(3),
    "hexagon": _regular(6),
    "kite": np.array([(0, -1), (0.7, 0), (0, 0.5), (-0.7, 0)]),
    "bar": np.array([(-1, -0.2), (1, -0.2), (1, 0.2), (-1, 0.2)]),
    "house": np.array([(-0.6, -0.6), (0.6, -0.6), (0.6, 0.2), (0, 0.8), (-0.6, 0.2)]),
    "ell": np.array([(0, 0), (1, 0), (1, 0.4), (0.4, 0.4), (0.4, 1.2), (0, 1.2)]),
    "tee": np.array([
        (-0.2, 0), (0.2, 0), (0.2, 0.8), (0.7, 0.8), (0.7, 1.1), (-0.7, 1.1), (-0.7, 0.8),
        (-0.2, 0.8),
    ]),
}  # fmt: skip
"""Outlines (n, 2) of plain parts, each in a unit of its own."""

_JAW_SPEED, _CREEP = 0.05, 5e-4
_STIFFNESS, _DAMPING, _STICKING = 2000.0, 20.0, 1500.0
_DT = 5e-4
_SQUEEZED = 15.0
"""Force of a jaw, in friction of the sliding part, that tells a held one: to push it takes one."""
_SETTLED_S, _STILL = 2.0, 0.02
_JAW_DEPTH = 0.4
_FEET = 40


def feet_of(ring: FloatArray, com: FloatArray, seed: int = 0) -> FloatArray:
    """Return support points (k, 3): x, y from the centre of mass, and shares of the weight.

    They are drawn evenly on the part; weights are the nearest to equal ones whose centre is the
    centre of mass.
    """
    rng = np.random.default_rng(seed)
    parts = np.array(triangles(ring))
    area = np.abs(np.linalg.det(parts[:, 1:] - parts[:, :1]))
    chosen = parts[rng.choice(len(parts), _FEET, p=area / area.sum())]
    u, v = np.sort(rng.uniform(size=(2, _FEET)), axis=0)
    points = (
        u[:, None] * chosen[:, 0]
        + (v - u)[:, None] * chosen[:, 1]
        + (1 - v)[:, None] * chosen[:, 2]
    ) - com
    system = np.vstack([points.T, np.ones(_FEET)])
    equal = np.full(_FEET, 1 / _FEET)
    off = np.array([0.0, 0.0, 1.0]) - system @ equal
    weights = equal + system.T @ np.linalg.solve(system @ system.T, off)
    return np.column_stack([points, np.clip(weights, 0.0, None) / np.clip(weights, 0, None).sum()])


def compared(ring: FloatArray, samples: int, most: int, seed: int = 5) -> tuple[int, int, float]:
    """Return of perturbed trials how many the bound accepts, how many of these close here, and the
    share of those that it refuses which close all the same.

    Parameters
    ----------
    samples, most
        Perturbed parts, and trials of either kind that are tried at most.
    """
    part = as_part(ring)
    test = PushTest(0.25 * part.diameter)
    trials = Trials.of(part, sample_grasps(part), test, Tolerance.default(part), seed)
    codes = trials(0, samples)
    vx, vy, mass, valid = trials.parts(0, samples)
    rng, shares = np.random.default_rng(seed), []
    for is_accepted in (True, False):
        pairs = np.argwhere(((codes > 0) == is_accepted) & valid)
        pairs = pairs[rng.permutation(len(pairs))[:most]]
        closed = [
            closes(np.stack([vx[k], vy[k]], axis=1), mass[k], trials.rows[g], trials.width,
                   test.friction, 1.0, seed)
            for g, k in pairs
        ]  # fmt: skip
        shares.append((len(closed), sum(closed)))
    (accepted, held), (refused, anyway) = shares
    return accepted, held, anyway / max(refused, 1)


def closes(
    ring: FloatArray, com: FloatArray, grasp: FloatArray, width: float, friction: float,
    radius: float, seed: int = 0,
) -> bool:  # fmt: skip
    """Return whether a push grasp ends with the part held.

    Parameters
    ----------
    ring : (n, 2), com : (2,), grasp : (5,)
        As for the solver: place and direction of the push, and the side of the jaw.
    width, radius
        Of the jaws, and the unit of length.
    """
    dx, dy = float(grasp[2]), float(grasp[3])
    turn = np.array([[dy, dx], [-dx, dy]])
    local = (ring - grasp[:2]) @ turn / radius
    middle = (com - grasp[:2]) @ turn / radius
    feet = feet_of(local, middle, seed)
    size = width / radius
    lo = 0.0 if grasp[4] > 0 else -size
    gyration = float(feet[:, 2] @ (feet[:, :2] ** 2).sum(axis=1))
    return bool(_run(np.ascontiguousarray(local - middle), middle, feet, gyration, lo, size,
                     friction))  # fmt: skip


@njit(cache=True)
def _push(v, w, x, y, nx, ny, depth, speed, q, spring, mu, mx, my, force):  # type: ignore[no-untyped-def]
    """Add a contact's force to ``force`` (3,); return its part along y.

    ``v`` (2,) and ``w`` are the part's velocities, ``n`` points into it, the jaw moves along y.
    """
    rx, ry = x - mx, y - my
    ux, uy = v[0] - w * ry, v[1] + w * rx - speed
    along, across = ux * nx + uy * ny, -ux * ny + uy * nx
    normal = max(_STIFFNESS * depth - _DAMPING * along, 0.0)
    spring[q] += across * _DT
    most = mu * normal / _STICKING
    spring[q] = min(max(spring[q], -most), most)
    tangent = -_STICKING * spring[q]
    fx, fy = normal * nx - tangent * ny, normal * ny + tangent * nx
    force[0] += fx
    force[1] += fy
    force[2] += rx * fy - ry * fx
    return fy


@njit(cache=True)
def _depth_inside(px, py, n, x, y):  # type: ignore[no-untyped-def]
    """Return depth and inward normal of a place in a polygon; a negative depth outside."""
    inside, best, at = False, np.inf, -1
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if (py[i] > y) != (py[j] > y) and x < px[i] + (px[j] - px[i]) * (y - py[i]) / (
            py[j] - py[i]
        ):
            inside = not inside
        ex, ey = px[j] - px[i], py[j] - py[i]
        t = min(max(((x - px[i]) * ex + (y - py[i]) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        away = math.hypot(x - px[i] - t * ex, y - py[i] - t * ey)
        if away < best:
            best, at = away, i
    j = at + 1 if at + 1 < n else 0
    ex, ey = px[j] - px[at], py[j] - py[at]
    length = math.hypot(ex, ey)
    return (best if inside else -1.0), -ey / length, ex / length


@njit(cache=True)
def _jaw(px, py, n, lo, hi, face, up, v, w, mx, my, spring, first, mu, speed, force):  # type: ignore[no-untyped-def]
    """Add the forces of a jaw, a rectangle behind its face; return the force on its face."""
    total = 0.0
    for i in range(n):
        deep = (face - py[i]) * up
        side = min(px[i] - lo, hi - px[i])
        if not (side > 0.0 and 0.0 < deep < _JAW_DEPTH):
            spring[first + i] = 0.0
        elif side < deep:
            left = -1.0 if px[i] - lo < hi - px[i] else 1.0
            _push(v, w, px[i], py[i], left, 0.0, side, speed, first + i, spring, mu, mx, my, force)
        else:
            total += up * _push(
                v, w, px[i], py[i], 0.0, up, deep, speed, first + i, spring, mu, mx, my, force
            )
    for k in range(2):
        x = lo if k == 0 else hi
        deep, nx, ny = _depth_inside(px, py, n, x, face)
        if deep <= 0.0:
            spring[first + n + k] = 0.0
            continue
        total += up * _push(
            v, w, x, face, nx, ny, deep, speed, first + n + k, spring, mu, mx, my, force
        )
    return total


@njit(cache=True)
def _run(body, middle, feet, gyration, lo, size, mu):  # type: ignore[no-untyped-def]
    n, hi = len(body), lo + size
    px, py = np.empty(n), np.empty(n)
    spring, force, v = np.zeros(2 * (n + 2)), np.zeros(3), np.zeros(2)
    mx, my, turn, w = middle[0], middle[1], 0.0, 0.0
    face, other, closing = -3.0, 0.0, False
    waited, travel, began = 0.0, 0.0, False
    while travel < 12.0:
        c, s = math.cos(turn), math.sin(turn)
        for i in range(n):
            px[i] = c * body[i, 0] - s * body[i, 1] + mx
            py[i] = s * body[i, 0] + c * body[i, 1] + my
        if not began:
            # The jaw starts where it meets the part: its first contact is found by going there.
            face, began = py.min() - 1e-3, True
        up_speed = 0.0 if closing else _JAW_SPEED
        face += up_speed * _DT
        travel += _JAW_SPEED * _DT
        force[:] = 0.0
        below = _jaw(px, py, n, lo, hi, face, 1.0, v, w, mx, my, spring, 0, mu, up_speed, force)
        above = 0.0
        if closing:
            other -= _JAW_SPEED * _DT
            above = _jaw(px, py, n, lo, hi, other, -1.0, v, w, mx, my, spring, n + 2, mu,
                         -_JAW_SPEED, force)  # fmt: skip
            if min(below, above) > _SQUEEZED:
                return True
            if other <= face:
                return False
        for k in range(len(feet)):
            fx, fy = c * feet[k, 0] - s * feet[k, 1], s * feet[k, 0] + c * feet[k, 1]
            ux, uy = v[0] - w * fy, v[1] + w * fx
            share = feet[k, 2] / math.sqrt(ux * ux + uy * uy + _CREEP * _CREEP)
            force[0] -= share * ux
            force[1] -= share * uy
            force[2] -= share * (fx * uy - fy * ux)
        v[0] += force[0] * _DT
        v[1] += force[1] * _DT
        w += force[2] / gyration * _DT
        mx += v[0] * _DT
        my += v[1] * _DT
        turn += w * _DT
        if closing:
            continue
        if py.max() < face:
            return False
        # Pushed at rest on the jaw: it moves with it, and turns and slides no more.
        quiet = (
            abs(w) + abs(v[0]) < _STILL * _JAW_SPEED and abs(v[1] - _JAW_SPEED) < 0.2 * _JAW_SPEED
        )
        waited = waited + _DT if quiet and below > 0.0 else 0.0
        if waited > _SETTLED_S or travel > 8.0:
            closing, other, travel = True, py.max() + 1e-3, 0.0
    return False
