"""Closed surface of an object from its measured points: screened Poisson reconstruction.

Signed distances to the measurements (:mod:`features.modelling.surface`) leave open what no view
showed. The indicator function whose gradient fits the normals best (Kazhdan and Hoppe 2013) closes
it, smoothly, and is nearer to the truth where several noisy views overlap. What it closes is a
guess: every vertex says whether a measurement supports it, and nothing counts the rest as seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError, cKDTree

from features.modelling.fusion import smoothed

if TYPE_CHECKING:
    from features.modelling.grow import ObjectModel

__all__ = ["METHOD", "Reconstruction", "reconstruct"]

METHOD = "screened Poisson"
_CELL_M, _MIN_DEPTH, _MAX_DEPTH = 0.003, 4, 8
_POINTS, _MIN_POINTS = 20_000, 60
_NEIGHBOURS, _SPARSE = 9, 4.0
_LINK_M, _MIN_SHARE = 0.008, 0.05
_SEEN_M, _SEEN_SPACINGS, _ALIKE = 0.004, 2.5, 0.3
_STANDING_M, _FLOOR_M, _BOTTOM_M = 0.010, 0.003, 0.001

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A closed surface, what of it was measured, and how well it fits the measurements.

    Parameters
    ----------
    vertices : (v, 3) float64
        m, in the object's frame.
    faces : (f, 3) int64
        Counter-clockwise from outside.
    colours : (v, 3) uint8 RGB
        Those of the nearest measurements, also where nothing was seen.
    seen : (v,) bool
        Whether a measurement that faces the same way is near. The others are filled in.
    seen_share
        Share of the area between vertices that were all seen.
    median_residual_m, residual_90_m
        Median and 90 % quantile of the distances of the measured points from the surface, m.
    is_watertight
        Whether every edge belongs to exactly two faces.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    colours: NDArray[np.uint8]
    seen: NDArray[np.bool_]
    seen_share: float
    median_residual_m: float
    residual_90_m: float
    is_watertight: bool


def reconstruct(model: ObjectModel, cell_m: float = _CELL_M) -> Reconstruction:
    """Reconstruct the closed surface of an object from the views in its model.

    The same model always gives the same surface.

    Parameters
    ----------
    model
        Its frame has z = 0 at the support: what stands on it is closed there by a flat bottom.
    cell_m
        Largest edge of the smallest cells, m; coarser for objects above 70 cm.

    Raises
    ------
    ValueError
        When the model has too few points for a surface.
    """
    measured = model.cloud.astype(np.float64)
    rows = _without_outliers(smoothed(model.cloud, model.weights, _POINTS))
    if len(rows) < _MIN_POINTS:
        raise ValueError(f"{len(rows)} measured points: a surface needs {_MIN_POINTS}")
    is_standing = abs(float(rows[:, 2].min())) < _STANDING_M
    floor = _floor(rows) if is_standing else np.empty((0, 6))
    vertices, faces = _poisson(np.vstack([rows, floor]), cell_m)
    if is_standing:
        # Nothing is below the table that the object stands on.
        vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    tree = cKDTree(rows[:, :3])
    seen = _seen(vertices, faces, rows, tree)
    if is_standing:
        seen &= vertices[:, 2] > _BOTTOM_M
    vertices, faces, seen = _supported_parts(vertices, faces, seen)
    if len(faces) == 0:
        raise ValueError("no surface runs through the measured points")
    areas = _areas(vertices, faces)
    near = tree.query(measured[:, :3], distance_upper_bound=_LINK_M)[0] < _LINK_M
    residuals = _distances(vertices, faces, measured[near, :3])
    _, nearest = cKDTree(measured[:, :3]).query(vertices)
    return Reconstruction(
        vertices, faces, model.colours[nearest], seen,
        float(areas[seen[faces].all(axis=1)].sum() / areas.sum()),
        float(np.median(residuals)), float(np.quantile(residuals, 0.9)),
        _is_watertight(faces),
    )  # fmt: skip


def _without_outliers(rows: Floats) -> Floats:
    """Return points (n, 6) without lonely ones and without small clusters off the object.

    Depth at the rim of a mask may be that of the table behind, far off the object.
    """
    if len(rows) <= _NEIGHBOURS:
        return rows
    away = cKDTree(rows[:, :3]).query(rows[:, :3], k=_NEIGHBOURS)[0][:, -1]
    rows = rows[away < _SPARSE * np.median(away)]
    pairs = cKDTree(rows[:, :3]).query_pairs(
        max(_LINK_M, 3 * float(np.median(away))), output_type="ndarray"
    )
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rows),) * 2)
    part = connected_components(links, directed=False)[1]
    return np.asarray(rows[np.bincount(part)[part] >= _MIN_SHARE * len(rows)])


def _floor(rows: Floats) -> Floats:
    """Return points (n, 6) of a flat bottom below the lowest measurements, facing down."""
    low = rows[rows[:, 2] < _STANDING_M, :2]
    try:
        hull = Delaunay(low)
    except (QhullError, ValueError):  # too few, or on one line
        return np.empty((0, 6))
    first, last = low.min(axis=0), low.max(axis=0) + _FLOOR_M
    axes = [np.arange(first[axis], last[axis], _FLOOR_M) for axis in (0, 1)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = grid[hull.find_simplex(grid) >= 0]
    bottom = np.zeros((len(inside), 6))
    bottom[:, :2], bottom[:, 5] = inside, -1.0
    return bottom


def _poisson(rows: Floats, cell_m: float) -> tuple[Floats, NDArray[np.int64]]:
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(rows[:, :3]))
    cloud.normals = open3d.utility.Vector3dVector(rows[:, 3:])
    size = 1.1 * float(np.ptp(rows[:, :3], axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(size / cell_m)), _MIN_DEPTH, _MAX_DEPTH))
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        # Several threads sum in another order each time.
        mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=depth, linear_fit=True, n_threads=1
        )
    return np.array(mesh.vertices), np.array(mesh.triangles, np.int64)


def _seen(
    vertices: Floats, faces: NDArray[np.int64], rows: Floats, tree: cKDTree
) -> NDArray[np.bool_]:
    spacing = float(np.median(tree.query(rows[:: max(len(rows) // 500, 1), :3], k=2)[0][:, 1]))
    away, nearest = tree.query(vertices)
    normals = np.zeros_like(vertices)
    across = _cross(vertices, faces)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    alike = np.einsum("vi,vi->v", normals, rows[nearest, 3:])
    near = away < max(_SEEN_M, _SEEN_SPACINGS * spacing)
    return np.asarray(near & (alike > _ALIKE))


def _supported_parts(
    vertices: Floats, faces: NDArray[np.int64], seen: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.bool_]]:
    """Return the connected parts of a surface that were seen to some extent, renumbered."""
    ends = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]]])
    links = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2)
    part = connected_components(links, directed=False)[1]
    support = np.bincount(part, seen)
    kept = support[part] > _MIN_SHARE * seen.sum()
    number = np.cumsum(kept) - 1
    return vertices[kept], number[faces[kept[faces[:, 0]]]], seen[kept]


def _cross(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _areas(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    return np.asarray(np.linalg.norm(_cross(vertices, faces), axis=1) / 2)


def _is_watertight(faces: NDArray[np.int64]) -> bool:
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def _distances(vertices: Floats, faces: NDArray[np.int64], points: Floats) -> Floats:
    """Return distances (n,) of points from a surface, m."""
    import open3d

    scene: Any = open3d.t.geometry.RaycastingScene()
    tensor: Any = open3d.core.Tensor.from_numpy
    scene.add_triangles(tensor(vertices.astype(np.float32)), tensor(faces.astype(np.uint32)))
    away = scene.compute_distance(tensor(points.astype(np.float32)))
    return np.asarray(away.numpy(), np.float64)
