"""Grasp wrench space: the largest disturbance resisted (epsilon, Ferrari and Canny 1992).

Each contact pushes along the edges of its friction cone with a normal force of 1. Epsilon is the
radius of the largest ball about the origin inside the convex hull of all wrenches (both contacts
share one unit of force: the L1 hull). Torques are divided by the object's radius, so that the size
of the object does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from grasp.arrays import FloatArray

__all__ = ["Contacts", "epsilon", "epsilon_bound", "wrenches"]


_EDGES = 8
_STARTS, _STEPS = 24, 60
_LEVEL = 1e-10


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
    angle = 2 * np.pi * np.arange(edges) / edges
    rows = []
    for point, normal in zip(contacts.points, contacts.normals, strict=True):
        push = -np.asarray(normal, dtype=np.float64)
        arm = (np.asarray(point) - contacts.com) / contacts.radius
        one, two = _tangents(push, arm if contacts.across is None else contacts.across)
        across = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two
        force = push + friction * across
        rows.append(np.hstack([force, np.cross(arm, force)]))
        if gamma > 0:
            torsion = np.cross(arm, push) + gamma * np.array([[1.0], [-1.0]]) * push
            rows.append(np.hstack([np.broadcast_to(push, (2, 3)), torsion]))
    return np.vstack(rows)


def epsilon(contacts: Contacts, friction: float, gamma: float = 0.5, edges: int = _EDGES) -> float:
    """Return epsilon exactly, from the facets of the hull; 0 when the origin is not inside.

    Two hard fingers cannot resist a torque about the line between them: their hull is flat and
    epsilon 0.

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
    try:
        hull = ConvexHull(w)
    except QhullError:
        return 0.0
    return max(0.0, float(-hull.equations[:, 6].max()))


def epsilon_bound(
    contacts: Contacts, friction: float, gamma: float = 0.5, edges: int = _EDGES
) -> float:
    """Return an upper bound of epsilon, quickly.

    Epsilon is the least, over unit vectors u, of the largest w . u over all wrenches w; a descent
    from several u finds some value of it, mostly the least.
    """
    w = wrenches(contacts, friction, gamma, edges)
    # Seen from the contacts, so that the starts are the same in every frame.
    frame = _frame(contacts)
    w = np.hstack([w[:, :3] @ frame, w[:, 3:] @ frame])
    return max(0.0, float(_descend(np.ascontiguousarray(w), _starts(), _STEPS)))


def _tangents(push: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors across ``push``, the first as far ``towards`` as that allows."""
    one = towards - (towards @ push) * push
    length = float(np.linalg.norm(one))
    if length < 1e-6:
        one = np.cross(push, np.eye(3)[int(np.argmin(np.abs(push)))])
        length = float(np.linalg.norm(one))
    one = one / length
    return one, np.cross(push, one)


def _frame(contacts: Contacts) -> FloatArray:
    """Return axes (3, 3), as columns, that turn with the contacts."""
    first = np.asarray(contacts.normals[0], dtype=np.float64)
    second, third = _tangents(first, contacts.com if contacts.across is None else contacts.across)
    return np.stack([first, second, third], axis=1)


def _starts() -> FloatArray:
    """Return unit vectors (24, 6) to descend from: the axes and fixed random ones."""
    rng = np.random.default_rng(0xE95)
    drawn = rng.standard_normal((_STARTS - 12, 6))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.vstack([np.eye(6), -np.eye(6), drawn])


@njit(cache=True, nogil=True)
def _descend(w, starts, steps):  # type: ignore[no-untyped-def]
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
