"""The table: the largest plane, or the largest level one when gravity is known.

RANSAC (Fischler and Bolles 1981) on a subsample, then three least-squares fits (Gatto 2016, 2.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array

__all__ = ["Plane", "find_table_plane"]


_TOLERANCE_M = 0.008
_ITERATIONS = 150
_REFITS = (1.0, 0.7, 0.7)
_PIXEL_STEP = 6
_SUBSAMPLE = 8_500
_MIN_SHARE, _MIN_INLIERS = 0.10, 100
_MIN_WIDTH_M = 1e-4
_LEVEL_COS = float(np.cos(np.deg2rad(15)))
_PLANES_TRIED = 3


@dataclass(frozen=True)
class Plane:
    """All points x with ``normal . x + offset = 0``; the camera is on the positive side.

    Parameters
    ----------
    normal : (3,) float
        Unit length, towards the camera.
    offset
        Height of the camera over the plane, m.
    inlier_share
        Of the subsample, within 8 mm.
    """

    normal: Float64Array
    offset: float
    inlier_share: float

    def heights(self, points: NDArray[np.floating[Any]]) -> Float64Array:
        """Return the height (...) of points (..., 3) over the plane, m."""
        heights: Float64Array = points.astype(np.float64) @ self.normal + self.offset
        return heights


@numba.njit(cache=True, nogil=True)
def _ransac(points, triples, tolerance):  # type: ignore[no-untyped-def]
    """Return the plane (4,) through some triple of points that most points lie near."""
    best = np.zeros(4)
    most = -1
    for row in range(triples.shape[0]):
        a, b, c = points[triples[row, 0]], points[triples[row, 1]], points[triples[row, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length < 1e-5:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        d = -(nx * a[0] + ny * a[1] + nz * a[2])
        count = 0
        for i in range(points.shape[0]):
            p = points[i]
            if abs(nx * p[0] + ny * p[1] + nz * p[2] + d) < tolerance:
                count += 1
        if count > most:
            most = count
            best[0], best[1], best[2], best[3] = nx, ny, nz, d
    return best


def find_table_plane(
    points: NDArray[np.floating[Any]],
    gravity: NDArray[np.floating[Any]] | None = None,
) -> Plane | None:
    """Find the plane of the table.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
        NaN = missing.
    gravity : (3,) float or None
        Direction in which things fall; with it only planes within 15 deg of level count, so that
        a wall or the floor's edge is not taken for the table.

    Returns
    -------
    Plane or None
        None when no plane holds a tenth of the points, or these lie on a line.

    Raises
    ------
    ValueError
        When the gravity is no direction.
    """
    if gravity is not None and not 0 < np.linalg.norm(gravity) < np.inf:
        raise ValueError(f"gravity must be a direction (3,), got {gravity}")
    sample = subsample(points)
    total = len(sample)
    up = None if gravity is None else -np.asarray(gravity, float) / np.linalg.norm(gravity)
    rng = np.random.default_rng(0)
    best: Plane | None = None
    for _ in range(1 if up is None else _PLANES_TRIED):
        if len(sample) < _MIN_INLIERS:
            break
        plane, near = _fit(sample, total, rng)
        if plane is None or plane.inlier_share < _MIN_SHARE:
            break
        if np.count_nonzero(near) < _MIN_INLIERS:
            break
        level = up is None or float(plane.normal @ up) >= _LEVEL_COS
        if level and (best is None or plane.inlier_share > best.inlier_share):
            best = plane
        sample = sample[~near]
    return best


def subsample(points: NDArray[np.floating[Any]]) -> Float64Array:
    """Return finite points (m, 3): every 6th row and column, or 8,500 at random."""
    if points.ndim == 3:
        picked = points[::_PIXEL_STEP, ::_PIXEL_STEP].reshape(-1, 3)
    else:
        picked = points
        if len(points) > _SUBSAMPLE:
            rng = np.random.default_rng(0)
            picked = points[rng.choice(len(points), _SUBSAMPLE, replace=False)]
    finite: Float64Array = picked[np.isfinite(picked).all(axis=1)].astype(np.float64)
    return finite


def _fit(
    sample: Float64Array, total: int, rng: np.random.Generator
) -> tuple[Plane | None, NDArray[np.bool_]]:
    """Return a plane and the points (n,) near it; no plane where those lie on a line."""
    triples = rng.integers(0, len(sample), (_ITERATIONS, 3))
    model = _ransac(sample, triples, _TOLERANCE_M)
    normal, offset, variances = model[:3], float(model[3]), np.zeros(3)
    for share in _REFITS:
        inliers = sample[np.abs(sample @ normal + offset) < share * _TOLERANCE_M]
        if len(inliers) < 3:
            break
        mean = inliers.mean(axis=0)
        variances, vectors = np.linalg.eigh(np.cov((inliers - mean).T))
        normal = vectors[:, 0]
        offset = -float(normal @ mean)
    if offset < 0:
        normal, offset = -normal, -offset
    near = np.abs(sample @ normal + offset) < _TOLERANCE_M
    if variances[1] < _MIN_WIDTH_M**2:
        return None, near
    return Plane(normal, offset, float(np.count_nonzero(near) / max(total, 1))), near
