"""From a frame of a table to the objects on it (Gatto 2016, 2.4 and 2.5)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.overhang import with_overhang
from features.segmentation.plane import Plane, find_table_plane
from features.segmentation.prism import Prism, table_prism
from features.segmentation.segment import (
    Clock,
    SegmentParams,
    check_cloud,
    number_by_size,
    segment_cloud,
    usable_points,
)
from features.segmentation.standing import join_standing_parts
from features.segmentation.thin import add_thin_objects

__all__ = ["Scene", "SegmentedObject", "segment_scene", "warm_up"]

_MIN_FINITE = 50
_GRAZING_COS = float(np.cos(np.deg2rad(80)))
_ON_PLANE_M = 0.008
_EDGE_M, _BORDER_SHARE = 0.010, 0.05
_FOOT_CELL_M, _FOOT_REACH = 0.004, 1


@dataclass(frozen=True)
class SegmentedObject:
    """One object of a scene.

    Parameters
    ----------
    label
        In the scene's labels.
    indices : (n,) int64
        Into the flattened points.
    centroid : (3,) float64, m
    box : (2, 3) float64, m
        Smallest and largest coordinates.
    touches_border
        More than a twentieth of it lies within 10 mm of the table's edge or of the image border.
    """

    label: int
    indices: NDArray[np.int64]
    centroid: NDArray[np.float64]
    box: NDArray[np.float64]
    touches_border: bool


@dataclass(frozen=True)
class Scene:
    """A table and what stands on it.

    Parameters
    ----------
    status
        ``ok``, ``empty``, ``no_table``, ``table_only`` or ``grazing`` (the table is seen edge-on).
    plane, prism
        None without a table.
    labels : leading shape of the points, int32
    objects
        By falling size.
    """

    status: str
    plane: Plane | None
    prism: Prism | None
    labels: NDArray[np.int32]
    objects: tuple[SegmentedObject, ...]
    timings_ms: dict[str, float] = field(default_factory=dict, compare=False)


def segment_scene(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None = None,
    params: SegmentParams | None = None,
    gravity: NDArray[np.floating[Any]] | None = None,
    viewpoints: NDArray[np.floating[Any]] | None = None,
    body: NDArray[np.bool_] | None = None,
) -> Scene:
    """Find the table and the objects on it.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
    colours : same leading shape, uint8 RGB, or None
    params
        None = those that suit the distance, see :meth:`SegmentParams.for_distance`.
    gravity : (3,) float or None
        Direction in which things fall, in the optical frame; give it where it is known.
    viewpoints : (n, 3) float or None, m
        Camera from which each point was measured, in the frame of the points; None = the origin.
    body : same leading shape, bool, or None
        Points of the robot's own body, which stand on the table but are no object. What of them
        lies in the plane of the table is table.

    Raises
    ------
    ValueError
        Shapes that do not fit, depths that are no metres, or a gravity that is no direction.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-0.3, 0.3, 160), np.linspace(-0.2, 0.2, 120))
    >>> z = np.where((abs(x) < 0.03) & (abs(y) < 0.03), 0.55, 0.6)
    >>> scene = segment_scene(np.stack([x, y, z], axis=-1))
    >>> scene.status, len(scene.objects)
    ('ok', 1)
    """
    shape = check_cloud(points, colours, None)
    usable = usable_points(points.reshape(-1, 3))
    nothing = np.zeros(shape, np.int32)
    if np.count_nonzero(usable) < _MIN_FINITE:
        return Scene("empty", None, None, nothing, ())
    clock = Clock()
    clean = _without_strays(points, usable)
    plane = find_table_plane(clean, gravity)
    clock.lap("plane")
    if plane is None:
        params = params or SegmentParams()
        if params.remove_table:
            return Scene("no_table", None, None, nothing, (), clock.laps)
        whole = segment_cloud(clean, colours, None, params, viewpoints)
        objects = _objects(clean, whole.labels, None)
        return Scene("no_table", None, None, whole.labels, objects, whole.timings_ms)
    params = params or SegmentParams.for_distance(plane.offset)
    if body is not None:
        clean = _without_body(clean, plane, body, params.height_min_m)
    prism = table_prism(clean, plane, params.height_min_m, params.height_max_m)
    if params.overhang_m > 0:
        heights = params.height_min_m, params.height_max_m
        reach = params.overhang_m
        prism = with_overhang(clean, prism, heights, params.voxel_m, reach, plane.offset)
    clock.lap("prism")
    segmented = segment_cloud(clean, colours, prism.mask, params, viewpoints)
    clock.lap("segment")
    labels = segmented.labels
    if params.join_standing:
        labels = _join_standing(clean, labels, prism)
    labels = _give_bases(clean, labels, prism, params)
    if params.thin_objects and colours is not None and labels.ndim == 2:
        labels = _add_thin(clean, colours, labels, prism, params)
    clock.lap("bases")
    objects = _objects(clean, labels, prism)
    clock.lap("objects")
    status = "ok" if objects else "table_only"
    if _is_grazing(clean, plane, prism):
        status = "grazing"
    return Scene(status, plane, prism, labels, objects, {**segmented.timings_ms, **clock.laps})


def _without_strays(
    points: NDArray[np.floating[Any]], usable: NDArray[np.bool_]
) -> NDArray[np.floating[Any]]:
    """Return the points, those that cannot be used as NaN; mostly they already are."""
    strays = np.flatnonzero(~usable)
    if np.isnan(points.reshape(-1, 3)[strays, 2]).all():
        return points
    clean = points.copy()
    clean.reshape(-1, 3)[strays] = np.nan
    return clean


def _without_body(
    points: NDArray[np.floating[Any]], plane: Plane, body: NDArray[np.bool_], height_m: float
) -> NDArray[np.floating[Any]]:
    """Return the points, those of the robot's body that do not lie in the plane as NaN."""
    flat = points.reshape(-1, 3)
    own = np.flatnonzero(body)
    heights = plane.heights(flat[own])
    clean = flat.copy()
    clean[own[np.abs(heights) > height_m]] = np.nan
    return clean.reshape(points.shape)


def _join_standing(
    points: NDArray[np.floating[Any]], labels: NDArray[np.int32], prism: Prism
) -> NDArray[np.int32]:
    taken = np.flatnonzero(labels)
    if not len(taken):
        return labels
    flat = points.reshape(-1, 3)[taken].astype(np.float64)
    heights = prism.heights.ravel()[taken]
    joined = labels.copy()
    joined.reshape(-1)[taken] = join_standing_parts(
        flat @ prism.basis.T, heights, labels.ravel()[taken]
    )
    return number_by_size(joined.ravel(), 1)[0].reshape(labels.shape)


def _add_thin(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8],
    labels: NDArray[np.int32],
    prism: Prism,
    params: SegmentParams,
) -> NDArray[np.int32]:
    height_m, fewest = params.height_min_m, params.min_points
    labelled = add_thin_objects(points, colours, labels, prism, height_m, fewest)
    return (
        labels
        if labelled is labels
        else number_by_size(labelled.ravel(), 1)[0].reshape(labels.shape)
    )


def _give_bases(
    points: NDArray[np.floating[Any]],
    labels: NDArray[np.int32],
    prism: Prism,
    params: SegmentParams,
) -> NDArray[np.int32]:
    """Give low points to the one object whose footprint their foot lies under or beside."""
    low = np.asarray(_between(prism.heights.ravel(), params.base_m, params.height_min_m))
    taken = np.flatnonzero(labels)
    if not len(low) or not len(taken):
        return labels
    flat = points.reshape(-1, 3)
    feet = [_feet(flat, some, prism.basis, _FOOT_CELL_M) for some in (taken, low)]
    first = feet[0].min(axis=0) - _FOOT_REACH
    size = feet[0].max(axis=0) + _FOOT_REACH + 1 - first
    given = _under(feet[0] - first, labels.ravel()[taken], feet[1] - first, size)
    out = labels.copy()
    out.reshape(-1)[low] = given
    # An object may have gained more points than a larger one: the numbers follow the sizes.
    return number_by_size(out.ravel(), 1)[0].reshape(labels.shape)


@numba.njit(cache=True, nogil=True)
def _between(heights, low, high):  # type: ignore[no-untyped-def]
    """Return the indices of the heights in (low, high]."""
    rows = np.empty(heights.shape[0], np.int64)
    count = 0
    for i in range(heights.shape[0]):
        if low < heights[i] <= high:
            rows[count] = i
            count += 1
    return rows[:count].copy()


@numba.njit(cache=True, nogil=True)
def _feet(points, chosen, basis, cell_m):  # type: ignore[no-untyped-def]
    """Return the cells (m, 2) of the table below the chosen points."""
    feet = np.empty((chosen.shape[0], 2), np.int64)
    for i in range(chosen.shape[0]):
        x, y, z = points[chosen[i], 0], points[chosen[i], 1], points[chosen[i], 2]
        for k in range(2):
            at = basis[k, 0] * x + basis[k, 1] * y + basis[k, 2] * z
            feet[i, k] = np.int64(np.floor(at / cell_m))
    return feet


@numba.njit(cache=True, nogil=True)
def _under(feet, owners, low, size):  # type: ignore[no-untyped-def]
    """Return the label (m,) of the only footprint near each low cell, 0 = none or several."""
    grid = np.zeros((size[0], size[1]), np.int32)
    for i in range(feet.shape[0]):
        a, b = feet[i, 0], feet[i, 1]
        if grid[a, b] == 0:
            grid[a, b] = owners[i]
        elif grid[a, b] != owners[i]:
            grid[a, b] = -1
    given = np.zeros(low.shape[0], np.int32)
    for i in range(low.shape[0]):
        label = np.int32(0)
        for a in range(low[i, 0] - _FOOT_REACH, low[i, 0] + _FOOT_REACH + 1):
            for b in range(low[i, 1] - _FOOT_REACH, low[i, 1] + _FOOT_REACH + 1):
                if a < 0 or b < 0 or a >= size[0] or b >= size[1] or grid[a, b] == 0:
                    continue
                if label == 0:
                    label = grid[a, b]
                elif label != grid[a, b]:
                    label = np.int32(-1)
        given[i] = max(label, np.int32(0))
    return given


def _objects(
    points: NDArray[np.floating[Any]], labels: NDArray[np.int32], prism: Prism | None
) -> tuple[SegmentedObject, ...]:
    flat, of_point = points.reshape(-1, 3), labels.ravel()
    taken = np.flatnonzero(of_point)
    order = taken[np.argsort(of_point[taken], kind="stable")]
    counts = np.bincount(of_point[taken], minlength=1)[1:]
    at_border = np.zeros(labels.shape, bool)
    if labels.ndim == 2:
        rim = _rim_px(points)
        at_border[:rim] = at_border[-rim:] = at_border[:, :rim] = at_border[:, -rim:] = True
    near_edge = at_border.ravel()[order]
    if prism is not None and len(prism.hull) >= 3:
        near_edge = near_edge | (prism.distance_to_edge(flat.take(order, axis=0)) < _EDGE_M)
    ends = np.cumsum(counts)
    means, boxes, shares = _extents(flat, order, near_edge, ends)
    return tuple(
        SegmentedObject(
            k + 1, order[ends[k] - counts[k] : ends[k]], means[k], boxes[k],
            bool(shares[k] > _BORDER_SHARE),
        )
        for k in range(len(counts))
    )  # fmt: skip


def _rim_px(points: NDArray[np.floating[Any]]) -> int:
    """Return how many pixels of an organised cloud (h, w, 3) span 10 mm, at least 1."""
    some = points[:: max(len(points) // 16, 1)]
    steps = np.abs(np.diff(some[..., 0], axis=1))
    steps = steps[steps > 0]  # leaves out NaN too
    return max(1, round(_EDGE_M / float(np.median(steps)))) if len(steps) else 1


@numba.njit(cache=True, nogil=True)
def _extents(points, order, near_edge, ends):  # type: ignore[no-untyped-def]
    """Return the mean (k, 3), box (k, 2, 3) and share near an edge (k,) of runs of points."""
    number = ends.shape[0]
    means, shares = np.zeros((number, 3)), np.zeros(number)
    boxes = np.empty((number, 2, 3))
    start = 0
    for k in range(number):
        boxes[k, 0], boxes[k, 1] = np.inf, -np.inf
        for i in range(start, ends[k]):
            shares[k] += near_edge[i]
            for axis in range(3):
                value = points[order[i], axis]
                means[k, axis] += value
                boxes[k, 0, axis] = min(boxes[k, 0, axis], value)
                boxes[k, 1, axis] = max(boxes[k, 1, axis], value)
        size = max(ends[k] - start, 1)
        means[k] /= size
        shares[k] /= size
        start = ends[k]
    return means, boxes, shares


def _is_grazing(points: NDArray[np.floating[Any]], plane: Plane, prism: Prism) -> bool:
    with np.errstate(invalid="ignore"):
        near = np.flatnonzero(np.abs(prism.heights.ravel()[::7]) < _ON_PLANE_M)
    if not len(near):
        return False
    middle = points.reshape(-1, 3)[::7].take(near, axis=0).mean(axis=0)
    ray = middle / max(float(np.linalg.norm(middle)), 1e-9)
    return bool(abs(float(plane.normal @ ray)) < _GRAZING_COS)


def warm_up() -> None:
    """Compile the kernels; they stay on disk for the next process."""
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.3, 0.3, (4000, 2)), np.full(4000, 0.5)])
    cube = rng.uniform(-0.02, 0.02, (2000, 3)) + np.array([0, 0, 0.46])
    cloud = np.concatenate([table, cube])
    for dtype in (np.float32, np.float64):
        segment_scene(cloud.astype(dtype))
