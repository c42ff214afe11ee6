"""The pipeline: from a cloud to labels, from a scene to objects (Gatto 2016, 2.4 and 2.5)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.segmentation.convexity import patch_graph
from features.segmentation.merge import contract, convex_components, edge_weights
from features.segmentation.plane import Plane, find_table_plane
from features.segmentation.prism import Prism, table_prism
from features.segmentation.supervoxels import components, grow_supervoxels
from features.segmentation.voxels import VoxelGrid, build_voxels

__all__ = [
    "Scene",
    "SegmentParams",
    "Segmentation",
    "SegmentedObject",
    "segment_cloud",
    "segment_scene",
    "warm_up",
]

_MAX_DEPTH_M = 10.0
_UNIT_DEPTH_M = 50.0
_MIN_FINITE = 50
_MAX_SUPERVOXELS = 20_000
_GRAZING_COS = float(np.cos(np.deg2rad(80)))
_EDGE_M, _BORDER_SHARE = 0.010, 0.05
_METHODS = ("gaec", "components", "euclidean")


@dataclass(frozen=True)
class SegmentParams:
    """How a cloud is cut into objects.

    Parameters
    ----------
    method
        ``gaec`` (default), ``components`` (LCCP as in Gatto 2016, 2.5.2) or ``euclidean``
        (voxels that touch; a strong baseline while objects stand apart).
    voxel_m, seed_m
        Edge of a voxel and size of a supervoxel.
    height_min_m, height_max_m
        Over the table.
    base_m
        Points from here up to ``height_min_m`` go to the one object above their foot.
    min_points
        Smaller segments are dropped, after merging.
    tolerance_deg
        Concavity that still joins.
    step_tolerance
        Step that still joins, in voxels.
    bad_sanity, bad_smooth, colour_weight
        See :func:`features.segmentation.merge.edge_weights`.
    weights
        Of space, normal and colour in growing supervoxels.
    common_neighbours
        Extended convexity of ``components``.
    remove_table
        False segments the whole cloud when there is no table.
    """

    method: str = "gaec"
    voxel_m: float = 0.005
    seed_m: float = 0.020
    height_min_m: float = 0.006
    height_max_m: float = 0.5
    base_m: float = 0.003
    min_points: int = 100
    tolerance_deg: float = 20.0
    step_tolerance: float = 0.1
    bad_sanity: float = 0.05
    bad_smooth: float = -0.2
    colour_weight: float = 0.4
    weights: tuple[float, float, float] = (1.0, 4.0, 0.0)
    common_neighbours: int = 0
    remove_table: bool = True

    def __post_init__(self) -> None:
        if self.method not in _METHODS:
            raise ValueError(f"unknown method {self.method!r}: expected one of {_METHODS}")
        if not 0 < self.voxel_m <= self.seed_m:
            raise ValueError(
                f"need 0 < voxel_m <= seed_m, got {self.voxel_m} m and {self.seed_m} m"
            )

    @classmethod
    def near(cls) -> SegmentParams:
        """Return settings for a camera 0.2 to 0.5 m above small objects.

        Finer voxels, as points lie closer; printed colours say nothing about borders.
        """
        return cls(voxel_m=0.004, seed_m=0.014, height_min_m=0.006, min_points=120,
                   tolerance_deg=25.0, colour_weight=0.0)  # fmt: skip


@dataclass(frozen=True)
class Segmentation:
    """Labels of a cloud.

    Parameters
    ----------
    labels : leading shape of the points, int32
        0 = none, 1..K by falling size.
    supervoxels : leading shape of the points, int32
        -1 = none.
    counts : (K,) int64
        Points of each object.
    timings_ms
        By stage.
    """

    labels: NDArray[np.int32]
    supervoxels: NDArray[np.int32]
    counts: NDArray[np.int64]
    timings_ms: dict[str, float] = field(default_factory=dict, compare=False)


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
        More than a twentieth of it lies within 10 mm of the table's edge or at the image border.
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


def segment_cloud(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None = None,
    mask: NDArray[np.bool_] | None = None,
    params: SegmentParams | None = None,
) -> Segmentation:
    """Cut a cloud into objects.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
        Not finite, behind the camera or beyond 10 m = missing.
    colours : same leading shape, uint8 RGB, or None
    mask : leading shape, bool, or None
        Points to look at; None = all.

    Raises
    ------
    ValueError
        Shapes that do not fit, depths that are no metres, or a cloud of too many supervoxels.
    """
    params = params or SegmentParams()
    shape = _checked(points, colours, mask)
    flat = points.reshape(-1, 3)
    use = _usable(flat)
    if mask is not None:
        use &= mask.ravel()
    chosen = np.flatnonzero(use)
    labels, patches = np.zeros(len(flat), np.int32), np.full(len(flat), -1, np.int32)
    clock = _Clock()
    if len(chosen) >= 1:
        tint = None if colours is None else colours.reshape(-1, 3)[chosen]
        voxels = build_voxels(flat[chosen], tint, params.voxel_m)
        clock.lap("voxels")
        of_voxel, patch_of_voxel = _objects_of_voxels(voxels, params, clock)
        labels[chosen] = of_voxel[voxels.of_point] + 1
        patches[chosen] = patch_of_voxel[voxels.of_point]
    labels, counts = _by_size(labels, params.min_points)
    clock.lap("labels")
    return Segmentation(labels.reshape(shape), patches.reshape(shape), counts, clock.laps)


def _objects_of_voxels(
    voxels: VoxelGrid, params: SegmentParams, clock: _Clock
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the object and the supervoxel (v,) of each voxel."""
    if params.method == "euclidean":
        parts = np.asarray(components(voxels.neighbours, voxels.degrees))
        return parts, parts.astype(np.int32)
    patches = grow_supervoxels(voxels, params.voxel_m, params.seed_m, params.weights)
    if len(patches) > _MAX_SUPERVOXELS:
        raise ValueError(
            f"{len(patches)} supervoxels, at most {_MAX_SUPERVOXELS}: use a larger voxel or crop"
        )
    clock.lap("supervoxels")
    graph = patch_graph(voxels, patches, params.seed_m, params.step_tolerance, params.voxel_m)
    clock.lap("graph")
    if params.method == "components":
        objects = convex_components(
            graph, len(patches), params.tolerance_deg, params.common_neighbours
        )
    else:
        weights = edge_weights(
            graph,
            patches.colours,
            params.tolerance_deg,
            params.bad_sanity,
            params.bad_smooth,
            params.colour_weight,
        )
        objects = contract(graph.pairs, weights, len(patches))
    clock.lap("merge")
    return objects[patches.of_voxel], patches.of_voxel


def segment_scene(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None = None,
    params: SegmentParams | None = None,
    gravity: NDArray[np.floating[Any]] | None = None,
) -> Scene:
    """Find the table and the objects on it.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
    colours : same leading shape, uint8 RGB, or None
    gravity : (3,) float or None
        Direction in which things fall, in the optical frame; give it where it is known.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-0.3, 0.3, 160), np.linspace(-0.2, 0.2, 120))
    >>> z = np.where((abs(x) < 0.03) & (abs(y) < 0.03), 0.45, 0.5)
    >>> scene = segment_scene(np.stack([x, y, z], axis=-1))
    >>> scene.status, len(scene.objects)
    ('ok', 1)
    """
    params = params or SegmentParams()
    shape = _checked(points, colours, None)
    clean = np.where(_usable(points.reshape(-1, 3)).reshape(*shape, 1), points, np.nan)
    nothing = np.zeros(shape, np.int32)
    if np.count_nonzero(np.isfinite(clean[..., 2])) < _MIN_FINITE:
        return Scene("empty", None, None, nothing, ())
    clock = _Clock()
    plane = find_table_plane(clean, gravity)
    clock.lap("plane")
    if plane is None:
        if params.remove_table:
            return Scene("no_table", None, None, nothing, (), clock.laps)
        whole = segment_cloud(clean, colours, None, params)
        objects = _objects(clean, whole.labels, None)
        return Scene("no_table", None, None, whole.labels, objects, whole.timings_ms)
    prism = table_prism(clean, plane, params.height_min_m, params.height_max_m)
    clock.lap("prism")
    found = segment_cloud(clean, colours, prism.mask, params)
    labels = _give_bases(clean, found.labels, prism, params)
    clock.lap("segment")
    objects = _objects(clean, labels, prism)
    status = "ok" if objects else "table_only"
    if _is_grazing(clean, plane):
        status = "grazing"
    return Scene(status, plane, prism, labels, objects, {**clock.laps, **found.timings_ms})


def _give_bases(
    points: NDArray[np.floating[Any]],
    labels: NDArray[np.int32],
    prism: Prism,
    params: SegmentParams,
) -> NDArray[np.int32]:
    """Give low points to the one object whose footprint their foot lies under."""
    with np.errstate(invalid="ignore"):
        low = (prism.heights > params.base_m) & (prism.heights <= params.height_min_m)
    taken = labels > 0
    if not low.any() or not taken.any():
        return labels
    cell = 0.008
    owner: dict[tuple[int, int], int] = {}
    cells = np.floor(points[taken].astype(np.float64) @ prism.basis.T / cell).astype(np.int64)
    for (a, b), label in zip(map(tuple, cells.tolist()), labels[taken].tolist(), strict=True):
        key = (a, b)
        owner[key] = label if owner.get(key, label) == label else -1
    feet = np.floor(points[low].astype(np.float64) @ prism.basis.T / cell).astype(np.int64)
    given = np.array([max(owner.get((a, b), 0), 0) for a, b in feet.tolist()], np.int32)
    out = labels.copy()
    out[low] = given
    return out


def _objects(
    points: NDArray[np.floating[Any]], labels: NDArray[np.int32], prism: Prism | None
) -> tuple[SegmentedObject, ...]:
    flat, of_point = points.reshape(-1, 3), labels.ravel()
    at_border = np.zeros(labels.shape, bool)
    if labels.ndim == 2:
        at_border[[0, -1]] = at_border[:, [0, -1]] = True
    objects = []
    for label in range(1, int(of_point.max(initial=0)) + 1):
        indices = np.flatnonzero(of_point == label)
        mine = flat[indices].astype(np.float64)
        near_edge = at_border.ravel()[indices]
        if prism is not None and len(prism.hull) >= 3:
            near_edge = near_edge | (prism.distance_to_edge(mine) < _EDGE_M)
        objects.append(
            SegmentedObject(
                label,
                indices,
                mine.mean(axis=0),
                np.stack([mine.min(axis=0), mine.max(axis=0)]),
                bool(near_edge.mean() > _BORDER_SHARE),
            )
        )
    return tuple(objects)


def _checked(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None,
    mask: NDArray[np.bool_] | None,
) -> tuple[int, ...]:
    """Return the leading shape of the points, or say what does not fit."""
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        hint = "; use points_from_depth" if points.ndim == 2 else ""
        raise ValueError(f"expected (h, w, 3) or (n, 3) points in m, got {points.shape}{hint}")
    if not np.issubdtype(points.dtype, np.floating):
        raise ValueError(f"expected float points in m, got {points.dtype}")
    shape = points.shape[:-1]
    if colours is not None and (colours.shape != points.shape or colours.dtype != np.uint8):
        raise ValueError(
            f"expected uint8 colours of shape {points.shape}, got {colours.dtype} {colours.shape}"
        )
    if mask is not None and mask.shape != shape:
        raise ValueError(f"expected a mask of shape {shape}, got {mask.shape}")
    return shape


def _usable(flat: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    finite = np.isfinite(flat).all(axis=1)
    with np.errstate(invalid="ignore"):
        far = finite & (flat[:, 2] > _UNIT_DEPTH_M)
        if 2 * int(far.sum()) > max(int(finite.sum()), 1):
            raise ValueError("most points lie beyond 50 m: wrong units? expected metres")
        usable: NDArray[np.bool_] = finite & (flat[:, 2] > 0) & (flat[:, 2] <= _MAX_DEPTH_M)
    return usable


def _by_size(
    labels: NDArray[np.int32], min_points: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number the labels by falling size and drop the small ones."""
    counts = np.bincount(labels, minlength=1)
    counts[0] = 0
    order = np.lexsort((np.arange(len(counts)), -counts))
    order = order[counts[order] >= max(min_points, 1)]
    new = np.zeros(len(counts), np.int32)
    new[order] = np.arange(1, len(order) + 1)
    return new[labels], counts[order].astype(np.int64)


def _is_grazing(points: NDArray[np.floating[Any]], plane: Plane) -> bool:
    flat = points.reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        near = np.abs(plane.heights(flat)) < 0.008
    middle = flat[near].mean(axis=0)
    ray = middle / max(float(np.linalg.norm(middle)), 1e-9)
    return bool(abs(float(plane.normal @ ray)) < _GRAZING_COS)


class _Clock:
    """Milliseconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now


def warm_up() -> None:
    """Compile the kernels; they stay on disk for the next process."""
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.3, 0.3, (4000, 2)), np.full(4000, 0.5)])
    cube = rng.uniform(-0.02, 0.02, (2000, 3)) + np.array([0, 0, 0.46])
    segment_scene(np.concatenate([table, cube]))
