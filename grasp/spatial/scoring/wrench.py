"""Grasp wrench space: the largest disturbance resisted (epsilon, Ferrari and Canny 1992).

Each contact pushes along the edges of its friction cone with a normal force of 1. Epsilon is the
radius of the largest ball about the origin inside the convex hull of all wrenches (both contacts
share one unit of force: the L1 hull). Torques are divided by the object's radius, so that the size
of the object does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit

from grasp.arrays import FloatArray

__all__ = ["Contacts", "epsilon", "epsilon_bound", "wrenches"]


_EDGES = 8
_STARTS, _STEPS = 24, 60
_LEVEL = 1e-10
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts with an object.

    Parameters
    ----------
    points, normals : (n, 3)
        m; unit vectors out of the object.
    com : (3,), m
        Centre of mass: torques are taken about it.
    radius
        Largest distance of the surface from ``com``, m: the unit of torques.
    across : (3,) or None
        Direction from which the edges of the friction cones are counted, such as the gripper's
        approach; None = away from the centre of mass.
    """

    points: FloatArray
    normals: FloatArray
    com: FloatArray
    radius: float
    across: FloatArray | None = None


def wrenches(
    contacts: Contacts, friction: float, gamma: float = 0.5, edges: int = _EDGES
) -> FloatArray:
    """Return the wrenches (n, 6) that the contacts can exert at most.

    Parameters
    ----------
    friction
        Coulomb coefficient.
    gamma
        Torsional friction of a soft finger, as torque over normal force in units of ``radius``;
        0 = hard fingers.
    edges
        Of each friction cone.
    """
    if contacts.radius <= 0 or friction < 0 or gamma < 0 or edges < 3:
        raise ValueError(
            "epsilon needs radius > 0, friction >= 0, gamma >= 0 and edges >= 3, got "
            f"{contacts.radius}, {friction}, {gamma}, {edges}"
        )
    arms = (np.asarray(contacts.points, dtype=np.float64) - contacts.com) / contacts.radius
    across = arms if contacts.across is None else np.broadcast_to(contacts.across, arms.shape)
    pushes = -np.ascontiguousarray(contacts.normals, dtype=np.float64)
    angle = 2 * np.pi * np.arange(edges) / edges
    return np.asarray(_cones(pushes, arms, np.array(across, np.float64), angle, friction, gamma))


def epsilon(contacts: Contacts, friction: float, gamma: float = 0.5, edges: int = _EDGES) -> float:
    """Return epsilon exactly, from the facets of the hull; 0 when the origin is not inside.

    Two hard fingers cannot resist a torque about the line between them: their hull is flat and
    epsilon 0. The facets of two soft fingers are known beforehand, which is many times as fast as
    a hull of any points.

    Examples
    --------
    >>> poles = np.array([[-1.0, 0, 0], [1, 0, 0]])
    >>> ball = Contacts(poles, poles, np.zeros(3), 1.0)
    >>> round(epsilon(ball, 0.5), 3), epsilon(ball, 0.5, gamma=0.0)
    (0.31, 0.0)
    """
    from scipy.spatial import ConvexHull, QhullError

    w = wrenches(contacts, friction, gamma, edges)
    if np.linalg.matrix_rank(w - w.mean(axis=0), tol=1e-9) < 6:
        return 0.0
    if len(contacts.points) == 2 and friction > 0 and gamma > 0:
        return max(0.0, float(_least_facet(w)))
    try:
        hull = ConvexHull(w)
    except QhullError:
        return 0.0
    return max(0.0, float(-hull.equations[:, 6].max()))


def epsilon_bound(contacts: Contacts, friction: float) -> float:
    """Return an upper bound of epsilon, quickly.

    Epsilon is the least, over unit vectors u, of the largest w . u over all wrenches w; a descent
    from several u finds some value of it, mostly the least.
    """
    w = wrenches(contacts, friction)
    # Seen from the contacts, so that the starts are the same in every frame.
    frame = _frame(contacts)
    w = np.hstack([w[:, :3] @ frame, w[:, 3:] @ frame])
    return max(0.0, float(_descend(np.ascontiguousarray(w), _starts(), _STEPS)))


@njit(cache=True, nogil=True)
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@njit(cache=True, nogil=True)
def _cones(
    pushes: FloatArray,
    arms: FloatArray,
    towards: FloatArray,
    angle: FloatArray,
    friction: float,
    gamma: float,
) -> FloatArray:
    """Return the wrenches (n, 6): of each contact the edges of its cone, then both torsions."""
    each = len(angle) + (2 if gamma > 0 else 0)
    w = np.empty((len(pushes) * each, 6))
    for c in range(len(pushes)):
        push, arm = pushes[c], arms[c]
        first, two = _tangents(push, towards[c])
        for k in range(len(angle)):
            row = w[c * each + k]
            row[:3] = push + friction * (np.cos(angle[k]) * first + np.sin(angle[k]) * two)
            row[3:] = _cross(arm, row[:3])
        if gamma > 0:
            for k in range(2):
                row = w[c * each + len(angle) + k]
                row[:3] = push
                row[3:] = _cross(arm, push) + (gamma - 2 * k * gamma) * push
    return w


@njit(cache=True, nogil=True)
def _tangents(push: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors across ``push``, the first as far ``towards`` as that allows."""
    first = towards - (towards * push).sum() * push
    length = np.sqrt((first * first).sum())
    if length < 1e-6:
        axis = np.zeros(3)
        axis[np.argmin(np.abs(push))] = 1.0
        first = _cross(push, axis)
        length = np.sqrt((first * first).sum())
    first = first / length
    return first, _cross(push, first)


def _frame(contacts: Contacts) -> FloatArray:
    """Return axes (3, 3), as columns, that turn with the contacts."""
    first = np.array(contacts.normals[0], dtype=np.float64)
    towards = contacts.com if contacts.across is None else contacts.across
    second, third = _tangents(first, np.array(towards, dtype=np.float64))
    return np.stack([first, second, third], axis=1)


@cache
def _starts() -> FloatArray:
    """Return unit vectors (24, 6) to descend from: the axes and fixed random ones."""
    rng = np.random.default_rng(0xE95)
    drawn = rng.standard_normal((_STARTS - 12, 6))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.vstack([np.eye(6), -np.eye(6), drawn])


@njit(cache=True, nogil=True)
def _descend(w: FloatArray, starts: FloatArray, steps: int) -> float:
    """Return the least of max(w . u) that projected subgradient steps find."""
    best_of_all = np.inf
    u = np.empty(6)
    for s in range(len(starts)):
        u[:] = starts[s]
        best = np.inf
        for step in range(steps):
            value, at = -np.inf, 0
            for i in range(len(w)):
                dot = 0.0
                for k in range(6):
                    dot += w[i, k] * u[k]
                # Among equals the first: rounding must not choose the way.
                if dot > value + _LEVEL:
                    value, at = dot, i
            best = min(best, value)
            size = 0.6 / (1.0 + 0.25 * step)
            norm = 0.0
            for k in range(6):
                # Only the part along the sphere moves u.
                u[k] -= size * (w[at, k] - value * u[k])
                norm += u[k] * u[k]
            for k in range(6):
                u[k] /= np.sqrt(norm)
        best_of_all = min(best_of_all, best)
    return best_of_all


@njit(cache=True, nogil=True)
def _least_facet(w: FloatArray) -> float:
    """Return the least distance of the facets of two soft contacts' wrenches (2 m, 6).

    The wrenches of one contact are a double pyramid over the edges of its cone, in three
    dimensions. In six, a facet of the hull of two takes a triangle of each, or one whole and an
    edge of the other. Other six of these points may span a plane through the hull, but the hull
    reaches over it at least as far as it does over the nearest facet: the least of all counts.
    """
    m = len(w) // 2
    ring = m - 2
    least = np.inf
    points = np.empty((6, 6))
    for i in range(2 * ring):
        for k in range(3):
            points[k] = w[_triangle(i, k, ring)]
        for j in range(2 * ring):
            for k in range(3):
                points[3 + k] = w[m + _triangle(j, k, ring)]
            least = min(least, _reach(w, points))
    for whole, other in ((0, m), (m, 0)):
        points[0], points[1] = w[whole], w[whole + 1]
        points[2], points[3] = w[whole + ring], w[whole + ring + 1]
        for i in range(2 * ring):
            points[4] = w[other + _triangle(i, 0, ring)]
            # Its edge to the tip, and once for both tips the one around the ring.
            points[5] = w[other + _triangle(i, 2, ring)]
            least = min(least, _reach(w, points))
            if i < ring:
                points[5] = w[other + _triangle(i, 1, ring)]
                least = min(least, _reach(w, points))
    return least


@njit(cache=True, nogil=True)
def _triangle(i: int, k: int, ring: int) -> int:
    """Return corner ``k`` of triangle ``i`` of a double pyramid: two on the ring, then a tip."""
    if k == 2:
        return ring + i // ring
    return (i + k) % ring


@njit(cache=True, nogil=True)
def _reach(w: FloatArray, points: FloatArray) -> float:
    """Return how far wrenches reach across the plane through six of them, on its nearer side.

    Infinite where the six do not span a plane.
    """
    a = points[1:] - points[0]
    order = np.arange(6)
    for k in range(5):
        row, column, most = k, k, 0.0
        for i in range(k, 5):
            for j in range(k, 6):
                if abs(a[i, j]) > most:
                    row, column, most = i, j, abs(a[i, j])
        if most < _FLAT:
            return np.inf
        for j in range(6):
            a[k, j], a[row, j] = a[row, j], a[k, j]
        for i in range(5):
            a[i, k], a[i, column] = a[i, column], a[i, k]
        order[k], order[column] = order[column], order[k]
        for i in range(k + 1, 5):
            factor = a[i, k] / a[k, k]
            for j in range(k, 6):
                a[i, j] -= factor * a[k, j]
    normal = np.empty(6)
    normal[order[5]] = 1.0
    for k in range(4, -1, -1):
        total = a[k, 5]
        for j in range(k + 1, 5):
            total += a[k, j] * normal[order[j]]
        normal[order[k]] = -total / a[k, k]
    normal /= np.sqrt((normal * normal).sum())
    high, low = -np.inf, np.inf
    for i in range(len(w)):
        dot = 0.0
        for k in range(6):
            dot += w[i, k] * normal[k]
        high, low = max(high, dot), min(low, dot)
    return min(high, -low)
