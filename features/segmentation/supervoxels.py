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
from features.segmentation.voxels import VoxelGrid, find_cell

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
    seeds = _seeds(voxels, seed_m)
    plain = np.hstack([voxels.centroids, voxels.normals, voxels.colours])
    rich = features == "39d"
    of_voxel = _grow(
        np.hstack([voxels.centroids, _lab(voxels.colours), fpfh(voxels)]) if rich else plain,
        voxels.counts,
        voxels.neighbours,
        voxels.degrees,
        seeds,
        seed_m,
        np.array(weights),
        int(_ROUNDS_PER_CELL * seed_m / voxel_m),
        rich,
    )
    means = _means(plain, voxels.counts, of_voxel, len(seeds))
    _unit_normals(means)
    return Supervoxels(of_voxel, means[:, :3], means[:, 3:6], means[:, 6:9])


def _lab(colours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return CIELab (v, 3) of RGB (v, 3) in 0..1; L in 0..100."""
    lab = cv2.cvtColor(colours[None].astype(np.float32), cv2.COLOR_RGB2LAB)
    return np.asarray(lab[0], dtype=np.float64)


def _seeds(voxels: VoxelGrid, seed_m: float) -> NDArray[np.int64]:
    """Return seed voxels: the one nearest to the centre of each cell, and one per lonely part.

    Every connected part keeps a seed: dropping lonely seeds is how small objects get lost.
    """
    if not len(voxels):
        return np.zeros(0, np.int64)
    kept = _apart(voxels.centroids, _central(voxels.centroids, seed_m), _SEED_SPACING * seed_m)
    parts = components(voxels.neighbours, voxels.degrees)
    extra = _lonely(parts, voxels.counts, kept)
    return np.concatenate([kept, extra])


@numba.njit(cache=True, nogil=True)
def _central(centroids, size_m):  # type: ignore[no-untyped-def]
    """Return, in rising order, the voxel of each seed cell that is nearest to its centre."""
    n = centroids.shape[0]
    cells = np.floor(centroids / size_m).astype(np.int64)
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int32)
    keys = np.empty((n, 3), np.int64)
    nearest = np.empty(n, np.int64)
    distance = np.empty(n)
    count = 0
    for voxel in range(n):
        d2 = 0.0
        for axis in range(3):
            d2 += (centroids[voxel, axis] - (cells[voxel, axis] + 0.5) * size_m) ** 2
        cell, slot = find_cell(table, keys, cells[voxel, 0], cells[voxel, 1], cells[voxel, 2])
        if cell < 0:
            cell = count
            table[slot] = cell
            keys[cell] = cells[voxel]
            distance[cell] = np.inf
            count += 1
        if d2 < distance[cell]:
            nearest[cell], distance[cell] = voxel, d2
    return np.sort(nearest[:count])


@numba.njit(cache=True, nogil=True)
def _lonely(parts, counts, kept):  # type: ignore[no-untyped-def]
    """Return the fullest voxel of each connected part in which no seed was kept."""
    number = parts.max() + 1
    fullest = np.full(number, -1, np.int64)
    for voxel in range(parts.shape[0]):
        part = parts[voxel]
        if fullest[part] < 0 or counts[voxel] > counts[fullest[part]]:
            fullest[part] = voxel
    for seed in kept:
        fullest[parts[seed]] = -1
    return fullest[fullest >= 0]


@numba.njit(cache=True, nogil=True)
def _apart(centroids, candidates, spacing):  # type: ignore[no-untyped-def]
    """Keep candidates in order that lie no closer than ``spacing`` to one kept before."""
    kept = np.empty(candidates.shape[0], np.int64)
    count = 0
    for candidate in candidates:
        free = True
        for k in range(count):
            d2 = 0.0
            for axis in range(3):
                d2 += (centroids[candidate, axis] - centroids[kept[k], axis]) ** 2
            if d2 < spacing * spacing:
                free = False
                break
        if free:
            kept[count] = candidate
            count += 1
    return kept[:count]


@numba.njit(cache=True, nogil=True)
def components(neighbours, degrees):  # type: ignore[no-untyped-def]
    n = degrees.shape[0]
    part = np.full(n, -1, np.int64)
    stack = np.empty(n, np.int64)
    count = 0
    for start in range(n):
        if part[start] >= 0:
            continue
        part[start] = count
        stack[0], top = start, 1
        while top > 0:
            top -= 1
            voxel = stack[top]
            for k in range(degrees[voxel]):
                other = neighbours[voxel, k]
                if part[other] < 0:
                    part[other] = count
                    stack[top] = other
                    top += 1
        count += 1
    return part


@numba.njit(cache=True, nogil=True, inline="always")
def _distance(a, b, by_space, by_normal, by_colour):  # type: ignore[no-untyped-def]
    """Return the weighted distance of a voxel's and a supervoxel's position, normal and colour.

    The supervoxel's normal has unit length or is zero.
    """
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    dot = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    red, green, blue = a[6] - b[6], a[7] - b[7], a[8] - b[8]
    return (
        by_space * np.sqrt(x * x + y * y + z * z)
        + by_normal * (1 - abs(dot))
        + by_colour * np.sqrt(red * red + green * green + blue * blue)
    )


@numba.njit(cache=True, nogil=True)
def _unit_normals(means):  # type: ignore[no-untyped-def]
    """Make the normals of supervoxels unit vectors, in place: means of unit vectors are shorter."""
    for label in range(means.shape[0]):
        length = 0.0
        for k in range(3, 6):
            length += means[label, k] ** 2
        scale = 1 / np.sqrt(length) if length > _NO_DIRECTION**2 else 0.0
        for k in range(3, 6):
            means[label, k] *= scale


@numba.njit(cache=True, nogil=True)
def _distance_39(a, b, seed_m):  # type: ignore[no-untyped-def]
    """Return the distance of position, CIELab and histogram (Gatto 2016, 2.5.1)."""
    space = tint = 0.0
    for k in range(3):
        space += (a[k] - b[k]) ** 2
        tint += (a[3 + k] - b[3 + k]) ** 2
    common = 0.0
    for k in range(6, a.shape[0]):
        common += min(a[k], b[k])
    return np.sqrt(
        _OF_COLOUR * tint / _COLOUR_SCALE**2
        + _OF_SPACE * space / (3 * seed_m * seed_m)
        + _OF_SHAPE * (1 - common) ** 2
    )


@numba.njit(cache=True, nogil=True)
def _means(features, counts, labels, number):  # type: ignore[no-untyped-def]
    """Return the mean features (s, k) of each supervoxel, weighted by points."""
    width = features.shape[1]
    sums = np.zeros((number, width))
    weight = np.zeros(number)
    for voxel in range(labels.shape[0]):
        label = labels[voxel]
        if label >= 0:
            weight[label] += counts[voxel]
            for k in range(width):
                sums[label, k] += counts[voxel] * features[voxel, k]
    for label in range(number):
        for k in range(width):
            sums[label, k] /= max(weight[label], 1e-12)
    return sums


@numba.njit(cache=True, nogil=True)
def _grow(  # type: ignore[no-untyped-def]
    features, counts, neighbours, degrees, seeds, seed_m, weights, rounds, rich
):
    """Relabel voxels along adjacency until nothing changes; distances are never forgotten."""
    n = features.shape[0]
    by_space = weights[0] / seed_m
    labels = np.full(n, -1, np.int32)
    best = np.full(n, np.inf)
    means = np.empty((seeds.shape[0], features.shape[1]))
    for label in range(seeds.shape[0]):
        labels[seeds[label]] = label
        best[seeds[label]] = 0.0
        means[label] = features[seeds[label]]
    if not rich:
        _unit_normals(means)
    # The last sweeps only carry labels to voxels that nobody reached within the rounds.
    for sweep in range(rounds + n):
        changed = False
        for voxel in range(n):
            label = labels[voxel]
            if label < 0:
                continue
            for k in range(degrees[voxel]):
                other = neighbours[voxel, k]
                if labels[other] == label or (sweep >= rounds and labels[other] >= 0):
                    continue
                if rich:
                    d = _distance_39(features[other], means[label], seed_m)
                else:
                    d = _distance(features[other], means[label], by_space, weights[1], weights[2])
                if d < best[other]:
                    best[other] = d
                    labels[other] = label
                    changed = True
        if not changed:
            break
        means = _means(features, counts, labels, seeds.shape[0])
        if not rich:
            _unit_normals(means)
    return labels
