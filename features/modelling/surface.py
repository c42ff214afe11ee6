"""A mesh from an oriented cloud: signed distances on a grid, then naive surface nets.

The distance of a grid point is that to the tangent planes of its nearest measurements (Hoppe 1992);
a cell that the surface crosses gets one vertex (Gibson 1998). Far from any measurement there is no
distance, hence no surface: what was not seen stays open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["mesh_to_ply", "surface_of"]

_NEIGHBOURS = 10
_BAND_CELLS = 2.2
_MAX_CELLS = 8_000_000
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def surface_of(
    cloud: NDArray[np.float32], colours: NDArray[np.uint8], cell_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Return vertices (v, 3) m, faces (f, 3) counter-clockwise from outside, colours (v, 3).

    Parameters
    ----------
    cloud : (n, 6) float32
        Places, m, and outward unit normals.
    colours : (n, 3) uint8
    cell_m
        Edge of a grid cell.

    Raises
    ------
    ValueError
        When the grid would be too large for the cell.
    """
    nothing = np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty((0, 3), np.uint8)
    if len(cloud) < _NEIGHBOURS:
        return nothing
    low = cloud[:, :3].min(axis=0) - 3 * cell_m
    shape = np.ceil((cloud[:, :3].max(axis=0) + 3 * cell_m - low) / cell_m).astype(int) + 1
    if np.prod(shape.astype(float)) > _MAX_CELLS:
        raise ValueError(f"a grid of {shape.tolist()} cells of {cell_m} m: take larger cells")
    tree = cKDTree(cloud[:, :3])
    distance = _signed_distances(cloud, tree, low, shape, cell_m)
    vertices, number = _vertices(distance, low, cell_m)
    if len(vertices) == 0:
        return nothing
    faces = _faces(distance, number)
    used, again = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], again.reshape(faces.shape)
    _, nearest = tree.query(vertices)
    return vertices, faces, colours[nearest]


def _signed_distances(
    cloud: NDArray[np.float32],
    tree: cKDTree,
    low: NDArray[np.float32],
    shape: NDArray[np.int64],
    cell_m: float,
) -> NDArray[np.float64]:
    """Return the grid (a, b, c) of signed distances, NaN far from any measurement."""
    axes = [low[i] + np.arange(shape[i]) * cell_m for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest, _ = tree.query(grid, distance_upper_bound=_BAND_CELLS * cell_m)
    near = np.flatnonzero(np.isfinite(nearest))
    away, rows = tree.query(grid[near], k=_NEIGHBOURS)
    weight = np.exp(-((away / (1.2 * cell_m)) ** 2)) + 1e-12
    offset = grid[near][:, None] - cloud[rows, :3]
    along = np.einsum("nki,nki->nk", offset, cloud[rows, 3:].astype(np.float64))
    field = np.full(len(grid), np.nan)
    field[near] = (weight * along).sum(axis=1) / weight.sum(axis=1)
    return field.reshape(shape)


def _vertices(
    distance: NDArray[np.float64], low: NDArray[np.float32], cell_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return one vertex for each crossed cell, and the number of each cell's, -1 = none."""
    size = np.array(distance.shape) - 1
    corner = [
        distance[x : x + size[0], y : y + size[1], z : z + size[2]] for x, y, z in _CORNERS.tolist()
    ]
    values = np.stack(corner, axis=-1)
    with np.errstate(invalid="ignore"):
        crossed = np.isfinite(values).all(axis=-1)
        crossed &= (values < 0).any(axis=-1) & (values >= 0).any(axis=-1)
    cells = np.argwhere(crossed)
    number = np.full(crossed.shape, -1, np.int64)
    number[crossed] = np.arange(len(cells))
    mine = values[crossed]
    total, count = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a in range(8):
        for b in range(a + 1, 8):
            if np.abs(_CORNERS[a] - _CORNERS[b]).sum() != 1:
                continue
            cuts = (mine[:, a] < 0) != (mine[:, b] < 0)
            span = np.where(cuts, mine[:, a] - mine[:, b], 1.0)
            t = (mine[:, a] / span)[:, None]
            total += np.where(cuts[:, None], _CORNERS[a] + t * (_CORNERS[b] - _CORNERS[a]), 0)
            count += cuts
    return low + (cells + total / np.maximum(count, 1)[:, None]) * cell_m, number


def _faces(distance: NDArray[np.float64], number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return two triangles for each grid edge that the surface cuts."""
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        low = np.moveaxis(distance, (axis, first, second), (0, 1, 2))
        cells = np.moveaxis(number, (axis, first, second), (0, 1, 2))
        start, end = low[:-1, 1:-1, 1:-1], low[1:, 1:-1, 1:-1]
        with np.errstate(invalid="ignore"):
            cut = np.isfinite(start) & np.isfinite(end) & ((start < 0) != (end < 0))
        around = np.stack(
            [cells[:, :-1, :-1], cells[:, 1:, :-1], cells[:, 1:, 1:], cells[:, :-1, 1:]], axis=-1
        )
        quads = around[cut]
        leaving = (start < 0)[cut]
        whole = (quads >= 0).all(axis=1)
        quads, leaving = quads[whole], leaving[whole]
        quads = np.where(leaving[:, None], quads, quads[:, ::-1])
        faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return np.concatenate(faces)


def mesh_to_ply(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    colours: NDArray[np.uint8],
    seen: NDArray[np.bool_] | None = None,
) -> bytes:
    """Return a binary PLY file of a coloured mesh.

    Parameters
    ----------
    seen : (v,) bool, optional
        Stored as the vertex property ``seen``, 0 or 1.

    Examples
    --------
    >>> corners = np.eye(3)
    >>> mesh_to_ply(corners, np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8))[:3]
    b'ply'
    """
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"{'' if seen is None else 'property uchar seen' + chr(10)}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    extra = [] if seen is None else [("seen", "u1")]
    corners = np.zeros(len(vertices), [("place", "<f4", 3), ("colour", "u1", 3), *extra])
    corners["place"], corners["colour"] = vertices, colours
    if seen is not None:
        corners["seen"] = seen
    triangles = np.zeros(len(faces), [("count", "u1"), ("corner", "<i4", 3)])
    triangles["count"], triangles["corner"] = 3, faces
    return head.encode() + corners.tobytes() + triangles.tobytes()
