"""From a cloud to labels: voxels, supervoxels, convexity, merging (Gatto 2016, 2.5)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.convexity import patch_graph
from features.segmentation.merge import contract, convex_components, edge_weights
from features.segmentation.supervoxels import components, grow_supervoxels
from features.segmentation.voxels import VoxelGrid, build_voxels, facing

__all__ = [
    "Clock",
    "SegmentParams",
    "Segmentation",
    "check_cloud",
    "number_by_size",
    "segment_cloud",
    "usable_points",
]

_MAX_DEPTH_M = 10.0
_UNIT_DEPTH_M = 50.0
_MAX_SUPERVOXELS = 20_000
_NEAR_M = 0.5
_FEATURES = ("normals", "39d")
_METHODS = ("gaec", "components", "euclidean")


@dataclass(frozen=True)
class SegmentParams:
    """Parameters of segmenting a cloud into objects.

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
    features
        What supervoxels grow by: ``normals``, or ``39d`` (position, CIELab, FPFH; Gatto 2016,
        2.5.1), which is slower and no better.
    common_neighbours
        Extended convexity of ``components``.
    join_standing
        Join what floats and stands wholly on something larger, such as a neck on its bottle.
    remove_table
        False segments the whole cloud when there is no table.
    overhang_m
        How far an object may stick out of the visible table; 0 = cut it off there.
    thin_objects
        Find what is lower than ``height_min_m`` by its colour, in organised clouds with colours.
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
    features: str = "normals"
    common_neighbours: int = 0
    join_standing: bool = False
    remove_table: bool = True
    overhang_m: float = 0.15
    thin_objects: bool = True

    def __post_init__(self) -> None:
        if self.method not in _METHODS:
            raise ValueError(f"unknown method {self.method!r}: expected one of {_METHODS}")
        if self.features not in _FEATURES:
            raise ValueError(f"unknown features {self.features!r}: expected one of {_FEATURES}")
        if not 0 < self.voxel_m <= self.seed_m < np.inf:
            raise ValueError(
                f"need finite 0 < voxel_m <= seed_m, got {self.voxel_m} m and {self.seed_m} m"
            )

    @classmethod
    def near(cls) -> SegmentParams:
        """Return settings for a camera 0.2 to 0.5 m above small objects.

        Finer voxels, as points lie closer; a bottle keeps its neck.
        """
        return cls(voxel_m=0.004, seed_m=0.016, min_points=120, join_standing=True)

    @classmethod
    def for_distance(cls, distance_m: float) -> SegmentParams:
        """Return :meth:`near` settings when the table is less than 0.5 m away, else the default."""
        return cls.near() if distance_m < _NEAR_M else cls()


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


def segment_cloud(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None = None,
    mask: NDArray[np.bool_] | None = None,
    params: SegmentParams | None = None,
    viewpoints: NDArray[np.floating[Any]] | None = None,
) -> Segmentation:
    """Cut a cloud into objects.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
        Not finite, behind the camera or beyond 10 m = missing.
    colours : same leading shape, uint8 RGB, or None
    mask : leading shape, bool, or None
        Points to look at; None = all.
    viewpoints : (n, 3) float or None, m
        Camera from which each of the flattened points was measured; None = the origin.

    Raises
    ------
    ValueError
        Shapes that do not fit, depths that are no metres, or a cloud of too many supervoxels.
    """
    params = params or SegmentParams()
    shape = check_cloud(points, colours, mask)
    flat = points.reshape(-1, 3)
    use = usable_points(flat)
    if mask is not None:
        use &= mask.ravel()
    chosen = np.flatnonzero(use)
    clock = Clock()
    if not len(chosen):
        none = np.zeros(shape, np.int32)
        return Segmentation(none, none - 1, np.zeros(0, np.int64), clock.laps)
    tint = None if colours is None else colours.reshape(-1, 3)
    voxels = build_voxels(flat, tint, params.voxel_m, chosen)
    if viewpoints is not None:
        voxels = facing(voxels, viewpoints[chosen])
    clock.lap("voxels")
    of_voxel, patches = _objects_of_voxels(voxels, params, clock)
    # Points are counted, not voxels: a voxel far from the camera holds few of them, a near one
    # many.
    sizes = np.bincount(of_voxel, weights=voxels.counts).astype(np.int64)
    new, counts = _ranks(sizes, params.min_points)
    labels, patch_labels = _hand_down(chosen, voxels.of_point, new[of_voxel], patches, len(flat))
    clock.lap("labels")
    return Segmentation(labels.reshape(shape), patch_labels.reshape(shape), counts, clock.laps)


@numba.njit(cache=True, nogil=True)
def _hand_down(chosen, of_point, of_voxel, patches, number):  # type: ignore[no-untyped-def]
    """Return the object and the supervoxel of each of ``number`` points."""
    labels, patch_labels = np.zeros(number, np.int32), np.full(number, -1, np.int32)
    for i in range(chosen.shape[0]):
        labels[chosen[i]] = of_voxel[of_point[i]]
        patch_labels[chosen[i]] = patches[of_point[i]]
    return labels, patch_labels


def _objects_of_voxels(
    voxels: VoxelGrid, params: SegmentParams, clock: Clock
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the object and the supervoxel (v,) of each voxel."""
    if params.method == "euclidean":
        parts = np.asarray(components(voxels.starts, voxels.neighbours))
        return parts.astype(np.int64), parts
    patches = grow_supervoxels(
        voxels, params.voxel_m, params.seed_m, params.weights, params.features
    )
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


def check_cloud(
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


def usable_points(flat: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Return which points (n, 3) are finite, before the camera and within 10 m along each axis.

    Raises
    ------
    ValueError
        When most points lie beyond 50 m: such depths are no metres.
    """
    usable, finite, far = _usable(flat)
    if 2 * far > max(finite, 1):
        raise ValueError("most points lie beyond 50 m: wrong units? expected metres")
    return np.asarray(usable)


@numba.njit(cache=True, nogil=True)
def _usable(flat):  # type: ignore[no-untyped-def]
    usable = np.zeros(flat.shape[0], np.bool_)
    finite = far = 0
    for i in range(flat.shape[0]):
        x, y, z = flat[i, 0], flat[i, 1], flat[i, 2]
        if np.isfinite(x) and np.isfinite(y) and np.isfinite(z):
            finite += 1
            far += z > _UNIT_DEPTH_M
            usable[i] = 0 < z <= _MAX_DEPTH_M and max(abs(x), abs(y)) <= _MAX_DEPTH_M
    return usable, finite, far


def number_by_size(
    labels: NDArray[np.int32], min_points: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number the labels by falling size and drop the small ones."""
    sizes = np.bincount(labels, minlength=1).astype(np.int64)
    # 0 means no object, and would often be the largest one.
    sizes[0] = 0
    new, counts = _ranks(sizes, min_points)
    return new[labels], counts


def _ranks(sizes: NDArray[np.int64], fewest: int) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the rank (k,) of each size, from 1, 0 = too small, and the sizes by rank."""
    # Stable, so that equal sizes are numbered alike on every processor.
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= max(fewest, 1)]
    ranks = np.zeros(len(sizes), np.int32)
    ranks[order] = np.arange(1, len(order) + 1)
    return ranks, sizes[order]


class Clock:
    """Milliseconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now
