"""Rigid movement in space that most matches agree on, and its least-squares fit.

Triples of matches are drawn at random; a triple fixes a movement in closed form, for the plane of
its one triangle goes onto that of the other. The movement that most matches agree on is improved on
these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from features.recognition.verify import VerifyParams

__all__ = ["RigidFit", "fit_rigid", "kabsch"]

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RigidFit:
    """A rigid movement of a stored view's camera frame into the query's.

    Parameters
    ----------
    query_from_view : (4, 4) float64, m
    inliers : (m,) bool
    rms_m
        Residual of the inliers.
    """

    query_from_view: NDArray[np.float64]
    inliers: Mask
    rms_m: float


def kabsch(query: NDArray[np.float64], view: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid movement of ``view`` (..., m, 3) onto ``query``, least squares.

    Returns
    -------
    (..., 4, 4) float64

    Examples
    --------
    >>> points = np.eye(3)
    >>> np.allclose(kabsch(points + (1, 2, 3), points)[:3, 3], (1, 2, 3))
    True
    """
    query_mean = query.mean(axis=-2, keepdims=True)
    view_mean = view.mean(axis=-2, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(view - view_mean, -1, -2) @ (query - query_mean))
    # Without the guard a flat or noisy set may come out mirrored.
    guard = np.ones(u.shape[:-1])
    guard[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = np.swapaxes(u @ (guard[..., None] * vt), -1, -2)
    movement = np.zeros((*query.shape[:-2], 4, 4))
    movement[..., :3, :3] = rotation
    movement[..., :3, 3] = (query_mean - view_mean @ np.swapaxes(rotation, -1, -2))[..., 0, :]
    movement[..., 3, 3] = 1.0
    return movement


def fit_rigid(
    query: NDArray[np.float32],
    view: NDArray[np.float32],
    size_m: float,
    params: VerifyParams | None = None,
    seed: int = 0,
) -> RigidFit | None:
    """Find the rigid movement that most matches agree on.

    Parameters
    ----------
    query, view : (m, 3) float32, m, optical frames of the two cameras
        NaN where depth is missing.
    size_m
        Visible diagonal of the object: tolerances scale with it, because 15 mm, a good least side
        for the triangle of a kitchen package, is half of a small object.

    Returns
    -------
    RigidFit or None
    """
    params = params or VerifyParams()
    has_depth = np.flatnonzero(np.isfinite(query).all(axis=1) & np.isfinite(view).all(axis=1))
    if len(has_depth) < params.min_places or not np.isfinite(size_m):
        return None
    q, v = query[has_depth].astype(np.float64), view[has_depth].astype(np.float64)
    tolerance = max(params.rigid_tolerance * size_m, params.rigid_tolerance_m)
    drawn = np.random.Generator(np.random.PCG64(seed)).random((4 * params.rigid_rounds, len(q)))
    min_side = min(0.015, params.rigid_min_side * size_m)
    best: Mask = _best_of_triples(q, v, drawn, min_side, tolerance, params.rigid_rounds)
    for _ in range(2):
        if best.sum() < params.min_places:
            return None
        movement = kabsch(q[best], v[best])
        best = _residuals(movement, q, v) < tolerance
    if best.sum() < params.min_places:
        return None
    inliers = np.zeros(len(query), bool)
    inliers[has_depth[best]] = True
    rms = float(np.sqrt(np.mean(_residuals(movement, q[best], v[best]) ** 2)))
    return RigidFit(movement, inliers, rms)


def _residuals(
    movement: NDArray[np.float64], query: NDArray[np.float64], view: NDArray[np.float64]
) -> NDArray[np.float64]:
    moved = view @ np.swapaxes(movement[..., :3, :3], -1, -2) + movement[..., None, :3, 3]
    distances: NDArray[np.float64] = np.linalg.norm(moved - query, axis=-1)
    return distances


@nb.njit(cache=True, nogil=True)
def _best_of_triples(
    query: NDArray[np.float64],
    view: NDArray[np.float64],
    drawn: NDArray[np.float64],
    min_side: float,
    tolerance: float,
    most: int,
) -> Mask:
    """Return the matches (m,) that agree with the movement of the best triple; none without any.

    Parameters
    ----------
    query, view : (m, 3) float64, m
    drawn : (rounds, m) float64
        Random numbers; the three least of a row draw a triple.
    min_side, tolerance : m
        A triple counts if its triangles are wider than the one, and of the same shape within twice
        the other.
    most
        Triples that count are tried until there were so many.
    """
    m = len(query)
    best, best_count, tried = np.zeros(m, np.bool_), 0, 0
    for row in drawn:
        triple = _three_least(row)
        if not _is_sound(query, view, triple, min_side, tolerance):
            continue
        tried += 1
        rotation, shift = _of_triangle(query, view, triple)
        agreeing, count = np.zeros(m, np.bool_), 0
        for j in range(m):
            square = 0.0
            for a in range(3):
                off = shift[a] - query[j, a]
                for b in range(3):
                    off += rotation[a, b] * view[j, b]
                square += off * off
            if np.sqrt(square) < tolerance:
                agreeing[j] = True
                count += 1
        if count > best_count:
            best, best_count = agreeing, count
        if tried == most:
            break
    return best


@nb.njit(cache=True, nogil=True)
def _three_least(row: NDArray[np.float64]) -> tuple[int, int, int]:
    """Return the places of the three least numbers, in order."""
    a, b, c = -1, -1, -1
    for j in range(len(row)):
        if a < 0 or row[j] < row[a]:
            a, b, c = j, a, b
        elif b < 0 or row[j] < row[b]:
            b, c = j, b
        elif c < 0 or row[j] < row[c]:
            c = j
    return a, b, c


@nb.njit(cache=True, nogil=True)
def _is_sound(
    query: NDArray[np.float64],
    view: NDArray[np.float64],
    triple: tuple[int, int, int],
    min_side: float,
    tolerance: float,
) -> bool:
    """Tell whether the triangles of a triple are wide and of the same shape on both sides."""
    for k in range(3):
        i, j = triple[k], triple[(k + 1) % 3]
        here = np.sqrt(np.sum((query[i] - query[j]) ** 2))
        there = np.sqrt(np.sum((view[i] - view[j]) ** 2))
        if min(here, there) <= min_side or abs(here - there) >= 2 * tolerance:
            return False
    return True


@nb.njit(cache=True, nogil=True)
def _of_triangle(
    query: NDArray[np.float64], view: NDArray[np.float64], triple: tuple[int, int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation and shift of a view's triangle onto the query's, least squares."""
    i, j, k = triple
    middle = (query[i] + query[j] + query[k]) / 3
    centre = (view[i] + view[j] + view[k]) / 3
    here, there = _axes(query[i], query[j], query[k]), _axes(view[i], view[j], view[k])
    along = across = 0.0
    for n in triple:
        q, v = query[n] - middle, view[n] - centre
        qx, qy = np.sum(here[0] * q), np.sum(here[1] * q)
        vx, vy = np.sum(there[0] * v), np.sum(there[1] * v)
        along += vx * qx + vy * qy
        across += vx * qy - vy * qx
    angle = np.arctan2(across, along)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.empty((3, 3))
    shift = np.empty(3)
    for a in range(3):
        x = c * here[0, a] + s * here[1, a]
        y = c * here[1, a] - s * here[0, a]
        for b in range(3):
            rotation[a, b] = x * there[0, b] + y * there[1, b] + here[2, a] * there[2, b]
        shift[a] = middle[a] - np.sum(rotation[a] * centre)
    return rotation, shift


@nb.njit(cache=True, nogil=True)
def _axes(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return axes (3, 3) of a triangle: along its first side, in its plane, its normal."""
    axes = np.empty((3, 3))
    axes[0] = (b - a) / np.sqrt(np.sum((b - a) ** 2))
    normal = np.cross(b - a, c - a)
    # Corners on one line leave the turn about it open.
    length = np.sqrt(np.sum(normal * normal))
    if length < 1e-12:
        normal = np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))])
        length = np.sqrt(np.sum(normal * normal))
    axes[2] = normal / length
    axes[1] = np.cross(axes[2], axes[0])
    return axes
