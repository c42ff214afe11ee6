"""Which neighbouring patches belong to one object: those that meet convexly.

Locally convex connected patches (LCCP, Stein et al. 2014; Gatto 2016, 2.5.2): objects bulge out,
and where two of them touch the surface makes a valley.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from features.segmentation.supervoxels import Supervoxels
from features.segmentation.voxels import VoxelGrid

__all__ = ["PatchGraph", "patch_graph"]

_SANITY_LIMIT_DEG, _SANITY_SLOPE, _SANITY_MIDDLE_DEG = 60.0, 0.25, 25.0


@dataclass(frozen=True)
class PatchGraph:
    """Pairs of supervoxels that share a border, each with what decides about it.

    Parameters
    ----------
    pairs : (e, 2) int64
        ``pairs[:, 0] < pairs[:, 1]``, sorted.
    border : (e,) float64
        Adjacent voxel pairs.
    angle_deg : (e,) float64
        Between the normals: positive where the pair is convex, negative where concave.
    smooth : (e,) bool
        The patches meet without a step.
    sane : (e,) bool
        Not a singular configuration, in which the angle means nothing.
    """

    pairs: NDArray[np.int64]
    border: NDArray[np.float64]
    angle_deg: NDArray[np.float64]
    smooth: NDArray[np.bool_]
    sane: NDArray[np.bool_]


@numba.njit(cache=True, nogil=True)
def _borders(of_voxel, neighbours, degrees, number):  # type: ignore[no-untyped-def]
    """Return one key ``i * number + j`` (i < j) for each adjacent pair of voxels."""
    total = 0
    for voxel in range(of_voxel.shape[0]):
        total += degrees[voxel]
    keys = np.empty(total, np.int64)
    count = 0
    for voxel in range(of_voxel.shape[0]):
        i = of_voxel[voxel]
        for k in range(degrees[voxel]):
            j = of_voxel[neighbours[voxel, k]]
            if i >= 0 and j > i:
                keys[count] = np.int64(i) * number + j
                count += 1
    return keys[:count]


def patch_graph(
    voxels: VoxelGrid, patches: Supervoxels, seed_m: float, step_tolerance: float, voxel_m: float
) -> PatchGraph:
    """Compare every two patches that touch.

    Parameters
    ----------
    seed_m, voxel_m
        Sizes of patches and voxels.
    step_tolerance
        Height of a step that still counts as smooth, in voxels.
    """
    number = max(len(patches), 1)
    keys = _borders(patches.of_voxel, voxels.neighbours, voxels.degrees, number)
    unique, border = np.unique(keys, return_counts=True)
    pairs = np.stack([unique // number, unique % number], axis=1)
    i, j = pairs[:, 0], pairs[:, 1]
    n_i, n_j = patches.normals[i], patches.normals[j]
    d = patches.centroids[i] - patches.centroids[j]
    along_i, along_j = np.einsum("ek,ek->e", d, n_i), np.einsum("ek,ek->e", d, n_j)
    beta = np.degrees(np.arccos(np.clip(np.einsum("ek,ek->e", n_i, n_j), -1, 1)))
    crease = np.cross(n_i, n_j)
    crease_length = np.linalg.norm(crease, axis=1)
    step = np.minimum(np.abs(along_i), np.abs(along_j))
    limit = _SANITY_LIMIT_DEG / (1 + np.exp(-_SANITY_SLOPE * (beta - _SANITY_MIDDLE_DEG)))
    cosine = np.abs(np.einsum("ek,ek->e", crease, d)) / (
        (crease_length + 1e-12) * (np.linalg.norm(d, axis=1) + 1e-12)
    )
    has_normals = np.any(n_i != 0, axis=1) & np.any(n_j != 0, axis=1)
    return PatchGraph(
        pairs,
        border.astype(np.float64),
        np.where(along_i - along_j > 0, beta, -beta),
        (step <= crease_length * seed_m + step_tolerance * voxel_m) & has_normals,
        (np.degrees(np.arccos(np.clip(cosine, 0, 1))) >= limit) & has_normals,
    )
