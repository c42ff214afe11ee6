"""Shapes that an object seen from some sides may have: samples of an implicit surface.

What cameras saw as empty is empty; what is left, above the table, is the hull that the object lies
in. Household objects map onto themselves in a mirror or by half a turn (Bohg et al. 2011), and so
lie in the image of that hull too: where both meet is one guess of the shape. Which mirror it is
nobody knows, so each sample draws one, the likelier the less it contradicts the view, and a
Gaussian random field moves the surface, more where it was not seen (Dragiev et al. 2011; Mahler et
al. 2015; Kehoe 2014, 6.2). A surface that was seen belongs to every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import ndimage
from scipy.spatial import cKDTree

from grasp.arrays import FloatArray
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.clouds.completion import Symmetry, SymmetryGuesses, compare_symmetries

__all__ = ["ShapeSamples", "sample_shapes", "shape_value"]

_CELL_M, _MAX_NODES = 0.003, 150_000
_MARGIN_CELLS = 4
_BEHIND_M, _BEHIND_SHARE = 0.02, 1.0
_FRONT_M = 0.003
_SURFACE_CELLS, _NEIGHBOURS = 2.5, 6
_SKIN_M = 0.004
_LIKELY_M, _DOUBT, _DOUBTFUL = 0.0004, 0.2, 5.0
_RIPPLE_CELL_M, _RIPPLE_CELLS = 0.01, 1.5
_SEEN_STD_M, _HIDDEN_STD_M = 0.0005, 0.002


@dataclass(frozen=True, eq=False)
class ShapeSamples:
    """Samples of a shape, each the zero level of a distance that is positive outside.

    Parameters
    ----------
    frame : (4, 4)
        Grid from the cloud's frame, in cells.
    cell, ripple_cell
        Edge of the cells of both kinds of grids, m.
    hull, skin : (a, b, c), m
        Distance from what cameras left for the object; from the surface that was seen.
    ripple : (k, u, v, w)
        Standard normal fields, one for each sample.
    images : (k, 3, 4)
        Mirrors and half turns, in the grid's frame, in cells.
    com : (k, 3), m
        Centres of mass in the cloud's frame, at uniform density.
    volume : (k,), m3
    """

    frame: FloatArray
    cell: float
    ripple_cell: float
    hull: FloatArray
    skin: FloatArray
    ripple: FloatArray
    images: FloatArray
    com: FloatArray
    volume: FloatArray

    def __len__(self) -> int:
        return len(self.images)

    def distances(self, points: FloatArray, sample: int) -> FloatArray:
        """Return how far points (n, 3), m, lie outside a sample (n,), m; below 0 inside it.

        Near its surface; further away a number of the right sign.
        """
        local = np.ascontiguousarray(points @ self.frame[:3, :3].T + self.frame[:3, 3])
        return np.asarray(
            _values(local, self.hull, self.skin, self.ripple[sample], self.images[sample],
                    self.cell, self.cell / self.ripple_cell)
        )  # fmt: skip


def sample_shapes(
    cloud: SurfaceCloud,
    points: FloatArray,
    count: int = 24,
    seed: int = 0,
    guesses: SymmetryGuesses | None = None,
) -> ShapeSamples | None:
    """Return samples of the shape of one object on a table; None where nothing says where it ends.

    Parameters
    ----------
    cloud
        Of the object as it was seen, with its table and viewpoints.
    points : (n, 3), m
        From which the cloud was prepared: they draw its outline more sharply.
    count
        Of samples.
    guesses
        What :func:`compare_symmetries` returned for the cloud; None = they are compared here.
    """
    if cloud.reason or cloud.table is None or len(cloud.viewpoints) == 0:
        return None
    guesses = guesses or compare_symmetries(cloud)
    if guesses is None:
        return None
    rng = np.random.default_rng([0x5A9E, seed])
    frame, shape, cell = _grid_of(cloud)
    inside = np.linalg.inv(frame)
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    places = nodes.reshape(-1, 3) @ inside[:3, :3].T + inside[:3, 3]
    hull = _hull(cloud, points, places, shape, cell)
    skin = _off_seen(cloud, frame, shape, cell) - _SKIN_M
    chosen = _drawn(guesses, count, rng)
    images = np.stack([_in_grid(symmetry, frame) for symmetry in chosen])
    ripple = _ripples(count, shape, cell, rng)
    arrays = (hull, skin, ripple, images, cell, cell / _RIPPLE_CELL_M)
    volume, middle = _masses(*arrays)
    com = middle @ inside[:3, :3].T + inside[:3, 3]
    return ShapeSamples(
        frame, cell, _RIPPLE_CELL_M, hull, skin, ripple, images, com, volume * cell**3
    )


def _grid_of(cloud: SurfaceCloud) -> tuple[FloatArray, tuple[int, int, int], float]:
    """Return the grid: its coordinates, in cells, from the cloud's frame, its shape, its cell.

    It reaches as far behind what is seen as that is wide.
    """
    assert cloud.table is not None
    up = cloud.table[:3]
    seen = cloud.points[cloud.target]
    ahead = seen.mean(axis=0) - cloud.viewpoints[0]
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 1e-3:
        ahead = np.cross(up, cloud.axes[int(np.argmin(np.abs(cloud.axes @ up)))])
    ahead /= np.linalg.norm(ahead)
    axes = np.stack([ahead, np.cross(up, ahead), up])
    local = seen @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    low[2] = -cloud.table[3]
    size = high - low
    high[0] += _BEHIND_M + _BEHIND_SHARE * max(size[1], size[2])
    cell = max(_CELL_M, float(np.cbrt(np.prod(high - low + 0.02) / _MAX_NODES)))
    shape = np.ceil((high - low) / cell).astype(np.int64) + 2 * _MARGIN_CELLS + 1
    frame = np.eye(4)
    frame[:3, :3] = axes / cell
    # The table lies half way between two nodes: those below it are empty.
    frame[:3, 3] = _MARGIN_CELLS - low / cell
    frame[2, 3] -= 0.5
    return frame, (int(shape[0]), int(shape[1]), int(shape[2])), cell


def _hull(
    cloud: SurfaceCloud, points: FloatArray, places: FloatArray, shape: tuple[int, int, int],
    cell: float,
) -> FloatArray:  # fmt: skip
    """Return the signed distance, m, from what may be solid: above the table, not seen as empty."""
    assert cloud.table is not None
    own = points[np.isfinite(points).all(axis=1)]
    own = own[own @ cloud.table[:3] + cloud.table[3] > 2 * cloud.voxel]
    solid = places @ cloud.table[:3] + cloud.table[3] > 0
    for camera in cloud.viewpoints:
        # A surface is noisy: what lies a little in front of it is not empty for sure.
        solid &= _behind(own, places, camera, cloud.axes) > -_FRONT_M / 3
    solid = solid.reshape(shape)
    for axis in range(3):
        edge = np.moveaxis(solid, axis, 0)
        edge[0] = edge[-1] = False
    if not solid.any():
        return np.full(shape, cell)
    outside = ndimage.distance_transform_edt(~solid)
    within = ndimage.distance_transform_edt(solid)
    hull = cell * (outside - within + np.where(solid, 0.5, -0.5))
    hull = np.asarray(ndimage.gaussian_filter(hull, 0.7), dtype=np.float64)
    # Cells make steps; where the surface was seen it is known better.
    near = np.flatnonzero(np.abs(hull.reshape(-1)) < (_SURFACE_CELLS + 0.5) * cell)
    usable = cloud.target & ~cloud.completed & cloud.counted
    if usable.sum() < _NEIGHBOURS:
        return hull
    seen, normals = cloud.points[usable], cloud.normals[usable]
    away, which = cKDTree(seen).query(
        places[near], _NEIGHBOURS, distance_upper_bound=(_SURFACE_CELLS + 1) * cell
    )
    near_by = np.isfinite(away)
    which = np.where(near_by, which, 0)
    weight = np.where(near_by, np.exp(-((away / cloud.voxel) ** 2) / 2), 0.0) + 1e-12 * near_by
    off = np.einsum("nki,nki->nk", places[near][:, None] - seen[which], normals[which])
    total = weight.sum(axis=1)
    distance = (weight * off).sum(axis=1) / np.maximum(total, 1e-30)
    aside = np.sqrt(np.maximum(away[:, 0] ** 2 - distance**2, 0.0)) / cloud.voxel
    trust = np.where(total > 0, np.clip(2.0 - aside, 0.0, 1.0), 0.0)
    trust[~np.isfinite(trust)] = 0.0
    flat = hull.reshape(-1)
    flat[near] = trust * np.where(trust > 0, distance, 0.0) + (1 - trust) * flat[near]
    return hull


def _behind(
    points: FloatArray, places: FloatArray, camera: FloatArray, axes: FloatArray
) -> FloatArray:
    """Return how far places (n, 3) lie behind points that a camera sees, m; -inf beside them."""
    forward = points.mean(axis=0) - camera
    distance = float(np.linalg.norm(forward))
    forward = forward / distance
    right = np.cross(forward, axes[int(np.argmin(np.abs(axes @ forward)))])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    local = (points - camera) @ rotation.T
    flat = local[:, :2] / np.maximum(local[:, 2:], 1e-6)
    few = flat[:: max(1, len(flat) // 400)]
    spacing = float(np.median(cKDTree(flat).query(few, 2)[0][:, 1])) if len(flat) > 1 else 0.0
    cell = max(1.8 * spacing, 0.0015 / distance)
    low = flat.min(axis=0) - 3 * cell
    size = np.minimum(np.ceil((flat.max(axis=0) - low) / cell).astype(np.int64) + 4, 2000)
    index = np.minimum(np.floor((flat - low) / cell).astype(np.int64), size - 1)
    depth = np.full(tuple(size), np.inf)
    np.minimum.at(depth, (index[:, 0], index[:, 1]), local[:, 2])
    measured = np.isfinite(depth)
    holes = ndimage.binary_closing(measured, np.ones((3, 3)), iterations=2) & ~measured
    if holes.any():
        nearest = ndimage.distance_transform_edt(
            ~measured, return_distances=False, return_indices=True
        )
        depth[holes] = depth[tuple(nearest[:, holes])]
    spot = (places - camera) @ rotation.T
    cells = np.floor((spot[:, :2] / np.maximum(spot[:, 2:], 1e-6) - low) / cell).astype(np.int64)
    on = ((cells >= 0) & (cells < size)).all(axis=1) & (spot[:, 2] > 1e-6)
    behind = np.full(len(places), -np.inf)
    behind[on] = spot[on, 2] - depth[cells[on, 0], cells[on, 1]]
    return behind


def _off_seen(
    cloud: SurfaceCloud, frame: FloatArray, shape: tuple[int, int, int], cell: float
) -> FloatArray:
    """Return the distance of each node from the surface that was seen, m."""
    seen = cloud.points[cloud.target & ~cloud.completed] @ frame[:3, :3].T + frame[:3, 3]
    index = np.round(seen).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    empty = np.ones(shape, bool)
    empty[tuple(index[inside].T)] = False
    return np.asarray(cell * ndimage.distance_transform_edt(empty))


def _drawn(guesses: SymmetryGuesses, count: int, rng: np.random.Generator) -> list[Symmetry]:
    """Draw symmetries, the likelier the less speaks against them; a fifth with more doubt."""
    excess = (guesses.order - guesses.order.min()) / _LIKELY_M
    sharp, broad = np.exp(-excess), np.exp(-excess / _DOUBTFUL)
    share = (1 - _DOUBT) * sharp / sharp.sum() + _DOUBT * broad / broad.sum()
    # Evenly spaced over the cumulated shares: less left to luck than in independent draws.
    at = (np.arange(count) + rng.random()) / count
    which = np.searchsorted(np.cumsum(share), at * (1 - 1e-9))
    options = guesses.options
    return [options[int(i)] for i in np.minimum(which, len(options) - 1)]


def _in_grid(symmetry: Symmetry, frame: FloatArray) -> FloatArray:
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = symmetry.linear, symmetry.offset
    return np.asarray((frame @ moved @ np.linalg.inv(frame))[:3])


def _ripples(
    count: int, shape: tuple[int, int, int], cell: float, rng: np.random.Generator
) -> FloatArray:
    """Return smooth standard normal fields (count, ...) on a coarse grid."""
    coarse = [int(np.ceil(n * cell / _RIPPLE_CELL_M)) + 2 for n in shape]
    field = ndimage.gaussian_filter(
        rng.standard_normal((count, *coarse)), (0, *[_RIPPLE_CELLS] * 3), mode="wrap"
    )
    return np.asarray(field / field.std())


@njit(cache=True, nogil=True)
def _between(grid, x, y, z):  # type: ignore[no-untyped-def]
    """Return a grid's value at a place in cells; outside, that of its edge and the way there."""
    a, b, c = grid.shape
    over = 0.0
    if x < 0.0:
        over += x * x
        x = 0.0
    elif x > a - 1.001:
        over += (x - a + 1.001) ** 2
        x = a - 1.001
    if y < 0.0:
        over += y * y
        y = 0.0
    elif y > b - 1.001:
        over += (y - b + 1.001) ** 2
        y = b - 1.001
    if z < 0.0:
        over += z * z
        z = 0.0
    elif z > c - 1.001:
        over += (z - c + 1.001) ** 2
        z = c - 1.001
    i, j, k = int(x), int(y), int(z)
    u, v, w = x - i, y - j, z - k
    low = (grid[i, j, k] * (1 - w) + grid[i, j, k + 1] * w) * (1 - v) + (
        grid[i, j + 1, k] * (1 - w) + grid[i, j + 1, k + 1] * w
    ) * v
    high = (grid[i + 1, j, k] * (1 - w) + grid[i + 1, j, k + 1] * w) * (1 - v) + (
        grid[i + 1, j + 1, k] * (1 - w) + grid[i + 1, j + 1, k + 1] * w
    ) * v
    return low * (1 - u) + high * u, over


@njit(cache=True, nogil=True)
def shape_value(hull, skin, ripple, image, cell, finer, x, y, z):  # type: ignore[no-untyped-def]
    """Return how far a place, in cells of the grid, lies outside one sample, m.

    Parameters
    ----------
    finer
        Cells of the ripple for each cell of the other grids.
    """
    own, over = _between(hull, x, y, z)
    if over > 0.0:
        return own + cell * np.sqrt(over)
    if own > 0.008:
        return own
    other, over = _between(
        hull,
        image[0, 0] * x + image[0, 1] * y + image[0, 2] * z + image[0, 3],
        image[1, 0] * x + image[1, 1] * y + image[1, 2] * z + image[1, 3],
        image[2, 0] * x + image[2, 1] * y + image[2, 2] * z + image[2, 3],
    )
    other += cell * np.sqrt(over)
    moved, std = own, _SEEN_STD_M
    if other > own:
        from_seen, _ = _between(skin, x, y, z)
        other = min(other, from_seen)
        if other > own:
            moved, std = other, _HIDDEN_STD_M
    shift, _ = _between(ripple, x * finer, y * finer, z * finer)
    return moved + std * shift


@njit(cache=True, nogil=True)
def _values(places, hull, skin, ripple, image, cell, finer):  # type: ignore[no-untyped-def]
    out = np.empty(len(places))
    for n in range(len(places)):
        out[n] = shape_value(
            hull, skin, ripple, image, cell, finer, places[n, 0], places[n, 1], places[n, 2]
        )
    return out


@njit(cache=True, nogil=True)
def _masses(hull, skin, ripple, images, cell, finer):  # type: ignore[no-untyped-def]
    """Return volumes (k,) and centres (k, 3) of all samples, in cells, from every second node."""
    a, b, c = hull.shape
    volume = np.zeros(len(images))
    middle = np.zeros((len(images), 3))
    for s in range(len(images)):
        for i in range(0, a, 2):
            for j in range(0, b, 2):
                for k in range(0, c, 2):
                    if hull[i, j, k] > cell:
                        continue
                    if shape_value(hull, skin, ripple[s], images[s], cell, finer, i, j, k) < 0.0:
                        volume[s] += 8.0
                        middle[s, 0] += 8.0 * i
                        middle[s, 1] += 8.0 * j
                        middle[s, 2] += 8.0 * k
        if volume[s] > 0.0:
            middle[s] /= volume[s]
        else:
            middle[s, 0], middle[s, 1], middle[s, 2] = a / 2, b / 2, c / 2
    return volume, middle
