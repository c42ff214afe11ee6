"""Supervoxels: patches of voxels that grow from a grid of seeds without crossing boundaries.

Voxel cloud connectivity segmentation (VCCS, Papon et al. 2013): seeds in a coarse grid, growth
along voxel adjacency, distance in space, normal and colour, or in the 39 numbers of the thesis
(Gatto 2016, 2.5.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.fpfh import fpfh
from features.segmentation.voxels import VoxelGrid, cell_key, empty_table, find_slot, number_cells

__all__ = ["Supervoxels", "components", "grow_supervoxels"]

_SEED_SPACING = 0.5
_ROUNDS_PER_CELL = 1.8
_NO_DIRECTION = 1e-9
# Weights of the 39 numbers, and the CIELab distance that counts as one seed size in space.
_OF_COLOUR, _OF_SPACE, _OF_SHAPE, _COLOUR_SCALE = 0.2, 0.4, 0.3, 20.0


@dataclass(frozen=True)
class Supervoxels:
    """A partition of the voxels.

    Parameters
    ----------
    of_voxel : (v,) int32
        Supervoxel of each voxel; -1 = none (cannot happen while every component has a seed).
    centroids, normals, colours : (s, 3) float64
        Means; m, unit length or zero, RGB in 0..1.
    """

    of_voxel: NDArray[np.int32]
    centroids: NDArray[np.float64]
    normals: NDArray[np.float64]
    colours: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.centroids)


def grow_supervoxels(
    voxels: VoxelGrid,
    voxel_m: float,
    seed_m: float,
    weights: tuple[float, float, float] = (1.0, 4.0, 0.0),
    features: str = "normals",
) -> Supervoxels:
    """Partition the voxels.

    Parameters
    ----------
    voxels
        Of :func:`build_voxels`.
    voxel_m, seed_m
        Edge of a voxel and of a seed cell.
    weights
        Of distance in space (per seed size), in normal and in colour.
    features
        ``normals``, or ``39d``: position, CIELab and FPFH with fixed weights (Gatto 2016, 2.5.1).
    """
    rich = features == "39d"
    if rich:
        parts = [voxels.centroids, _lab(voxels.colours), fpfh(voxels)]
    else:
        parts = [voxels.centroids, voxels.normals] + [voxels.colours] * (weights[2] > 0)
    return Supervoxels(
        *_partition(
            voxels.centroids,
            voxels.normals,
            voxels.colours,
            np.hstack(parts),
            voxels.counts,
            voxels.starts,
            voxels.neighbours,
            seed_m,
            weights,
            int(_ROUNDS_PER_CELL * seed_m / voxel_m),
            rich,
        )
    )


def _lab(colours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return CIELab (v, 3) of RGB (v, 3) in 0..1; L in 0..100."""
    lab = cv2.cvtColor(colours[None].astype(np.float32), cv2.COLOR_RGB2LAB)
    return np.asarray(lab[0], dtype=np.float64)


@numba.njit(cache=True, nogil=True)
def _partition(  # type: ignore[no-untyped-def]
    centroids, normals, colours, features, counts, starts, neighbours, seed_m, weights, rounds, rich
):
    """Return the patch of each voxel (v,), the patches' centroids, normals and colours (s, 3)."""
    seeds = _seeds(centroids, counts, starts, neighbours, seed_m)
    of_voxel = _grow(features, counts, starts, neighbours, seeds, seed_m, weights, rounds, rich)
    shape = (seeds.shape[0], 3)
    places, directions, tints = np.empty(shape), np.empty(shape), np.empty(shape)
    _means(centroids, counts, of_voxel, places)
    _means(normals, counts, of_voxel, directions)
    _means(colours, counts, of_voxel, tints)
    _make_unit(directions)
    return of_voxel, places, directions, tints


@numba.njit(cache=True, nogil=True)
def _seeds(centroids, counts, starts, neighbours, size_m):  # type: ignore[no-untyped-def]
    """Return seed voxels: the one nearest to the centre of each cell, and one per lonely part.

    Every connected part keeps a seed: dropping lonely seeds is how small objects get lost.
    """
    seeds = _apart(centroids, _central(centroids, size_m), size_m)
    return np.concatenate((seeds, _lonely(components(starts, neighbours), counts, seeds)))


@numba.njit(cache=True, nogil=True)
def _central(centroids, size_m):  # type: ignore[no-untyped-def]
    """Return, in rising order, the voxel of each seed cell that is nearest to its centre."""
    n = centroids.shape[0]
    keys, cells = number_cells(centroids, np.arange(n), np.zeros(3), size_m)
    nearest = np.empty(keys.shape[0], np.int64)
    distance = np.full(keys.shape[0], np.inf)
    for voxel in range(n):
        d2 = 0.0
        for axis in range(3):
            at = centroids[voxel, axis]
            d2 += (at - (np.floor(at / size_m) + 0.5) * size_m) ** 2
        if d2 < distance[cells[voxel]]:
            nearest[cells[voxel]], distance[cells[voxel]] = voxel, d2
    return np.sort(nearest)


@numba.njit(cache=True, nogil=True)
def _apart(centroids, candidates, size_m):  # type: ignore[no-untyped-def]
    """Keep candidates, one a cell, in order, that lie half a cell or more from those kept before.

    What lies nearer than that is in one of the eight cells at the nearest corner of its own.
    """
    table = empty_table(candidates.shape[0])
    owners = np.empty(table.shape[0], np.int64)
    seeds = np.empty(candidates.shape[0], np.int64)
    count = 0
    for candidate in candidates:
        x, y, z = centroids[candidate, 0], centroids[candidate, 1], centroids[candidate, 2]
        x, y, z = x / size_m, y / size_m, z / size_m
        a, b, c = np.floor(x), np.floor(y), np.floor(z)
        da = 1 if x - a >= 0.5 else -1
        db = 1 if y - b >= 0.5 else -1
        dc = 1 if z - c >= 0.5 else -1
        free = True
        for corner in range(1, 8):
            i, j, k = da * (corner & 1), db * (corner >> 1 & 1), dc * (corner >> 2)
            key = cell_key(a + i, b + j, c + k)
            slot = find_slot(table, key)
            if table[slot] == key:
                d2 = 0.0
                for axis in range(3):
                    d2 += (centroids[candidate, axis] - centroids[owners[slot], axis]) ** 2
                free &= d2 >= (_SEED_SPACING * size_m) ** 2
        if free:
            key = cell_key(a, b, c)
            slot = find_slot(table, key)
            table[slot], owners[slot], seeds[count] = key, candidate, candidate
            count += 1
    return seeds[:count]


@numba.njit(cache=True, nogil=True)
def _lonely(parts, counts, seeds):  # type: ignore[no-untyped-def]
    """Return the fullest voxel of each connected part in which no seed was kept."""
    number = parts.max() + 1
    fullest = np.full(number, -1, np.int64)
    for voxel in range(parts.shape[0]):
        part = parts[voxel]
        if fullest[part] < 0 or counts[voxel] > counts[fullest[part]]:
            fullest[part] = voxel
    for seed in seeds:
        fullest[parts[seed]] = -1
    return fullest[fullest >= 0]


@numba.njit(cache=True, nogil=True)
def components(starts, neighbours):  # type: ignore[no-untyped-def]
    """Return the connected part (v,) of each voxel, numbered as they come up."""
    n = starts.shape[0] - 1
    part = np.full(n, -1, np.int32)
    stack = np.empty(n + 1, np.int32)
    count = 0
    for start in range(n):
        if part[start] >= 0:
            continue
        part[start] = count
        stack[0], top = start, 1
        while top > 0:
            top -= 1
            voxel = stack[top]
            for k in range(starts[voxel], starts[voxel + 1]):
                other = neighbours[k]
                stack[top] = other
                top += part[other] < 0
                part[other] = count
        count += 1
    return part


@numba.njit(cache=True, nogil=True)
def _distances(features, near, mean, weights, seed_m, out):  # type: ignore[no-untyped-def]
    """Write how far voxels are from a supervoxel in position, normal and colour, weighted.

    The supervoxel's normal has unit length or is zero.
    """
    by_space, by_normal, by_colour = weights[0] / seed_m, weights[1], weights[2]
    x0, y0, z0, a0, b0, c0 = mean[0], mean[1], mean[2], mean[3], mean[4], mean[5]
    for k in range(near.shape[0]):
        voxel = near[k]
        x, y, z = features[voxel, 0] - x0, features[voxel, 1] - y0, features[voxel, 2] - z0
        cosine = features[voxel, 3] * a0 + features[voxel, 4] * b0 + features[voxel, 5] * c0
        out[k] = by_space * np.sqrt(x * x + y * y + z * z) + by_normal * (1 - abs(cosine))
    if by_colour > 0:
        for k in range(near.shape[0]):
            tint = 0.0
            for c in range(6, 9):
                tint += (features[near[k], c] - mean[c]) ** 2
            out[k] += by_colour * np.sqrt(tint)


@numba.njit(cache=True, nogil=True)
def _make_unit(directions):  # type: ignore[no-untyped-def]
    """Bring vectors (s, 3) to unit length in place: means of unit vectors are shorter."""
    for label in range(directions.shape[0]):
        length = 0.0
        for k in range(3):
            length += directions[label, k] ** 2
        scale = 1 / np.sqrt(length) if length > _NO_DIRECTION**2 else 0.0
        for k in range(3):
            directions[label, k] *= scale


@numba.njit(cache=True, nogil=True)
def _distances_39(features, near, mean, seed_m, out):  # type: ignore[no-untyped-def]
    """Write how far voxels are from a supervoxel in position, CIELab and histogram.

    Gatto 2016, 2.5.1.
    """
    for voxel in range(near.shape[0]):
        own = features[near[voxel]]
        space = tint = common = 0.0
        for k in range(3):
            space += (own[k] - mean[k]) ** 2
            tint += (own[3 + k] - mean[3 + k]) ** 2
        for k in range(6, own.shape[0]):
            common += min(own[k], mean[k])
        out[voxel] = np.sqrt(
            _OF_COLOUR * tint / _COLOUR_SCALE**2
            + _OF_SPACE * space / (3 * seed_m * seed_m)
            + _OF_SHAPE * (1 - common) ** 2
        )


@numba.njit(cache=True, nogil=True)
def _means(features, counts, labels, means):  # type: ignore[no-untyped-def]
    """Write the mean features (s, k) of each supervoxel, weighted by points."""
    means[:] = 0.0
    weight = np.zeros(means.shape[0])
    for voxel in range(labels.shape[0]):
        label = labels[voxel]
        if label >= 0:
            weight[label] += counts[voxel]
            for k in range(features.shape[1]):
                means[label, k] += counts[voxel] * features[voxel, k]
    for label in range(means.shape[0]):
        for k in range(features.shape[1]):
            means[label, k] /= max(weight[label], 1e-12)


@numba.njit(cache=True, nogil=True)
def _grow(  # type: ignore[no-untyped-def]
    features, counts, starts, neighbours, seeds, seed_m, weights, rounds, rich
):
    """Relabel voxels along adjacency until nothing changes; distances are never forgotten."""
    n = features.shape[0]
    labels, best = np.full(n, -1, np.int32), np.full(n, np.inf)
    means = np.empty((seeds.shape[0], features.shape[1]))
    for label in range(seeds.shape[0]):
        labels[seeds[label]], best[seeds[label]] = label, 0.0
        means[label] = features[seeds[label]]
    if not rich:
        _make_unit(means[:, 3:6])
    without = n - seeds.shape[0]
    near, distances, tried = np.empty(26, np.uint32), np.empty(26), np.empty(n, np.int32)
    moved, moving = np.ones(seeds.shape[0], np.bool_), np.zeros(seeds.shape[0], np.bool_)
    # The last sweeps only carry labels to voxels that nobody reached within the rounds.
    for sweep in range(rounds + n):
        if sweep >= rounds and without == 0:
            break
        # What a supervoxel says to a voxel is the same throughout a sweep, and the same as in the
        # sweep before if it has neither won nor lost a voxel since: once is enough.
        tried[:] = -1
        for voxel in range(n):
            label = labels[voxel]
            if label < 0 or not moved[label]:
                continue
            count = np.int64(0)
            for k in range(starts[voxel], starts[voxel + 1]):
                other = np.uint32(neighbours[k])
                near[count] = other
                count += np.int64(labels[other] != label) & np.int64(tried[other] != label)
            if rich:
                _distances_39(features, near[:count], means[label], seed_m, distances)
            else:
                _distances(features, near[:count], means[label], weights, seed_m, distances)
            for k in range(count):
                other = near[k]
                tried[other] = label
                if distances[k] < best[other] and (sweep < rounds or labels[other] < 0):
                    if labels[other] < 0:
                        without -= 1
                    else:
                        moved[labels[other]] = moving[labels[other]] = True
                    best[other], labels[other] = distances[k], label
                    moving[label] = True
        if not moving.any():
            break
        if sweep > 0:
            moved[:] = moving
        moving[:] = False
        _means(features, counts, labels, means)
        if not rich:
            _make_unit(means[:, 3:6])
    return labels
