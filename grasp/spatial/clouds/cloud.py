"""Cloud prepared for a hand search: evenly sampled, oriented, separated from its table."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.clouds.neighbours import PointGrid
from grasp.spatial.clouds.surfaces import estimate_normals
from grasp.spatial.collision import Support
from grasp.spatial.meshes.mesh import Mesh, surfels

__all__ = ["SURFEL_VOXELS", "SurfaceCloud", "prepare_cloud"]

Flags = NDArray[np.bool_]

SURFEL_VOXELS = 1.5
"""Edge of the square that stands for a point, so that squares leave no gaps."""

_MAX_RAW = 500_000
_MAX_VOXELS = 40_000
_FAR_M = 2.0
_ABSURD_M = 1e6
_TABLE_VOXELS, _OVER_TABLE_VOXELS = 2.0, 3
_FLAT_VOXELS = 0.1
_THIN_VOXELS = 0.5


@dataclass(frozen=True)
class SurfaceCloud:
    """Points at even distances with normals.

    Parameters
    ----------
    points : (n, 3), m
        One for each occupied voxel.
    normals : (n, 3)
        Unit, out of the object; zeros where unknown.
    target : (n,) bool
        Belongs to what shall be grasped, not to the table or to obstacles.
    counted : (n,) bool
        The normal is good enough to tell whether a jaw is opposed: not at a silhouette.
    completed : (n,) bool
        Assumed, not seen.
    voxel
        m.
    viewpoints : (k, 3), m
        Of the cameras; k = 0 when unknown.
    table : (4,) or None
        Unit normal and offset of the support, n . p + d = height over it, m.
    notes
        What was done to the input, for people.
    reason
        Why there is nothing to grasp; "" when there is.
    """

    points: FloatArray
    normals: FloatArray
    target: Flags
    counted: Flags
    completed: Flags
    voxel: float
    viewpoints: FloatArray
    table: FloatArray | None = None
    notes: tuple[str, ...] = ()
    reason: str = ""
    _grids: dict[float, PointGrid] = field(default_factory=dict, compare=False, repr=False)

    def grid(self, cell: float) -> PointGrid:
        """Return all points sorted into cells of ``cell`` m; kept for the next call."""
        if cell not in self._grids:
            self._grids[cell] = PointGrid.of(self.points, cell)
        return self._grids[cell]

    @cached_property
    def axes(self) -> FloatArray:
        """Axes of the object (3, 3), rows, longest first; see :func:`own_axes`."""
        return own_axes(self.points[self.target & ~self.completed])

    @property
    def centroid(self) -> FloatArray:
        """Mean of the object's points (3,), m."""
        return np.asarray(self.points[self.target].mean(axis=0))

    @property
    def support(self) -> Support | None:
        """The table as what a gripper keeps off; None without a table."""
        if self.table is None:
            return None
        x, y, z, offset = (float(value) for value in self.table)
        return Support(-offset, (x, y, z))

    @property
    def obstacles(self) -> FloatArray:
        """Points (m, 3), m, of what else stands there, without the table."""
        others = self.points[~self.target]
        if self.table is None:
            return others
        heights = others @ self.table[:3] + self.table[3]
        return np.asarray(others[heights > _OVER_TABLE_VOXELS * self.voxel])

    def surface(self) -> Mesh:
        """Return the target, seen and completed, as small squares where its normals are known."""
        has_normal = self.target & (np.linalg.norm(self.normals, axis=1) > 0)
        return surfels(
            self.points[has_normal], self.normals[has_normal], SURFEL_VOXELS * self.voxel
        )

    def with_points(self, points: FloatArray, normals: FloatArray) -> SurfaceCloud:
        """Return the cloud and points (m, 3) with normals that are assumed, not seen."""
        n, m = len(self.points), len(points)
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            normals=np.concatenate([self.normals, normals]),
            target=np.concatenate([self.target, np.ones(m, bool)]),
            counted=np.concatenate([self.counted, np.ones(m, bool)]),
            completed=np.concatenate([self.completed, np.ones(m, bool)]) if n else np.ones(m, bool),
            _grids={},
        )


def prepare_cloud(
    points: FloatArray,
    *,
    table: FloatArray | None = None,
    viewpoints: FloatArray | None = None,
    obstacles: FloatArray | None = None,
    voxel: float = 0.003,
    normal_radius: float = 0.01,
    silhouette_deg: float = 70.0,
    flat: bool = False,
) -> SurfaceCloud:
    """Make a cloud even and find its normals.

    The voxels lie along the object's own axes, so that a moved object gives the moved cloud.

    Parameters
    ----------
    points : (n, 3), m
        One object, or a table with what stands on it. Rows that are not finite, or beyond any
        earthly distance, are left out.
    table : (4,) or None
        Plane n . p + d = 0 under the objects, n upwards; points near it are not part of them.
    viewpoints : (k, 3) or None, m
        Where cameras were; None = all around, normals then point away from the centroid.
    obstacles : (m, 3) or None, m
        What else stands there.
    voxel
        Edge, m; enlarged, with a note, where more than 40,000 would be occupied.
    normal_radius
        Of the neighbourhood of a normal, m.
    silhouette_deg
        Normals further than this from the view ray are not counted on.
    flat
        Whether one plane is enough, as for a suction cup; needs viewpoints, which tell its sides
        apart. Otherwise jaws have to know how thick the object is.

    Returns
    -------
    With a ``reason`` when nothing is left that could be grasped.

    Raises
    ------
    ValueError
        When an array has the wrong shape or a number is out of range.
    """
    points = _checked(points, "points")
    others = np.empty((0, 3)) if obstacles is None else _checked(obstacles, "obstacles")
    cameras = np.empty((0, 3)) if viewpoints is None else _checked(viewpoints, "viewpoints")
    if not np.isfinite(cameras).all():
        raise ValueError("viewpoints must be finite")
    plane = None if table is None else _unit_plane(table)
    if not (0 < voxel < 0.1 and normal_radius >= voxel):
        raise ValueError(f"expected 0 < voxel < 0.1 m <= normal_radius, got {voxel}")
    notes: list[str] = []
    own = _cropped(points, notes)
    others = others[(np.abs(others) < _ABSURD_M).all(axis=1)]
    if len(own) == 0:
        return _nothing(cameras, plane, voxel, notes, "the cloud holds no finite point")
    others = others[np.linalg.norm(others - own.mean(axis=0), axis=1) < _FAR_M]
    height = own @ plane[:3] + plane[3] if plane is not None else np.full(len(own), np.inf)
    above = height > _TABLE_VOXELS * voxel
    if not above.any():
        # A place or a line tells more than that the table, if there is one, is as high.
        little = _shapeless(own, voxel)
        trouble = little if "plane" not in little else ""
        return _nothing(cameras, plane, voxel, notes, trouble or "nothing stands on the table")
    reason = _shapeless(own[above], voxel)
    if reason and not (flat and len(cameras) and "plane" in reason):
        return _nothing(cameras, plane, voxel, notes, reason)
    axes, centre = own_axes(own[above]), own[above].mean(axis=0)
    everything = np.concatenate([own, others])
    kind = np.concatenate([above, np.zeros(len(others), bool)])
    points_left, target, voxel = _thinned(everything, kind, axes, centre, voxel, notes)
    radius = max(normal_radius, 2.5 * voxel)
    grid = PointGrid.of(points_left, radius)
    normals, has_normal = estimate_normals(grid, radius)
    normals, counted = _oriented(
        points_left,
        normals,
        cameras,
        points_left[target].mean(axis=0),
        np.cos(np.deg2rad(silhouette_deg)),
    )
    assumed = np.zeros(len(points_left), bool)
    return SurfaceCloud(
        points_left,
        normals,
        target,
        counted & has_normal,
        assumed,
        voxel,
        cameras,
        plane,
        tuple(notes),
    )


def own_axes(points: FloatArray) -> FloatArray:
    """Return the principal axes of points (n, 3) as rows, longest first, right-handed.

    Each points to where the points reach further, so that the axes move with them.
    """
    offset = points - points.mean(axis=0)
    axes = np.linalg.eigh(offset.T @ offset)[1].T[::-1].copy()
    for k in range(2):
        if np.sum((offset @ axes[k]) ** 3) < 0:
            axes[k] *= -1
    axes[2] = np.cross(axes[0], axes[1])
    return axes


def _checked(points: FloatArray, name: str) -> FloatArray:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} must have shape (n, 3) in m, got {array.shape}")
    return array


def _unit_plane(table: FloatArray) -> FloatArray:
    plane = np.asarray(table, dtype=np.float64)
    if plane.shape != (4,) or not np.isfinite(plane).all() or not np.any(plane[:3]):
        raise ValueError("table must be a plane (4,): its upward normal and n . p + d = 0, in m")
    return plane / float(np.linalg.norm(plane[:3]))


def _nothing(
    cameras: FloatArray, plane: FloatArray | None, voxel: float, notes: list[str], reason: str
) -> SurfaceCloud:
    none, flags = np.empty((0, 3)), np.empty(0, bool)
    return SurfaceCloud(
        none, none, flags, flags, flags, voxel, cameras, plane, tuple(notes), reason
    )


def _cropped(points: FloatArray, notes: list[str]) -> FloatArray:
    finite = (np.abs(points) < _ABSURD_M).all(axis=1)  # false for nan too
    if not finite.all():
        notes.append(f"{int((~finite).sum())} points that are not finite left out")
        points = points[finite]
    if len(points) > _MAX_RAW:
        step = -(-len(points) // _MAX_RAW)
        notes.append(f"every {step}th of {len(points)} points taken")
        points = points[::step]
    if len(points):
        offset = np.abs(points - np.median(points, axis=0)).max(axis=1)
        near = offset < _FAR_M
        if not near.all():
            notes.append(f"{int((~near).sum())} points further than {_FAR_M:g} m left out")
            points = points[near]
    return points


def _shapeless(points: FloatArray, voxel: float) -> str:
    """Return why points have no volume to close around, or ""."""
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T, ddof=0)), 0.0))
    if len(points) < 3 or spread[2] < _THIN_VOXELS * voxel:
        return "all points lie in one place"
    if spread[1] < _FLAT_VOXELS * voxel:
        return "all points lie on one line"
    if spread[0] < _FLAT_VOXELS * voxel:
        return "all points lie in one plane: how thick the object is has not been seen"
    return ""


def _thinned(
    points: FloatArray,
    kind: Flags,
    axes: FloatArray,
    centre: FloatArray,
    voxel: float,
    notes: list[str],
) -> tuple[FloatArray, Flags, float]:
    """Return the mean of the points in each voxel, whether most are the object's, the edge."""
    local = (points - centre) @ axes.T
    requested = voxel
    while True:
        cells = np.floor(local / voxel).astype(np.int64)
        cells -= cells.min(axis=0)
        shape = cells.max(axis=0) + 1
        keys = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        if len(starts) <= _MAX_VOXELS:
            break
        voxel *= max(1.05, float(np.sqrt(len(starts) / _MAX_VOXELS)))
    if voxel > requested:
        notes.append(f"voxels enlarged from {1e3 * requested:.3g} to {1e3 * voxel:.3g} mm")
    counts = np.diff(np.append(starts, len(keys)))
    means = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    share = np.add.reduceat(kind[order].astype(np.float64), starts) / counts
    return means, share > 0.5, voxel


def _oriented(
    points: FloatArray,
    normals: FloatArray,
    cameras: FloatArray,
    centroid: FloatArray,
    least_cos: float,
) -> tuple[FloatArray, Flags]:
    """Turn normals out of the object; return them and which are seen well enough."""
    if len(cameras) == 0:
        outward = np.einsum("ij,ij->i", normals, points - centroid)
        return np.where(outward[:, None] < 0, -normals, normals), np.ones(len(points), bool)
    rays = cameras[None] - points[:, None]
    rays /= np.maximum(np.linalg.norm(rays, axis=2, keepdims=True), 1e-9)
    cosines = np.einsum("ikj,ij->ik", rays, normals)
    # Of several cameras the one that looks at the surface most squarely has seen it.
    steepest = np.argmax(np.abs(cosines), axis=1)
    facing = cosines[np.arange(len(points)), steepest]
    return np.where(facing[:, None] < 0, -normals, normals), np.abs(facing) > least_cos
