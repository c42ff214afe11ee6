"""Points on the table: those above the hull of its visible part (Gatto 2016, 2.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.plane import Plane, subsample

__all__ = ["Prism", "table_prism"]

_TOLERANCE_M = 0.008
_PIXEL_STEP = 3
_MANY_VERTICES = 40
_SIMPLIFY_M = 0.005


@dataclass(frozen=True)
class Prism:
    """The space above the table.

    Parameters
    ----------
    mask : leading shape of the points, bool
        Points inside.
    heights : leading shape of the points, float64, m
        Over the plane; NaN where a point is missing.
    hull : (k, 2) float, m
        Convex outline of the table, counter-clockwise in ``basis``; empty without inliers.
    basis : (2, 3) float
        Rows: directions of the hull's coordinates in the plane.
    """

    mask: NDArray[np.bool_]
    heights: NDArray[np.float64]
    hull: NDArray[np.float64]
    basis: NDArray[np.float64]

    def distance_to_edge(self, points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return how far points (n, 3) stand inside the hull, m; negative = outside."""
        return np.asarray(_depth_inside(points, self.basis, *_half_planes(self.hull)))


def table_prism(
    points: NDArray[np.floating[Any]],
    plane: Plane,
    height_min_m: float = 0.006,
    height_max_m: float = 0.5,
) -> Prism:
    """Cut out the points between two heights over the visible table.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
    plane
        Of :func:`find_table_plane`.
    height_min_m, height_max_m
        Over the plane.
    """
    basis = _basis(plane.normal)
    hull = _hull(points, plane, basis)
    frame = np.ascontiguousarray(np.vstack([basis, plane.normal]))
    mask, heights = _cut(
        points.reshape(-1, 3), frame, plane.offset, height_min_m, height_max_m, *_half_planes(hull)
    )
    shape = points.shape[:-1]
    return Prism(mask.reshape(shape), heights.reshape(shape), hull, basis)


@numba.njit(cache=True, nogil=True)
def _cut(points, frame, offset, low, high, corners, inward):  # type: ignore[no-untyped-def]
    """Return which points (n, 3) stand inside and how high all of them are."""
    n = points.shape[0]
    mask = np.zeros(n, np.bool_)
    heights = np.empty(n)
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        h = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z + offset
        heights[i] = h
        if not (low < h < high) or corners.shape[0] == 0:
            continue
        u = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
        v = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
        inside = True
        for k in range(corners.shape[0]):
            if (u - corners[k, 0]) * inward[k, 0] + (v - corners[k, 1]) * inward[k, 1] < 0:
                inside = False
                break
        mask[i] = inside
    return mask, heights


def _basis(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two unit vectors (2, 3) in the plane."""
    u = np.cross(normal, [1.0, 0.0, 0.0])
    if np.linalg.norm(u) < 0.1:
        u = np.cross(normal, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(normal, u)])


def _hull(
    points: NDArray[np.floating[Any]], plane: Plane, basis: NDArray[np.float64]
) -> NDArray[np.float64]:
    if points.ndim == 3:
        sample = points[::_PIXEL_STEP, ::_PIXEL_STEP].reshape(-1, 3).astype(np.float64)
        sample = sample[np.isfinite(sample).all(axis=1)]
    else:
        sample = subsample(points)
    on_plane = sample[np.abs(plane.heights(sample)) < _TOLERANCE_M]
    if len(on_plane) < 3:
        return np.zeros((0, 2))
    flat = np.ascontiguousarray(on_plane @ basis.T, dtype=np.float32)
    hull = cv2.convexHull(flat)
    if len(hull) > _MANY_VERTICES:
        # Simplifying cuts corners; growing by as much keeps every inlier inside.
        hull = cv2.approxPolyDP(hull, _SIMPLIFY_M, True)
        grown = _grow(hull[:, 0].astype(np.float64), _SIMPLIFY_M)
        return _counter_clockwise(grown)
    return _counter_clockwise(hull[:, 0].astype(np.float64))


def _grow(hull: NDArray[np.float64], by_m: float) -> NDArray[np.float64]:
    away = hull - hull.mean(axis=0)
    length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    return np.asarray(hull + by_m * away / length)


def _counter_clockwise(hull: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = (hull - hull.mean(axis=0)).T
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return hull if area > 0 else hull[::-1]


def _half_planes(hull: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a corner and the inward unit normal (k, 2) of each edge; none without an area."""
    if len(hull) < 3:
        return np.zeros((0, 2)), np.zeros((0, 2))
    edges = np.roll(hull, -1, axis=0) - hull
    lengths = np.linalg.norm(edges, axis=1)
    long = lengths > 1e-9
    inward = np.stack([-edges[long, 1], edges[long, 0]], axis=1) / lengths[long, None]
    return np.ascontiguousarray(hull[long]), np.ascontiguousarray(inward)


@numba.njit(cache=True, nogil=True)
def _depth_inside(points, basis, corners, inward):  # type: ignore[no-untyped-def]
    """Return the smallest signed distance (n,) of points (n, 3) to the hull's edges."""
    out = np.full(points.shape[0], np.inf if corners.shape[0] else -np.inf)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        u = basis[0, 0] * x + basis[0, 1] * y + basis[0, 2] * z
        v = basis[1, 0] * x + basis[1, 1] * y + basis[1, 2] * z
        for k in range(corners.shape[0]):
            d = (u - corners[k, 0]) * inward[k, 0] + (v - corners[k, 1]) * inward[k, 1]
            out[i] = min(out[i], d)
    return out
