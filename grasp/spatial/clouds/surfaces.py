"""Normals and local frames on a cloud (ten Pas and Platt 2015, 3; Taubin 1991).

A local frame tells how a hand lies on a surface: its axis runs along the least curvature, its
normal points out of the object towards the camera.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from grasp.arrays import FloatArray
from grasp.spatial.clouds.neighbours import PointGrid, within

__all__ = ["estimate_normals", "quadric_normals", "smallest_axis", "surface_frames"]


_FEW = 5
_DRAWN = 64
_FLAT_SHARE = 0.02


def estimate_normals(grid: PointGrid, radius: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return unit normals (n, 3) of unknown sign by PCA of each point's neighbours, and which
    points have the five neighbours off one line that it takes; the others have zeros.

    Parameters
    ----------
    grid
        Of all points, m.
    radius
        Of the neighbourhood, m.
    """
    normals, has_normal = _normals(*grid.arrays, radius)
    return normals, has_normal


def surface_frames(
    grid: PointGrid,
    normals: FloatArray,
    samples: NDArray[np.int64],
    radius: float,
    along: FloatArray,
    quadric: bool = False,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return local frames (m, 3, 3) at samples, rows axis, normal, binormal, and which exist.

    Parameters
    ----------
    grid
        Of all points, m.
    normals : (n, 3)
        Out of the object; zeros where unknown.
    samples : (m,) int64
        Points at which frames are computed.
    radius
        Of the neighbourhood, m.
    along : (3,)
        The axis on a flat neighbourhood, where no direction is less curved than another: its part
        in the plane is taken. Any fixed direction of the object, e.g. its longest.
    quadric
        Take normals from a quadric fitted by Taubin's method instead of the points' own.
    """
    if not quadric:
        frames, has_frame = _frames(*grid.arrays, normals, samples, radius, along)
        return frames, has_frame
    frames = np.zeros((len(samples), 3, 3))
    has_frame = np.zeros(len(samples), bool)
    near = np.empty(len(grid.points), np.int64)
    for k, i in enumerate(samples):
        count = within(*grid.arrays, grid.points[i], radius, near)
        near[:count].sort()
        own = normals[near[:count]]
        usable = np.any(own != 0, axis=1)
        if usable.sum() < _FEW:
            continue
        fitted = quadric_normals(grid.points[near[:count]][usable])
        if fitted is None:
            fitted = own[usable]
        # A quadric has two sides; the points' own normals say which is outside.
        sides = np.where(np.einsum("ij,ij->i", fitted, own[usable]) < 0, -1.0, 1.0)
        has_frame[k] = _frame_of(np.ascontiguousarray(fitted * sides[:, None]), along, frames[k])
    return frames, has_frame


def quadric_normals(points: FloatArray) -> FloatArray | None:
    """Return unit normals (n, 3) of the quadric that fits points (n, 3) best (Taubin 1991).

    Minimises the sum of squared values over the sum of squared gradients. The sign is arbitrary
    but the same everywhere.

    Returns
    -------
    None where several quadrics fit equally well: planes, fewer than ten points.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> ball = rng.normal(size=(60, 3)); ball /= np.linalg.norm(ball, axis=1)[:, None]
    >>> normals = quadric_normals(0.03 * ball)
    >>> bool(np.allclose(np.abs(np.sum(normals * ball, axis=1)), 1))
    True
    """
    if len(points) < 10:
        return None
    centre = points.mean(axis=0)
    scale = float(np.sqrt(np.mean((points - centre) ** 2)))
    if scale == 0:
        return None
    x, y, z = ((points - centre) / scale).T
    ones, nil = np.ones_like(x), np.zeros_like(x)
    value = np.stack([x * x, y * y, z * z, x * y, y * z, x * z, x, y, z])
    gradient = np.stack(
        [
            [2 * x, nil, nil, y, nil, z, ones, nil, nil],
            [nil, 2 * y, nil, x, z, nil, nil, ones, nil],
            [nil, nil, 2 * z, nil, y, x, nil, nil, ones],
        ]
    )
    # The constant term has no gradient: its best value is minus the mean of the others.
    centred = value - value.mean(axis=1, keepdims=True)
    squares = np.einsum("aip,ajp->ij", gradient, gradient)
    try:
        values, vectors = linalg.eigh(centred @ centred.T, squares + 1e-9 * np.eye(9))
    except linalg.LinAlgError:
        return None
    if values[1] <= 1e-6 * values[-1]:
        return None
    normals = np.einsum("aip,i->pa", gradient, vectors[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.maximum(length, 1e-12))


@numba.njit(cache=True, nogil=True)
def smallest_axis(m, values, vectors):  # type: ignore[no-untyped-def]
    """Diagonalise a symmetric matrix (3, 3) by Jacobi rotations, destroying it; write ascending
    eigenvalues (3,) and eigenvectors (columns of (3, 3))."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2]
        if off <= 1e-26 * (m[0, 0] ** 2 + m[1, 1] ** 2 + m[2, 2] ** 2):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if m[p, q] == 0.0:
                    continue
                theta = (m[q, q] - m[p, p]) / (2 * m[p, q])
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1))
                if theta < 0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1)
                s = t * c
                for k in range(3):
                    a, b = m[k, p], m[k, q]
                    m[k, p], m[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = m[p, k], m[q, k]
                    m[p, k], m[q, k] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b
    for k in range(3):
        values[k] = m[k, k]
    for i in range(2):
        for j in range(2 - i):
            if values[j] > values[j + 1]:
                values[j], values[j + 1] = values[j + 1], values[j]
                for k in range(3):
                    vectors[k, j], vectors[k, j + 1] = vectors[k, j + 1], vectors[k, j]


@numba.njit(cache=True, nogil=True)
def _normals(points, cell, order, keys, low, shape, radius):  # type: ignore[no-untyped-def]
    n = points.shape[0]
    normals = np.zeros((n, 3))
    has_normal = np.zeros(n, np.bool_)
    near = np.empty(n, np.int64)
    m, vectors = np.empty((3, 3)), np.empty((3, 3))
    values = np.empty(3)
    for i in range(n):
        count = within(points, cell, order, keys, low, shape, points[i], radius, near)
        if count < _FEW:
            continue
        # Sums about the point itself: no loss of digits far from the origin.
        sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        for k in range(count):
            x = points[near[k], 0] - points[i, 0]
            y = points[near[k], 1] - points[i, 1]
            z = points[near[k], 2] - points[i, 2]
            sx, sy, sz = sx + x, sy + y, sz + z
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
        m[0, 0] = xx - sx * sx / count
        m[1, 1] = yy - sy * sy / count
        m[2, 2] = zz - sz * sz / count
        m[0, 1] = m[1, 0] = xy - sx * sy / count
        m[0, 2] = m[2, 0] = xz - sx * sz / count
        m[1, 2] = m[2, 1] = yz - sy * sz / count
        smallest_axis(m, values, vectors)
        if values[1] <= 1e-3 * values[2]:
            continue
        has_normal[i] = True
        for k in range(3):
            normals[i, k] = vectors[k, 0]
    return normals, has_normal


@numba.njit(cache=True, nogil=True)
def _frame_of(normals, along, frame):  # type: ignore[no-untyped-def]
    """Write axis, normal, binormal (rows of (3, 3)) of a neighbourhood's normals (k, 3)."""
    count = normals.shape[0]
    m, vectors = np.zeros((3, 3)), np.empty((3, 3))
    values = np.empty(3)
    for k in range(count):
        for i in range(3):
            for j in range(3):
                m[i, j] += normals[k, i] * normals[k, j]
    smallest_axis(m, values, vectors)
    # The normal that most neighbours share; every few-th neighbour is enough to tell.
    step = max(1, count // _DRAWN)
    best, most = 0, -1.0
    for i in range(count):
        votes = 0.0
        for j in range(0, count, step):
            d = (
                normals[i, 0] * normals[j, 0]
                + normals[i, 1] * normals[j, 1]
                + normals[i, 2] * normals[j, 2]
            )
            d2 = d * d
            votes += d2 * d2 * d2
        if votes > most * (1 + 1e-9):
            best, most = i, votes
    axis, normal = frame[0], frame[1]
    for k in range(3):
        normal[k] = normals[best, k]
        axis[k] = along[k] if values[1] < _FLAT_SHARE * values[2] else vectors[k, 0]
    lean = normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2]
    if values[1] < _FLAT_SHARE * values[2]:
        # Flat: lay the given direction into the plane; straight up, any direction does.
        for k in range(3):
            axis[k] -= lean * normal[k]
        if axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2 < 1e-6:
            for k in range(3):
                axis[k] = vectors[k, 1]
    else:
        for k in range(3):
            normal[k] -= lean * axis[k]
    la = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    ln = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if la < 1e-9 or ln < 1e-9:
        return False
    # An axis has no sign of its own: the given direction decides, so that motion changes nothing.
    sign = 1.0 if axis[0] * along[0] + axis[1] * along[1] + axis[2] * along[2] >= 0 else -1.0
    for k in range(3):
        axis[k] *= sign / la
        normal[k] /= ln
    frame[2, 0] = axis[1] * normal[2] - axis[2] * normal[1]
    frame[2, 1] = axis[2] * normal[0] - axis[0] * normal[2]
    frame[2, 2] = axis[0] * normal[1] - axis[1] * normal[0]
    return True


@numba.njit(cache=True, nogil=True)
def _frames(points, cell, order, keys, low, shape, normals, samples, radius, along):  # type: ignore[no-untyped-def]
    frames = np.zeros((samples.shape[0], 3, 3))
    has_frame = np.zeros(samples.shape[0], np.bool_)
    near = np.empty(points.shape[0], np.int64)
    for k in range(samples.shape[0]):
        count = within(points, cell, order, keys, low, shape, points[samples[k]], radius, near)
        # In the order of the points, which moves with them; the grid's order does not.
        near[:count].sort()
        own = np.empty((count, 3))
        used = 0
        for j in range(count):
            i = near[j]
            if normals[i, 0] != 0 or normals[i, 1] != 0 or normals[i, 2] != 0:
                own[used] = normals[i]
                used += 1
        if used >= _FEW:
            has_frame[k] = _frame_of(own[:used], along, frames[k])
    return frames, has_frame
