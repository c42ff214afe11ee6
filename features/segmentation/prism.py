"""What stands on the table: the points above the hull of its visible part (Gatto 2016, 2.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
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
        flat = points.astype(np.float64) @ self.basis.T
        return _inside_distance(flat, self.hull)


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
    heights = plane.heights(points)
    basis = _basis(plane.normal)
    hull = _hull(points, plane, basis)
    mask = np.zeros(heights.shape, bool)
    if len(hull) >= 3:
        with np.errstate(invalid="ignore"):
            between = (heights > height_min_m) & (heights < height_max_m)
        inside = _inside_distance(points[between].astype(np.float64) @ basis.T, hull) >= 0
        mask[between] = inside
    return Prism(mask, heights, hull, basis)


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
        sample = subsample(points, 0)
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


def _inside_distance(flat: NDArray[np.float64], hull: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest signed distance (n,) of points (n, 2) to the hull's edges."""
    if len(hull) < 3:
        return np.full(len(flat), -np.inf)
    edges = np.roll(hull, -1, axis=0) - hull
    lengths = np.linalg.norm(edges, axis=1)
    edges, corners = edges[lengths > 1e-9], hull[lengths > 1e-9]
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / lengths[lengths > 1e-9, None]
    distance = np.full(len(flat), np.inf)
    for corner, normal in zip(corners, inward, strict=True):
        np.minimum(distance, (flat - corner) @ normal, out=distance)
    return distance
