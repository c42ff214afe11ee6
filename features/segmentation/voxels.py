"""Points gathered in small cubes: sums per voxel, neighbours, normals.

All sums are moments, so that a neighbourhood's covariance is a sum of its voxels' moments and
duplicated points do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["VoxelGrid", "build_voxels", "find_cell"]

_MIN_EIGENVALUE_M2 = 1e-10


@dataclass(frozen=True)
class VoxelGrid:
    """Occupied voxels in the order in which points first fell into them.

    Parameters
    ----------
    of_point : (n,) int32
        Voxel of each point.
    neighbours, degrees : (v, 26) int32, (v,) int32
        Occupied voxels that share a face, an edge or a corner; the first ``degrees`` count.
    centroids : (v, 3) float64, m
    colours : (v, 3) float64
        Mean RGB in 0..1.
    counts : (v,) float64
        Points.
    normals : (v, 3) float64
        Over two rings of neighbours, towards the camera; zeros where there is none.
    """

    of_point: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    degrees: NDArray[np.int32]
    centroids: NDArray[np.float64]
    colours: NDArray[np.float64]
    counts: NDArray[np.float64]
    normals: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.counts)


@numba.njit(cache=True, nogil=True)
def _slot(a, b, c, mask):  # type: ignore[no-untyped-def]
    h = (a * 73856093) ^ (b * 19349663) ^ (c * 83492791)
    h ^= h >> 15
    return h & mask


@numba.njit(cache=True, nogil=True)
def find_cell(table, keys, a, b, c):  # type: ignore[no-untyped-def]
    """Return (voxel or -1, slot) of a cell by linear probing."""
    mask = table.shape[0] - 1
    slot = _slot(a, b, c, mask)
    while True:
        voxel = table[slot]
        if voxel < 0:
            return -1, slot
        if keys[voxel, 0] == a and keys[voxel, 1] == b and keys[voxel, 2] == c:
            return voxel, slot
        slot = (slot + 1) & mask


@numba.njit(cache=True, nogil=True)
def _middle(points):  # type: ignore[no-untyped-def]
    """Return the mean (3,) of points."""
    total = np.zeros(3)
    for i in range(points.shape[0]):
        for k in range(3):
            total[k] += points[i, k]
    return total / max(points.shape[0], 1)


@numba.njit(cache=True, nogil=True)
def _assign(points, shift, size_m, table):  # type: ignore[no-untyped-def]
    """Return the keys (v, 3) of the occupied cells and the voxel (n,) of each point."""
    n = points.shape[0]
    keys = np.empty((n, 3), np.int64)
    of_point = np.empty(n, np.int32)
    count = 0
    for i in range(n):
        a = np.int64(np.floor((points[i, 0] - shift[0]) / size_m))
        b = np.int64(np.floor((points[i, 1] - shift[1]) / size_m))
        c = np.int64(np.floor((points[i, 2] - shift[2]) / size_m))
        voxel, slot = find_cell(table, keys, a, b, c)
        if voxel < 0:
            voxel = count
            table[slot] = voxel
            keys[voxel, 0], keys[voxel, 1], keys[voxel, 2] = a, b, c
            count += 1
        of_point[i] = voxel
    return keys[:count].copy(), of_point


@numba.njit(cache=True, nogil=True)
def _gather(points, colours, shift, of_point, number):  # type: ignore[no-untyped-def]
    """Return moments (v, 10) about ``shift`` and the mean colours (v, 3) of the voxels."""
    moments = np.zeros((number, 10))
    tints = np.zeros((number, 3))
    for i in range(points.shape[0]):
        voxel = of_point[i]
        x, y, z = points[i, 0] - shift[0], points[i, 1] - shift[1], points[i, 2] - shift[2]
        m = moments[voxel]
        m[0] += 1
        m[1] += x
        m[2] += y
        m[3] += z
        m[4] += x * x
        m[5] += x * y
        m[6] += x * z
        m[7] += y * y
        m[8] += y * z
        m[9] += z * z
    if colours.shape[0]:
        for i in range(points.shape[0]):
            for k in range(3):
                tints[of_point[i], k] += colours[i, k]
        for voxel in range(number):
            for k in range(3):
                tints[voxel, k] /= 255 * moments[voxel, 0]
    return moments, tints


@numba.njit(cache=True, nogil=True)
def _index(keys, table):  # type: ignore[no-untyped-def]
    """Enter the cells into a table."""
    for voxel in range(keys.shape[0]):
        _, slot = find_cell(table, keys, keys[voxel, 0], keys[voxel, 1], keys[voxel, 2])
        table[slot] = voxel


@numba.njit(cache=True, nogil=True)
def _adjacency(table, keys):  # type: ignore[no-untyped-def]
    """Return the voxels in the 26 cells around each, in the order of the cells, and their number.

    Each pair is looked up once: the 13 cells ahead, of which the 13 behind are the mirror.
    """
    n = keys.shape[0]
    ahead = np.full((n, 13), -1, np.int32)
    behind = np.full((n, 13), -1, np.int32)
    for voxel in range(n):
        for side in range(13):
            cell = side + 14
            other, _ = find_cell(
                table,
                keys,
                keys[voxel, 0] + cell // 9 - 1,
                keys[voxel, 1] + cell // 3 % 3 - 1,
                keys[voxel, 2] + cell % 3 - 1,
            )
            if other >= 0:
                ahead[voxel, side] = other
                behind[other, side] = voxel
    neighbours = np.full((n, 26), -1, np.int32)
    degrees = np.zeros(n, np.int32)
    for voxel in range(n):
        degree = 0
        for side in range(26):
            other = behind[voxel, 12 - side] if side < 13 else ahead[voxel, side - 13]
            if other >= 0:
                neighbours[voxel, degree] = other
                degree += 1
        degrees[voxel] = degree
    return neighbours, degrees


@numba.njit(cache=True, nogil=True)
def _spread(moments, neighbours, degrees):  # type: ignore[no-untyped-def]
    """Return each voxel's moments plus those of its neighbours."""
    out = moments.copy()
    for voxel in range(moments.shape[0]):
        for k in range(degrees[voxel]):
            other = neighbours[voxel, k]
            for m in range(10):
                out[voxel, m] += moments[other, m]
    return out


def build_voxels(
    points: NDArray[np.floating[Any]], colours: NDArray[np.uint8] | None, size_m: float
) -> VoxelGrid:
    """Gather finite points in cubes.

    Parameters
    ----------
    points : (n, 3) float, m, camera at the origin
    colours : (n, 3) uint8 RGB, or None
    size_m
        Edge of a cube.
    """
    # Second moments of far coordinates cancel; the mean is put back into the centroids.
    shift = _middle(points)
    keys, of_point = _assign(points, shift, size_m, _empty_table(len(points)))
    tint = np.zeros((0, 3), np.uint8) if colours is None else colours
    moments, tints = _gather(points, tint, shift, of_point, len(keys))
    table = _empty_table(len(keys))  # smaller than that of the points: it stays in the cache
    _index(keys, table)
    neighbours, degrees = _adjacency(table, keys)
    wide = _spread(_spread(moments, neighbours, degrees), neighbours, degrees)
    counts = moments[:, 0]
    centroids = moments[:, 1:4] / counts[:, None] + shift
    normals = _normals(wide, centroids)
    return VoxelGrid(of_point, neighbours, degrees, centroids, tints, counts, normals)


def _empty_table(entries: int) -> NDArray[np.int32]:
    return np.full(1 << int(4 * entries + 15).bit_length(), -1, np.int32)


@numba.njit(cache=True, nogil=True)
def _normals(moments, centroids):  # type: ignore[no-untyped-def]
    """Return the direction of least spread (v, 3) of each neighbourhood, towards the camera.

    Eigenvalues of a symmetric 3 x 3 matrix by the cosine formula; the eigenvector is the longest
    cross product of two rows of ``A - lambda I``, whose rows all lie across it.
    """
    normals = np.zeros((moments.shape[0], 3))
    for voxel in range(moments.shape[0]):
        n = moments[voxel, 0]
        if n < 3:
            continue
        x, y, z = moments[voxel, 1] / n, moments[voxel, 2] / n, moments[voxel, 3] / n
        xx, xy = moments[voxel, 4] / n - x * x, moments[voxel, 5] / n - x * y
        xz, yy = moments[voxel, 6] / n - x * z, moments[voxel, 7] / n - y * y
        yz, zz = moments[voxel, 8] / n - y * z, moments[voxel, 9] / n - z * z
        q = (xx + yy + zz) / 3
        a, b, c = xx - q, yy - q, zz - q
        p = np.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
        if p < 1e-15:
            continue
        det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
        phi = np.arccos(min(max(det / (2 * p * p * p), -1.0), 1.0)) / 3
        least = q + 2 * p * np.cos(phi + 2 * np.pi / 3)
        middle = 3 * q - least - (q + 2 * p * np.cos(phi))
        if middle < _MIN_EIGENVALUE_M2:
            continue
        a, b, c = xx - least, yy - least, zz - least
        # Rows (a, xy, xz), (xy, b, yz), (xz, yz, c), crossed two by two.
        best, nx, ny, nz = 0.0, 0.0, 0.0, 0.0
        for row in range(3):
            if row == 0:
                u, v, w = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
            elif row == 1:
                u, v, w = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
            else:
                u, v, w = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
            length = u * u + v * v + w * w
            if length > best:
                best, nx, ny, nz = length, u, v, w
        if best <= 0.0:
            continue
        scale = 1.0 / np.sqrt(best)
        towards = nx * centroids[voxel, 0] + ny * centroids[voxel, 1] + nz * centroids[voxel, 2]
        if towards > 0:
            scale = -scale
        normals[voxel, 0], normals[voxel, 1], normals[voxel, 2] = nx * scale, ny * scale, nz * scale
    return normals
