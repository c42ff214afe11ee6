"""Points gathered in small cubes: sums per voxel, neighbours, normals.

All sums are moments, so that a neighbourhood's covariance is a sum of its voxels' moments and
duplicated points do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "VoxelGrid",
    "build_voxels",
    "cell_key",
    "empty_table",
    "facing",
    "find_slot",
    "number_cells",
]

_MIN_EIGENVALUE_M2 = 1e-10
_AXIS_BITS = 20
_HALF_AXIS = 1 << (_AXIS_BITS - 1)
_DIGIT_BITS = 11
_FIRST_CELLS = 8_192
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True)
class VoxelGrid:
    """Occupied voxels in the order in which points first fell into them.

    Parameters
    ----------
    of_point : (n,) int32
        Voxel of each point.
    starts, neighbours : (v + 1,) int32, (e,) int32
        Occupied voxels that share a face, an edge or a corner with voxel k:
        ``neighbours[starts[k] : starts[k + 1]]``.
    centroids : (v, 3) float64, m
    colours : (v, 3) float64
        Mean RGB in 0..1.
    counts : (v,) float64
        Points.
    normals : (v, 3) float64
        Over two rings of neighbours, towards the camera; zeros where there is none.
    """

    of_point: NDArray[np.int32]
    starts: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    centroids: NDArray[np.float64]
    colours: NDArray[np.float64]
    counts: NDArray[np.float64]
    normals: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.counts)


def build_voxels(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8] | None,
    size_m: float,
    chosen: NDArray[np.int64] | None = None,
) -> VoxelGrid:
    """Gather finite points in cubes.

    Parameters
    ----------
    points : (n, 3) float, m, camera at the origin
    colours : (n, 3) uint8 RGB, or None
    size_m
        Edge of a cube.
    chosen : (m,) int64, or None
        Points to gather; None = all.
    """
    if chosen is None:
        chosen = np.arange(len(points))
    tint = np.zeros((0, 3), np.uint8) if colours is None else colours
    # Second moments of far coordinates cancel; the mean is put back into the centroids.
    shift = _middle(points, chosen)
    keys, of_point = number_cells(points, chosen, shift, size_m)
    moments, tints = _moments(points, tint, chosen, shift, of_point, len(keys))
    return VoxelGrid(of_point, *_surroundings(keys, moments, tints, shift))


def facing(voxels: VoxelGrid, viewpoints: NDArray[np.floating[Any]]) -> VoxelGrid:
    """Return voxels whose normals face the cameras that saw their points.

    Parameters
    ----------
    viewpoints : (n, 3) float, m
        Of the gathered points, in their order. Of several cameras the middle counts.
    """
    sums = [
        np.bincount(voxels.of_point, weights=viewpoints[:, axis], minlength=len(voxels))
        for axis in range(3)
    ]
    rays = np.stack(sums, axis=-1) / voxels.counts[:, None] - voxels.centroids
    is_away = np.einsum("vk,vk->v", rays, voxels.normals) < 0
    return replace(voxels, normals=np.where(is_away[:, None], -voxels.normals, voxels.normals))


@numba.njit(cache=True, nogil=True)
def _surroundings(keys, moments, tints, shift):  # type: ignore[no-untyped-def]
    """Return starts, neighbours, centroids, colours, counts and normals of the voxels."""
    starts, neighbours = _adjacency(keys)
    number = keys.shape[0]
    counts, centroids = np.empty(number), np.empty((number, 3))
    for voxel in range(number):
        counts[voxel] = moments[voxel, 0]
        for k in range(3):
            centroids[voxel, k] = moments[voxel, 1 + k] / counts[voxel] + shift[k]
    wide = _spread(_spread(moments, starts, neighbours), starts, neighbours)
    return starts, neighbours, centroids, tints, counts, _normals(wide, centroids)


@numba.njit(cache=True, nogil=True)
def _middle(points, chosen):  # type: ignore[no-untyped-def]
    """Return the mean (3,) of the chosen points."""
    x = y = z = 0.0
    for i in chosen:
        x += points[i, 0]
        y += points[i, 1]
        z += points[i, 2]
    return np.array([x, y, z]) / max(chosen.shape[0], 1)


@numba.njit(cache=True, nogil=True)
def cell_key(x, y, z):  # type: ignore[no-untyped-def]
    """Return one number for the cell at (x, y, z), in cells; far ones fall into the outermost."""
    low, high = float(1 - _HALF_AXIS), float(_HALF_AXIS - 2)
    x = low if x < low else (high if x > high else x)
    y = low if y < low else (high if y > high else y)
    z = low if z < low else (high if z > high else z)
    a, b, c = np.int64(np.floor(x)), np.int64(np.floor(y)), np.int64(np.floor(z))
    a, b, c = a + _HALF_AXIS, b + _HALF_AXIS, c + _HALF_AXIS
    return a << 2 * _AXIS_BITS | b << _AXIS_BITS | c


@numba.njit(cache=True, nogil=True)
def empty_table(entries):  # type: ignore[no-untyped-def]
    """Return a table for :func:`find_slot` that this many keys fill to a half at most."""
    size = 16
    while size < 2 * entries:
        size *= 2
    return np.full(size, -1, np.int64)


@numba.njit(cache=True, nogil=True)
def find_slot(table, key):  # type: ignore[no-untyped-def]
    """Return the slot of a key, or the free one where it belongs, by linear probing."""
    mask = table.shape[0] - 1
    slot = np.int64((np.uint64(key) * _GOLDEN) >> np.uint64(40)) & mask
    while table[slot] >= 0 and table[slot] != key:
        slot = (slot + 1) & mask
    return slot


@numba.njit(cache=True, nogil=True)
def number_cells(points, chosen, shift, size_m):  # type: ignore[no-untyped-def]
    """Return the keys (v,) of the occupied cells as they come up, and the cell (m,) of each point.

    The table grows with the number of cells, so that it stays in the cache.
    """
    n = chosen.shape[0]
    keys, of_point = np.empty(n, np.int64), np.empty(n, np.int32)
    table = empty_table(_FIRST_CELLS)
    numbers = np.empty(table.shape[0], np.int32)
    done, count = _enter(points, chosen, shift, size_m, table, numbers, keys, of_point, 0, 0)
    while done < n:
        table = empty_table(4 * count)
        numbers = np.empty(table.shape[0], np.int32)
        for k in range(count):
            slot = find_slot(table, keys[k])
            table[slot], numbers[slot] = keys[k], k
        done, count = _enter(
            points, chosen, shift, size_m, table, numbers, keys, of_point, done, count
        )
    return keys[:count].copy(), of_point


@numba.njit(cache=True, nogil=True)
def _enter(  # type: ignore[no-untyped-def]
    points, chosen, shift, size_m, table, numbers, keys, of_point, done, count
):
    """Go on with numbering until the table is half full; return how far, and how many cells."""
    x0, y0, z0, per_m = shift[0], shift[1], shift[2], 1 / size_m
    for i in range(done, chosen.shape[0]):
        x, y, z = points[chosen[i], 0], points[chosen[i], 1], points[chosen[i], 2]
        key = cell_key((x - x0) * per_m, (y - y0) * per_m, (z - z0) * per_m)
        slot = find_slot(table, key)
        if table[slot] < 0:
            if 2 * count >= table.shape[0]:
                return i, count
            table[slot], numbers[slot], keys[count] = key, count, key
            count += 1
        of_point[i] = numbers[slot]
    return chosen.shape[0], count


@numba.njit(cache=True, nogil=True)
def _moments(points, colours, chosen, shift, of_point, number):  # type: ignore[no-untyped-def]
    """Return moments (v, 10) about ``shift`` and the mean colours (v, 3) of the voxels."""
    moments, tints = np.zeros((number, 10)), np.zeros((number, 3))
    coloured = colours.shape[0] > 0
    x0, y0, z0 = shift[0], shift[1], shift[2]
    for i in range(chosen.shape[0]):
        voxel, point = of_point[i], chosen[i]
        x, y, z = points[point, 0] - x0, points[point, 1] - y0, points[point, 2] - z0
        moments[voxel, 0] += 1
        moments[voxel, 1] += x
        moments[voxel, 2] += y
        moments[voxel, 3] += z
        moments[voxel, 4] += x * x
        moments[voxel, 5] += x * y
        moments[voxel, 6] += x * z
        moments[voxel, 7] += y * y
        moments[voxel, 8] += y * z
        moments[voxel, 9] += z * z
        if coloured:
            tints[voxel, 0] += colours[point, 0]
            tints[voxel, 1] += colours[point, 1]
            tints[voxel, 2] += colours[point, 2]
    if coloured:
        for voxel in range(number):
            for k in range(3):
                tints[voxel, k] /= 255 * moments[voxel, 0]
    return moments, tints


@numba.njit(cache=True, nogil=True)
def _sorted_order(keys):  # type: ignore[no-untyped-def]
    """Return the order (v,) that sorts keys, by radix: they are few bits wide beyond the least."""
    n = keys.shape[0]
    least = keys.min()
    widest = keys.max() - least
    bits = 0
    while widest >> bits:
        bits += 1
    order, spare = np.arange(n).astype(np.int32), np.empty(n, np.int32)
    size = 1 << _DIGIT_BITS
    for shift in range(0, bits, _DIGIT_BITS):
        place = np.zeros(size + 1, np.int32)
        for i in range(n):
            place[((keys[i] - least) >> shift & (size - 1)) + 1] += 1
        for digit in range(size):
            place[digit + 1] += place[digit]
        for i in range(n):
            digit = (keys[order[i]] - least) >> shift & (size - 1)
            spare[place[digit]] = order[i]
            place[digit] += 1
        order, spare = spare, order
    return order


@numba.njit(cache=True, nogil=True)
def _dense(keys):  # type: ignore[no-untyped-def]
    """Return for each key its column and its place in the column, both within their bounding box.

    A column holds the cells of equal (a, b); columns count b first, with room for b - 1 and b + 1.
    """
    n = keys.shape[0]
    a0 = b0 = c0 = np.int64(1 << _AXIS_BITS)
    b1 = c1 = np.int64(0)
    only = (1 << _AXIS_BITS) - 1
    for key in keys:
        a, b, c = key >> 2 * _AXIS_BITS, key >> _AXIS_BITS & only, key & only
        a0, b0, c0 = min(a0, a), min(b0, b), min(c0, c)
        b1, c1 = max(b1, b), max(c1, c)
    wide, deep = b1 - b0 + 3, c1 - c0 + 1
    columns, places = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        a, b, c = keys[i] >> 2 * _AXIS_BITS, keys[i] >> _AXIS_BITS & only, keys[i] & only
        columns[i] = (a - a0) * wide + b - b0 + 1
        places[i] = c - c0
    return columns, places, wide, deep


@numba.njit(cache=True, nogil=True)
def _adjacency(keys):  # type: ignore[no-untyped-def]
    """Return the voxels in the 26 cells around each, in the order of the cells.

    In the order of the keys, the cells around one lie in three runs, which move on with it: those
    of three neighbouring columns for each of a - 1, a, a + 1.
    """
    n = keys.shape[0]
    by_voxel, depth, wide, deep = _dense(keys)
    order = _sorted_order(by_voxel * deep + depth)
    columns, places = np.empty(n + 1, np.int64), np.empty(n, np.int64)
    for p in range(n):
        columns[p], places[p] = by_voxel[order[p]], depth[order[p]]
    columns[n] = np.iinfo(np.int64).max
    occupied, first = np.empty(26 * n + 1, np.int32), np.empty(n, np.int64)
    degrees = np.empty(n, np.int32)
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    at = 0
    for p in range(n):
        if p == 0 or columns[p] != columns[p - 1]:
            for row in range(3):
                middle = columns[p] + (row - 1) * wide
                while columns[low[row]] < middle - 1:
                    low[row] += 1
                high[row] = max(high[row], low[row])
                while columns[high[row]] <= middle + 1:
                    high[row] += 1
        voxel = order[p]
        first[voxel] = at
        for row in range(3):
            for q in range(low[row], high[row]):
                occupied[at] = order[q]
                at += (abs(places[q] - places[p]) <= 1) & (q != p)
        degrees[voxel] = at - first[voxel]
    starts, neighbours = np.zeros(n + 1, np.int32), np.empty(at, np.int32)
    for voxel in range(n):
        start, degree = starts[voxel], degrees[voxel]
        for k in range(degree):
            neighbours[start + k] = occupied[first[voxel] + k]
        starts[voxel + 1] = start + degree
    return starts, neighbours


@numba.njit(cache=True, nogil=True)
def _spread(moments, starts, neighbours):  # type: ignore[no-untyped-def]
    """Return each voxel's moments plus those of its neighbours.

    Ten names instead of a loop over columns keep the sums in registers.
    """
    out = np.empty_like(moments)
    for voxel in range(moments.shape[0]):
        own = moments[voxel]
        n, x, y, z = own[0], own[1], own[2], own[3]
        xx, xy, xz, yy, yz, zz = own[4], own[5], own[6], own[7], own[8], own[9]
        for k in range(starts[voxel], starts[voxel + 1]):
            other = moments[neighbours[k]]
            n += other[0]
            x += other[1]
            y += other[2]
            z += other[3]
            xx += other[4]
            xy += other[5]
            xz += other[6]
            yy += other[7]
            yz += other[8]
            zz += other[9]
        sums = out[voxel]
        sums[0], sums[1], sums[2], sums[3] = n, x, y, z
        sums[4], sums[5], sums[6], sums[7], sums[8], sums[9] = xx, xy, xz, yy, yz, zz
    return out


@numba.njit(cache=True, nogil=True)
def _least_root(trace, minors, determinant):  # type: ignore[no-untyped-def]
    """Return the least root of x^3 - trace x^2 + minors x - determinant, all of them real, >= 0.

    Newton from zero comes from below and never passes it, for the cubic is concave there.
    """
    x = 0.0
    for _ in range(60):
        value = ((x - trace) * x + minors) * x - determinant
        slope = (3 * x - 2 * trace) * x + minors
        if value >= 0.0 or slope <= 0.0:
            break
        step = value / slope
        x -= step
        if -step <= 1e-9 * x:
            break
    return x


@numba.njit(cache=True, nogil=True)
def _normals(moments, centroids):  # type: ignore[no-untyped-def]
    """Return the direction of least spread (v, 3) of each neighbourhood, towards the camera.

    The least eigenvalue of a symmetric 3 x 3 matrix is a root of its characteristic cubic; the
    eigenvector is the longest cross product of two rows of ``A - lambda I``: all lie across it.
    """
    normals = np.zeros((moments.shape[0], 3))
    for voxel in range(moments.shape[0]):
        n = moments[voxel, 0]
        if n < 3:
            continue
        share = 1 / n
        x, y, z = moments[voxel, 1] * share, moments[voxel, 2] * share, moments[voxel, 3] * share
        xx, xy = moments[voxel, 4] * share - x * x, moments[voxel, 5] * share - x * y
        xz, yy = moments[voxel, 6] * share - x * z, moments[voxel, 7] * share - y * y
        yz, zz = moments[voxel, 8] * share - y * z, moments[voxel, 9] * share - z * z
        trace = xx + yy + zz
        minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz
        det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        least = _least_root(trace, minors, det)
        # The two others add up to the rest of the trace and multiply to the rest of the minors.
        rest = trace - least
        middle = 0.5 * (rest - np.sqrt(max(rest * rest - 4 * (minors - least * rest), 0.0)))
        if middle < _MIN_EIGENVALUE_M2:
            continue
        a, b, c = xx - least, yy - least, zz - least
        # Rows (a, xy, xz), (xy, b, yz), (xz, yz, c), crossed two by two.
        nx, ny, nz = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
        best = nx * nx + ny * ny + nz * nz
        u, v, w = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
        length = u * u + v * v + w * w
        if length > best:
            best, nx, ny, nz = length, u, v, w
        u, v, w = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
        length = u * u + v * v + w * w
        if length > best:
            best, nx, ny, nz = length, u, v, w
        if best <= 0.0:
            continue
        scale = 1.0 / np.sqrt(best)
        if nx * centroids[voxel, 0] + ny * centroids[voxel, 1] + nz * centroids[voxel, 2] > 0:
            scale = -scale
        normals[voxel, 0], normals[voxel, 1], normals[voxel, 2] = nx * scale, ny * scale, nz * scale
    return normals
