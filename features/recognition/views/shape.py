"""Shape of the visible surface as a histogram over pairs of its points.

The histogram holds distances and angles between normals, in metres and free of any frame: neither
the table nor the pose of the camera has to be known, and a thing that was turned on the table
keeps most of it. Its bins are those of the surflet-pair relations of Wahl, Hillenbrand and
Hirzinger 2003, with two of their three angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["SHAPE_SIZE", "shape_histogram"]

_DISTANCE_BINS, _NORMAL_BINS, _SLOPE_BINS = 20, 4, 3
SHAPE_SIZE = _DISTANCE_BINS * _NORMAL_BINS * _SLOPE_BINS

_NEAREST_M, _FARTHEST_M = 0.002, 0.4
"""Distances of the first and last bin, on a logarithmic scale."""
_VOXELS_ACROSS = 32
_MIN_VOXEL_M = 0.002
_MAX_POINTS, _MAX_SURFLETS = 6_000, 256
_NEIGHBOURS = 24
_MIN_POINTS = 100
_STRAY_SHARE = 0.15
"""Voxels with a smaller share of the median's points are taken for noise at the rim."""


def shape_histogram(points: NDArray[np.floating]) -> NDArray[np.float32] | None:
    """Return the square root of the histogram over pairs of visible points.

    Parameters
    ----------
    points : (n, 3) float, m, any frame
        Visible surface of one object; not finite = missing.

    Returns
    -------
    (240,) float32 or None
        Unit length: the dot product of two is their Bhattacharyya similarity. None for fewer than
        a hundred points.

    Examples
    --------
    >>> side = np.linspace(0, 0.1, 40)
    >>> plate = np.stack(np.meshgrid(side, side, [0.0]), -1).reshape(-1, 3)
    >>> strip = plate * (2.0, 0.5, 1.0)
    >>> standing, other = shape_histogram(plate[:, [1, 2, 0]] + 0.3), shape_histogram(strip)
    >>> bool(standing @ shape_histogram(plate) > 0.99), bool(other @ shape_histogram(plate) < 0.97)
    (True, True)
    """
    finite: NDArray[np.float64] = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    if len(finite) < _MIN_POINTS:
        return None
    finite = finite[:: -(-len(finite) // _MAX_POINTS)]
    places = _thinned(finite)
    places = places[np.linspace(0, len(places) - 1, min(_MAX_SURFLETS, len(places))).astype(int)]
    normals = _normals(places, finite)
    first, second = np.triu_indices(len(places), 1)
    apart = places[first] - places[second]
    distance = np.linalg.norm(apart, axis=1)
    towards = apart / np.maximum(distance, 1e-9)[:, None]
    bend = np.abs((normals[first] * normals[second]).sum(axis=1))
    slope = np.maximum(
        np.abs((normals[first] * towards).sum(axis=1)),
        np.abs((normals[second] * towards).sum(axis=1)),
    )
    angles = _bin(bend, _NORMAL_BINS) * _SLOPE_BINS + _bin(slope, _SLOPE_BINS)
    # A vote is shared between neighbouring distances: noise moves points across a border.
    position = np.log(np.maximum(distance, _NEAREST_M) / _NEAREST_M)
    position *= _DISTANCE_BINS / np.log(_FARTHEST_M / _NEAREST_M)
    position = np.clip(position, 0, _DISTANCE_BINS - 1.001)
    low = position.astype(np.intp)
    share, width = position - low, _NORMAL_BINS * _SLOPE_BINS
    counts = np.bincount(low * width + angles, 1 - share, SHAPE_SIZE)
    counts += np.bincount((low + 1) * width + angles, share, SHAPE_SIZE)
    rooted: NDArray[np.float32] = np.sqrt(counts / max(counts.sum(), 1e-9)).astype(np.float32)
    return rooted


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one point (m, 3) for each voxel, so that near surfaces do not count more than far."""
    low, high = np.percentile(points, [2, 98], axis=0)
    voxel_m = max(_MIN_VOXEL_M, float(np.linalg.norm(high - low)) / _VOXELS_ACROSS)
    cells = np.floor((points - points.min(axis=0)) / voxel_m).astype(np.int64)
    sides = cells.max(axis=0) + 1
    flat = (cells[:, 0] * sides[1] + cells[:, 1]) * sides[2] + cells[:, 2]
    _, number, counts = np.unique(flat, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(number, points[:, axis]) for axis in range(3)], axis=1)
    is_dense = counts >= max(2.0, _STRAY_SHARE * float(np.median(counts)))
    means: NDArray[np.float64] = (sums / counts[:, None])[
        is_dense if is_dense.sum() > 2 else slice(None)
    ]
    return means


def _normals(places: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normals (m, 3), of either sign, of the surface around places."""
    sparse = points[:: max(1, len(points) // 3_000)]
    _, near = cKDTree(sparse).query(places, k=min(_NEIGHBOURS, len(sparse)))
    around = sparse[near] - sparse[near].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normals: NDArray[np.float64] = axes[:, :, 0]
    return normals


def _bin(cosine: NDArray[np.float64], bins: int) -> NDArray[np.intp]:
    """Return the bin of absolute cosines."""
    return np.minimum(cosine * bins, bins - 0.01).astype(np.intp)
