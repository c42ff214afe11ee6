"""Points outside the visible table that belong to what stands on it.

The table's outline ends where the image ends, where something hides the table, and at its edge.
What sticks out there is joined to the part inside if both touch in space and the part inside is not
much the smaller; walls and neighbouring furniture are not. What the image cuts off may stand wholly
outside the visible outline, its foot being out of view: it belongs to the table if it hides some of
that outline.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.segmentation.prism import Prism
from features.segmentation.supervoxels import components
from features.segmentation.voxels import build_voxels

__all__ = ["with_overhang"]

_MIN_POINTS = 30
_MAX_SHARE = 1.5
_HIDING_SHARE = 0.5
_RIM_SHARE = 0.02
_MAX_CUT = 1.9
"""Times the reach; points beyond twice the reach are not looked at, so that a thing that goes on
there is not mistaken for one that ends."""


def with_overhang(
    points: NDArray[np.floating[Any]],
    prism: Prism,
    heights_m: tuple[float, float],
    voxel_m: float,
    reach_m: float,
    camera_height_m: float,
) -> Prism:
    """Return the prism with what its objects have outside the hull.

    Parameters
    ----------
    points : leading shape of the prism, 3, float, m
    heights_m
        Least and most height over the plane.
    voxel_m
        Points in neighbouring cubes of this edge touch.
    reach_m
        Farthest from the hull that an object sticks out.
    camera_height_m
        Of the origin of the points over the plane.
    """
    heights = prism.heights.ravel()
    with np.errstate(invalid="ignore"):
        tall = (heights > heights_m[0]) & (heights < heights_m[1])
    outside = np.flatnonzero(tall & ~prism.mask.ravel())
    if len(outside) < _MIN_POINTS or not prism.mask.any():
        return prism
    flat = points.reshape(-1, 3)
    inside_by = prism.distance_to_edge(flat.take(outside, axis=0))
    near = outside[inside_by > -2 * reach_m]
    if len(near) < _MIN_POINTS:
        return prism
    whole = np.concatenate([np.flatnonzero(prism.mask.ravel()), near])
    voxels = build_voxels(flat, None, voxel_m, whole)
    # A wall behind the table is touched by its foot, not by what stands on the table.
    of = np.asarray(components(voxels.starts, voxels.neighbours))[voxels.of_point]
    is_out = np.arange(len(whole)) >= len(whole) - len(near)
    out = np.bincount(of[is_out], minlength=of.max() + 1)
    within = np.bincount(of[~is_out], minlength=of.max() + 1)
    away = np.zeros(of.max() + 1)
    np.maximum.at(away, of[is_out], -inside_by[inside_by > -2 * reach_m])
    joined = (within >= _MIN_POINTS) & (out <= _MAX_SHARE * within) & (away <= reach_m)
    if points.ndim == 3:
        hides = _hides_table(flat.take(near, axis=0), heights[near], prism, camera_height_m)
        hiding = np.bincount(of[is_out], weights=hides, minlength=of.max() + 1)
        is_cut = np.zeros(of.max() + 1, bool)
        is_cut[of[is_out][_on_rim(near, prism.mask.shape)]] = True
        seen = (out >= _MIN_POINTS) & (hiding > _HIDING_SHARE * out)
        joined |= is_cut & seen & (away < _MAX_CUT * reach_m)
    mask = prism.mask.ravel().copy()
    mask[near[joined[of[is_out]]]] = True
    return replace(prism, mask=mask.reshape(prism.mask.shape))


def _hides_table(
    points: NDArray[np.floating[Any]],
    heights_m: NDArray[np.float64],
    prism: Prism,
    camera_height_m: float,
) -> NDArray[np.bool_]:
    """Return which points (n, 3) have the visible table behind them, seen from the camera."""
    drop = camera_height_m - heights_m
    below = drop > 0  # a ray through a higher point never meets the table
    behind = points[below] * (camera_height_m / drop[below])[:, None]
    hides = np.zeros(len(points), bool)
    hides[below] = prism.distance_to_edge(behind) >= 0
    return hides


def _on_rim(indices: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which pixels lie at the border of an image (h, w)."""
    rows, columns = np.unravel_index(indices, shape)
    beside = np.minimum(rows, shape[0] - 1 - rows) < max(1, _RIM_SHARE * shape[0])
    across = np.minimum(columns, shape[1] - 1 - columns) < max(1, _RIM_SHARE * shape[1])
    return np.asarray(beside | across)
