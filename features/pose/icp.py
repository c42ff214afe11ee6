"""Iterative closest point from many starts at once, against a grid of nearest samples.

One kernel walks over all starts (Kehoe 2014, 4.4). The nearest model sample of a place is one
look-up in a grid that was filled when the model was made, which is what makes hundreds of starts
affordable. All kernels run on one thread and release the interpreter's lock.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array

__all__ = ["align", "distances", "fit_scores"]


_BOUND_SLIDING = 0.05
_MIN_FACING = 0.05
_DAMPING = 1e-6
_MAX_TURN_RAD = 0.5


@numba.njit(cache=True, nogil=True, inline="always")
def _sample_near(grid, corner, cell, x, y, z):  # type: ignore[no-untyped-def]
    """Return the number of the sample nearest to a place in the model's frame."""
    i = min(max(int((x - corner[0]) / cell), 0), grid.shape[0] - 1)
    j = min(max(int((y - corner[1]) / cell), 0), grid.shape[1] - 1)
    k = min(max(int((z - corner[2]) / cell), 0), grid.shape[2] - 1)
    return grid[i, j, k]


@numba.njit(cache=True, nogil=True, inline="always")
def _met(point, normal, r, t, samples, grid, corner, cell):  # type: ignore[no-untyped-def]
    """Return a point in the model's frame, its offset from the nearest sample, that one's normal.

    The last number is the cosine between both normals.
    """
    dx, dy, dz = point[0] - t[0], point[1] - t[1], point[2] - t[2]
    x = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
    y = r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz
    z = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
    m = _sample_near(grid, corner, cell, x, y, z)
    ex, ey, ez = x - samples[m, 0], y - samples[m, 1], z - samples[m, 2]
    nx, ny, nz = samples[m, 3], samples[m, 4], samples[m, 5]
    facing = (
        (r[0, 0] * normal[0] + r[1, 0] * normal[1] + r[2, 0] * normal[2]) * nx
        + (r[0, 1] * normal[0] + r[1, 1] * normal[1] + r[2, 1] * normal[2]) * ny
        + (r[0, 2] * normal[0] + r[1, 2] * normal[1] + r[2, 2] * normal[2]) * nz
    )
    return x, y, z, ex, ey, ez, nx, ny, nz, facing


@numba.njit(cache=True, nogil=True)
def _solve(a, b):  # type: ignore[no-untyped-def]
    """Solve a symmetric 6 x 6 system in place by Cholesky; False when it is singular."""
    for i in range(6):
        # A flat or round part leaves directions undetermined; damped, they stay where they are.
        a[i, i] += _DAMPING * a[i, i] + 1e-12
    for i in range(6):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                a[i, i] = np.sqrt(s)
            else:
                a[i, j] = s / a[j, j]
    for i in range(6):
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]
    for i in range(5, -1, -1):
        s = b[i]
        for k in range(i + 1, 6):
            s -= a[k, i] * b[k]
        b[i] = s / a[i, i]
    return True


@numba.njit(cache=True, nogil=True)
def _move(r, t, step):  # type: ignore[no-untyped-def]
    """Apply a step (turn, shift) of the points in the model's frame to the model's pose."""
    angle = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    # The step is linear in the angle, which holds for small ones only.
    scale = min(1.0, _MAX_TURN_RAD / angle) if angle > 1e-12 else 1.0
    angle *= scale
    e = np.eye(3)
    if angle > 1e-12:
        x, y, z = step[0] * scale / angle, step[1] * scale / angle, step[2] * scale / angle
        c, s = np.cos(angle), np.sin(angle)
        d = 1.0 - c
        e[0, 0], e[0, 1], e[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
        e[1, 0], e[1, 1], e[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
        e[2, 0], e[2, 1], e[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d
    turned = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            turned[i, j] = r[i, 0] * e[j, 0] + r[i, 1] * e[j, 1] + r[i, 2] * e[j, 2]
    for i in range(3):
        for j in range(3):
            r[i, j] = turned[i, j]
        t[i] -= turned[i, 0] * step[3] + turned[i, 1] * step[4] + turned[i, 2] * step[5]


@numba.njit(cache=True, nogil=True)
def align(
    points: Float64Array,
    normals: Float64Array,
    rotations: Float64Array,
    translations: Float64Array,
    samples: NDArray[np.float32],
    grid: NDArray[np.int16],
    corner: Float64Array,
    cell: float,
    cuts: Float64Array,
) -> None:
    """Improve poses in place, one round for each cut.

    Parameters
    ----------
    points, normals : (n, 3) float64, m, camera
    rotations : (k, 3, 3) float64
    translations : (k, 3) float64, m
        ``camera_from_model`` of each start.
    samples : (m, 6) float32
        Places and normals of the model's surface.
    grid : (a, b, c) int16
        Number of the sample nearest to each cell.
    corner : (3,) float64, m
        Of the grid, model frame.
    cell : float, m
    cuts : (rounds,) float64, m
        Distance at which a point counts a quarter, by round.
    """
    a, b = np.zeros((6, 6)), np.zeros(6)
    row = np.zeros(6)
    for k in range(len(rotations)):
        r, t = rotations[k], translations[k]
        for cut in cuts:
            a[:] = 0.0
            b[:] = 0.0
            for p in range(len(points)):
                x, y, z, ex, ey, ez, nx, ny, nz, facing = _met(
                    points[p], normals[p], r, t, samples, grid, corner, cell
                )
                # Geman-McClure: what the model does not explain, such as a neighbour's points,
                # loses its say as the cut shrinks.
                far = 1.0 + (ex * ex + ey * ey + ez * ez) / (cut * cut)
                w = max(facing, _MIN_FACING) / (far * far)
                row[0], row[1], row[2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
                row[3], row[4], row[5] = nx, ny, nz
                off = ex * nx + ey * ny + ez * nz
                for i in range(6):
                    wi = w * row[i]
                    b[i] -= wi * off
                    for j in range(i + 1):
                        a[i, j] += wi * row[j]
                # Point to plane alone lets a flat face slide along the model's for nothing.
                slow = _BOUND_SLIDING * w
                a[3, 3] += slow
                a[4, 4] += slow
                a[5, 5] += slow
                b[3] -= slow * ex
                b[4] -= slow * ey
                b[5] -= slow * ez
            if not _solve(a, b):
                break
            _move(r, t, b)


@numba.njit(cache=True, nogil=True)
def fit_scores(
    points: Float64Array,
    normals: Float64Array,
    rotations: Float64Array,
    translations: Float64Array,
    samples: NDArray[np.float32],
    grid: NDArray[np.int16],
    corner: Float64Array,
    cell: float,
    sigma: float,
) -> Float64Array:
    """Return how well the points lie on the model, (k,) in 0..1; parameters as in ``align``."""
    scores = np.zeros(len(rotations))
    for k in range(len(rotations)):
        r, t = rotations[k], translations[k]
        total = 0.0
        for p in range(len(points)):
            _, _, _, ex, ey, ez, nx, ny, nz, facing = _met(
                points[p], normals[p], r, t, samples, grid, corner, cell
            )
            off = 0.7 * abs(ex * nx + ey * ny + ez * nz)
            off += 0.3 * np.sqrt(ex * ex + ey * ey + ez * ez)
            total += np.exp(-off * off / (2 * sigma * sigma)) * (0.3 + 0.7 * max(0.0, facing))
        scores[k] = total / max(len(points), 1)
    return scores


@numba.njit(cache=True, nogil=True)
def distances(
    points: Float64Array,
    rotation: Float64Array,
    translation: Float64Array,
    samples: NDArray[np.float32],
    grid: NDArray[np.int16],
    corner: Float64Array,
    cell: float,
) -> Float64Array:
    """Return the distance in m of points (n, 3) to the model at one pose; others as above."""
    distances_m = np.empty(len(points))
    r, t = rotation, translation
    for p in range(len(points)):
        dx, dy, dz = points[p, 0] - t[0], points[p, 1] - t[1], points[p, 2] - t[2]
        x = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
        y = r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz
        z = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
        m = _sample_near(grid, corner, cell, x, y, z)
        x, y, z = x - samples[m, 0], y - samples[m, 1], z - samples[m, 2]
        distances_m[p] = np.sqrt(x * x + y * y + z * z)
    return distances_m
