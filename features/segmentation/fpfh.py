"""Fast point feature histograms on voxels (FPFH, Rusu et al. 2009; Gatto 2016, 2.5.1).

Three angles between a voxel's normal and each neighbour's, 11 bins each: how the surface bends
around the voxel, whatever its position and direction.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.voxels import VoxelGrid

__all__ = ["BINS", "fpfh"]

BINS = 33
_PER_ANGLE = 11
_NEIGHBOUR_M = 0.005


def fpfh(voxels: VoxelGrid) -> NDArray[np.float64]:
    """Return the histogram of each voxel (v, 33), summing to 1; zeros without neighbours."""
    simple = _simple(voxels.centroids, voxels.normals, voxels.starts, voxels.neighbours)
    return np.asarray(_spread(simple, voxels.centroids, voxels.starts, voxels.neighbours))


@numba.njit(cache=True, nogil=True)
def _bin(value, low, high):  # type: ignore[no-untyped-def]
    k = int((value - low) / (high - low) * _PER_ANGLE)
    return min(max(k, 0), _PER_ANGLE - 1)


@numba.njit(cache=True, nogil=True)
def _simple(centroids, normals, starts, neighbours):  # type: ignore[no-untyped-def]
    """Return the histogram of the angles to direct neighbours (v, 33)."""
    out = np.zeros((centroids.shape[0], BINS))
    for i in range(centroids.shape[0]):
        u = normals[i]
        degree = starts[i + 1] - starts[i]
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            d = centroids[j] - centroids[i]
            distance = np.sqrt((d * d).sum())
            if distance < 1e-12:
                continue
            d = d / distance
            v = np.cross(u, d)
            length = np.sqrt((v * v).sum())
            if length < 1e-9:
                continue
            v = v / length
            w = np.cross(u, v)
            n = normals[j]
            alpha, phi = (v * n).sum(), (u * d).sum()
            theta = np.arctan2((w * n).sum(), (u * n).sum())
            share = 1.0 / degree
            out[i, _bin(alpha, -1.0, 1.0)] += share
            out[i, _PER_ANGLE + _bin(phi, -1.0, 1.0)] += share
            out[i, 2 * _PER_ANGLE + _bin(theta, -np.pi, np.pi)] += share
    return out


@numba.njit(cache=True, nogil=True)
def _spread(simple, centroids, starts, neighbours):  # type: ignore[no-untyped-def]
    """Add the neighbours' histograms, near ones more, and bring each sum to 1."""
    out = simple.copy()
    for i in range(simple.shape[0]):
        degree = starts[i + 1] - starts[i]
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            d = centroids[j] - centroids[i]
            distance = max(np.sqrt((d * d).sum()), 1e-6)
            out[i] += simple[j] * (_NEIGHBOUR_M / (distance * degree))
        total = out[i].sum()
        if total > 0:
            out[i] /= total
    return out
