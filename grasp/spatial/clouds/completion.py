"""Completion of the unseen side of an object from the visible side.

Household objects are symmetric: about a vertical plane, or under half a turn about a vertical axis
(Bohg et al. 2011). A guess is held against what the camera saw: a completed point must lie behind
the visible surface, never in space seen empty. Walls fall from the visible top to the table where
nothing contradicts them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grasp.arrays import FloatArray
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.clouds.neighbours import within

__all__ = [
    "Symmetry",
    "SymmetryGuesses",
    "compare_symmetries",
    "complete_by_symmetry",
]


_PLANES = 11
_ACROSS_RAD = 0.62
_OFFSETS = 21
_SIDEWAYS = 9
_MOST = 400
_TOLERANCE_VOXELS = 1.5
# No round numbers: else points in rows lie at the search's limits, and rounding decides.
_WALL_CELL, _WALL_RISE = 1.4837, 0.9713
_CAP_M = 0.02
_OUTSIDE_M = 0.01
_BEHIND = 0.01
_PLAUSIBLE_M = 0.0015


@dataclass(frozen=True)
class Symmetry:
    """A mirror plane or a half turn that maps an object onto itself.

    Parameters
    ----------
    linear : (3, 3)
        Reflection, or rotation by half a turn.
    offset : (3,), m
        A point p goes to ``linear @ p + offset``.
    kind
        ``plane`` or ``turn``.
    contradiction
        How far completed points lie in space that was seen empty, mean, m.
    """

    linear: FloatArray
    offset: FloatArray
    kind: Literal["plane", "turn"]
    contradiction: float = 0.0

    def apply(self, points: FloatArray) -> FloatArray:
        """Return images of points (n, 3), m."""
        return points @ self.linear.T + self.offset


@dataclass(frozen=True, eq=False)
class SymmetryGuesses:
    """Mirrors and half turns of an object, compared with what was seen of it.

    Parameters
    ----------
    options
        Of which each may be right.
    against : (n,), m
        How far completed points lie in space that was seen empty, mean.
    order : (n,), m
        The same and a little for the size of the object: the likelier, the smaller it is.
    """

    options: list[Symmetry]
    against: FloatArray
    order: FloatArray

    @property
    def best(self) -> Symmetry | None:
        """The vertical plane or half turn that the view contradicts least, if it is plausible."""
        best = int(np.argmin(self.order))
        if self.against[best] > _PLAUSIBLE_M:
            return None
        return replace(self.options[best], contradiction=float(self.against[best]))


def complete_by_symmetry(
    cloud: SurfaceCloud, guesses: SymmetryGuesses | None = None
) -> SurfaceCloud:
    """Return the cloud with the hidden side added, its points marked as completed.

    Walls fall from the visible surface's edge to the table besides.

    Parameters
    ----------
    cloud
        Of one object, with one viewpoint or more.
    guesses
        What :func:`compare_symmetries` returned for it; None = they are compared here.

    Returns
    -------
    The same cloud where no symmetry is plausible.
    """
    if cloud.reason or len(cloud.viewpoints) == 0:
        return cloud
    guesses = guesses or compare_symmetries(cloud)
    symmetry = None if guesses is None else guesses.best
    added: list[tuple[FloatArray, FloatArray]] = []
    if symmetry is not None:
        chosen = cloud.target & ~cloud.completed & cloud.counted
        image = symmetry.apply(cloud.points[chosen])
        normals = cloud.normals[chosen] @ symmetry.linear.T
        added.append((image, normals))
    if cloud.table is not None:
        added.append(_walls(cloud))
    for points, normals in added:
        keep = _hidden(cloud, points)
        cloud = cloud.with_points(points[keep], normals[keep])
    return cloud


def compare_symmetries(cloud: SurfaceCloud) -> SymmetryGuesses | None:
    """Return the mirrors and half turns that a view may be completed by, and what it says of them.

    None where there is no table, no camera or too little to see: vertical is along its normal.
    """
    if cloud.reason or cloud.table is None or len(cloud.viewpoints) == 0:
        return None
    up = cloud.table[:3]
    seen = cloud.points[cloud.target & ~cloud.completed]
    if len(seen) < 20:
        return None
    drawn = seen[:: max(1, len(seen) // _MOST)]
    views = [_View.of(cloud, camera) for camera in cloud.viewpoints]
    ahead = seen.mean(axis=0) - cloud.viewpoints[0]
    ahead -= (ahead @ up) * up
    length = float(np.linalg.norm(ahead))
    ahead = _level_axis(cloud) if length < 1e-6 else ahead / length
    side = np.cross(up, ahead)
    options = [*_planes(seen, ahead, side), *_turns(seen, up, ahead, side)]
    images = np.stack([option.apply(drawn) for option in options])
    return SymmetryGuesses(options, *_contradictions(views, images))


def _level_axis(cloud: SurfaceCloud) -> FloatArray:
    """Return the longest axis of a cloud on a table that is not upright, laid level (3,)."""
    assert cloud.table is not None
    up = cloud.table[:3]
    level = cloud.axes[0] - (cloud.axes[0] @ up) * up
    if np.linalg.norm(level) < 1e-3:
        level = cloud.axes[1] - (cloud.axes[1] @ up) * up
    return np.asarray(level / np.linalg.norm(level))


def _planes(seen: FloatArray, ahead: FloatArray, side: FloatArray) -> list[Symmetry]:
    """Return mirrors in vertical planes that stand across the view, through and behind what is
    seen. Planes along the view map what is seen onto itself and tell nothing."""
    mirrors = []
    for angle in np.linspace(-_ACROSS_RAD, _ACROSS_RAD, _PLANES):
        normal = np.cos(angle) * ahead + np.sin(angle) * side
        along = seen @ normal
        low, high = np.quantile(along, (0.02, 0.98))
        # From the middle of what is seen to as much again behind it.
        reach = high + float(np.cos(angle)) * (high - low + 0.01)
        linear = np.eye(3) - 2 * np.outer(normal, normal)
        for d in np.linspace((low + high) / 2 - 0.1 * (high - low), reach, _OFFSETS):
            mirrors.append(Symmetry(linear, 2 * d * normal, "plane"))
    return mirrors


def _turns(seen: FloatArray, up: FloatArray, ahead: FloatArray, side: FloatArray) -> list[Symmetry]:
    """Return half turns about vertical axes through and behind what is seen."""
    linear = 2 * np.outer(up, up) - np.eye(3)
    depth, across = seen @ ahead, seen @ side
    near, far = np.quantile(depth, (0.02, 0.98))
    left, right = np.quantile(across, (0.02, 0.98))
    turns = []
    for d in np.linspace((near + far) / 2, far + (far - near) / 2 + 0.01, _OFFSETS):
        for s in (left + right) / 2 + np.linspace(-0.15, 0.15, _SIDEWAYS) * (right - left):
            turns.append(Symmetry(linear, 2 * (d * ahead + s * side), "turn"))
    return turns


@dataclass(frozen=True)
class _View:
    """Depth of the visible object along rays from one camera.

    Parameters
    ----------
    camera, rotation : (3,), (3, 3)
        Rows of the rotation: right, down, forward.
    low, cell
        Corner and edge of the picture's cells, in units of depth one.
    depth : (h, w)
        m; inf where the object is not seen.
    """

    camera: FloatArray
    rotation: FloatArray
    low: FloatArray
    cell: float
    depth: FloatArray

    @classmethod
    def of(cls, cloud: SurfaceCloud, camera: FloatArray) -> _View:
        seen = cloud.points[cloud.target & ~cloud.completed] - camera
        forward = seen.mean(axis=0)
        distance = float(np.linalg.norm(forward))
        forward = forward / distance
        # Upright along an axis of the object: a moved scene gives the moved picture.
        right = np.cross(forward, cloud.axes[int(np.argmin(np.abs(cloud.axes @ forward)))])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        local = seen @ rotation.T
        flat = local[:, :2] / np.maximum(local[:, 2:], 1e-6)
        # A voxel's width on the screen; each point fills the cells around its own.
        cell = cloud.voxel / distance
        low = flat.min(axis=0) - 3.5 * cell
        size = np.ceil((flat.max(axis=0) - low) / cell).astype(np.int64) + 4
        depth = np.full((min(int(size[1]), 2000), min(int(size[0]), 2000)), np.inf)
        column, row = np.floor((flat - low) / cell).astype(np.int64).T
        inside = (column < depth.shape[1] - 1) & (row < depth.shape[0] - 1)
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                np.minimum.at(depth, (row[inside] + dr, column[inside] + dc), local[inside, 2])
        return cls(camera, rotation, low, cell, depth)

    def behind(self, points: FloatArray) -> FloatArray:
        """Return how far points (n, 3) lie behind the visible surface, m; -inf beside it."""
        local = np.ascontiguousarray((points - self.camera) @ self.rotation.T)
        return np.asarray(_behind(local, self.low, self.cell, self.depth))


@numba.njit(cache=True, nogil=True)
def _behind(local, low, cell, depth):  # type: ignore[no-untyped-def]
    out = np.full(local.shape[0], -np.inf)
    for k in range(local.shape[0]):
        z = local[k, 2]
        if z <= 1e-6:
            continue
        column = int(np.floor((local[k, 0] / z - low[0]) / cell))
        row = int(np.floor((local[k, 1] / z - low[1]) / cell))
        inside = 0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]
        if inside and depth[row, column] < np.inf:
            out[k] = z - depth[row, column]
    return out


def _contradictions(views: list[_View], images: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what speaks against completed points, and what orders guesses that nothing speaks
    against, both as means over the points of each guess (o,), m.

    Space seen empty, in front or beside, contradicts. Of two guesses that nothing contradicts the
    smaller is the likelier: what lies far behind the visible surface costs a little.

    Parameters
    ----------
    images : (o, n, 3), m
        The completed points of each guess.
    """
    flat = images.reshape(-1, 3)
    # What any camera saw as empty is empty.
    behind = np.min([view.behind(flat) for view in views], axis=0).reshape(images.shape[:2])
    front = np.clip(-behind, 0.0, _CAP_M)
    front[np.isneginf(behind)] = _OUTSIDE_M
    far = _BEHIND * np.clip(behind, 0.0, None)
    return front.mean(axis=1), (front + far).mean(axis=1)


def _hidden(cloud: SurfaceCloud, points: FloatArray) -> NDArray[np.bool_]:
    """Tell which points no camera saw as empty, the table does not hold, and nobody knows yet."""
    keep = np.ones(len(points), bool)
    if len(points) == 0:
        return keep
    tolerance = _TOLERANCE_VOXELS * cloud.voxel
    for camera in cloud.viewpoints:
        keep &= _View.of(cloud, camera).behind(points) > -tolerance
    if cloud.table is not None:
        keep &= points @ cloud.table[:3] + cloud.table[3] > cloud.voxel
    grid = cloud.grid(2 * cloud.voxel)
    taken = np.empty(len(cloud.points), np.int64)
    for k in np.flatnonzero(keep):
        keep[k] = within(*grid.arrays, points[k], cloud.voxel, taken) == 0
    return keep


def _walls(cloud: SurfaceCloud) -> tuple[FloatArray, FloatArray]:
    """Return points and normals of walls from the edge of the visible top down to the table.

    The object is looked at from above as a map of heights; where a cell has a much lower or no
    neighbour, the difference is filled.
    """
    assert cloud.table is not None
    up = cloud.table[:3]
    east = _level_axis(cloud)
    north = np.cross(up, east)
    seen = cloud.points[cloud.target]
    height = seen @ up + cloud.table[3]
    flat = np.stack([seen @ east, seen @ north], axis=1)
    cell, rise = _WALL_CELL * cloud.voxel, _WALL_RISE * cloud.voxel
    low = flat.min(axis=0) - 2.5 * cell
    size = np.ceil((flat.max(axis=0) - low) / cell).astype(np.int64) + 3
    top = np.zeros((size[0], size[1]))
    index = np.floor((flat - low) / cell).astype(np.int64)
    np.maximum.at(top, (index[:, 0], index[:, 1]), height)
    top = ndimage.grey_closing(top, 3)
    # Walls look down the slope of the blurred heights: not only along the map's own directions.
    slope = np.stack(np.gradient(ndimage.gaussian_filter(np.minimum(top, top.mean()), 1.0)))
    points: list[FloatArray] = []
    normals: list[FloatArray] = []
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        neighbour = np.roll(top, (-dx, -dy), axis=(0, 1))
        for i, j in np.argwhere(top - neighbour > 2 * cloud.voxel):
            levels = np.arange(neighbour[i, j] + rise, top[i, j] - rise / 3, rise)
            x = low + (np.array([i, j]) + 0.5 + 0.5 * np.array([dx, dy])) * cell
            foot = x[0] * east + x[1] * north - cloud.table[3] * up
            down = -slope[:, i, j] if np.any(slope[:, i, j]) else np.array([dx, dy], float)
            normal = (down[0] * east + down[1] * north) / np.hypot(*down)
            points.append(foot + levels[:, None] * up)
            normals.append(np.broadcast_to(normal, (len(levels), 3)))
    if not points:
        return np.empty((0, 3)), np.empty((0, 3))
    return np.concatenate(points), np.concatenate(normals)
