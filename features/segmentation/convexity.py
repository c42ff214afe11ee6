"""Convexity of neighbouring patches: those that meet convexly belong to one object.

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
    pairs, border = _borders(patches.of_voxel, voxels.starts, voxels.neighbours, len(patches))
    step_m = step_tolerance * voxel_m
    return PatchGraph(
        pairs, border, *_creases(pairs, patches.centroids, patches.normals, seed_m, step_m)
    )


@numba.njit(cache=True, nogil=True)
def _borders(of_voxel, starts, neighbours, number):  # type: ignore[no-untyped-def]
    """Return the pairs (e, 2) of patches that touch, sorted, and their adjacent voxel pairs."""
    ends = np.zeros(number + 1, np.int64)
    for patch in of_voxel:
        ends[patch + 1] += patch >= 0
    ends = np.cumsum(ends)
    members = np.empty(of_voxel.shape[0], np.int64)
    at = ends[:-1].copy()
    for voxel in range(of_voxel.shape[0]):
        patch = of_voxel[voxel]
        if patch >= 0:
            members[at[patch]] = voxel
            at[patch] += 1
    most = neighbours.shape[0] // 2
    pairs, border = np.empty((most, 2), np.int64), np.empty(most)
    common, touched = np.zeros(number, np.int64), np.empty(number, np.int64)
    count = 0
    for i in range(number):
        met = 0
        for voxel in members[ends[i] : ends[i + 1]]:
            for k in range(starts[voxel], starts[voxel + 1]):
                j = of_voxel[neighbours[k]]
                if j > i:
                    touched[met] = j
                    met += common[j] == 0
                    common[j] += 1
        for j in np.sort(touched[:met]):
            pairs[count, 0], pairs[count, 1], border[count] = i, j, common[j]
            common[j] = 0
            count += 1
    return pairs[:count].copy(), border[:count].copy()


@numba.njit(cache=True, nogil=True)
def _creases(pairs, centroids, normals, seed_m, step_m):  # type: ignore[no-untyped-def]
    """Return the signed angle (e,), whether pairs are smooth (e,) and sane (e,)."""
    e = pairs.shape[0]
    angle_deg, smooth, sane = np.empty(e), np.empty(e, np.bool_), np.empty(e, np.bool_)
    for k in range(e):
        a, b = normals[pairs[k, 0]], normals[pairs[k, 1]]
        p, q = centroids[pairs[k, 0]], centroids[pairs[k, 1]]
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        along_a = dx * a[0] + dy * a[1] + dz * a[2]
        along_b = dx * b[0] + dy * b[1] + dz * b[2]
        cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
        beta = np.degrees(np.arccos(min(max(cosine, -1.0), 1.0)))
        # The crease runs along the cross product of the normals.
        cx, cy = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]
        cz = a[0] * b[1] - a[1] * b[0]
        crease = np.sqrt(cx * cx + cy * cy + cz * cz)
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        skew = abs(cx * dx + cy * dy + cz * dz) / ((crease + 1e-12) * (distance + 1e-12))
        limit = _SANITY_LIMIT_DEG / (1 + np.exp(-_SANITY_SLOPE * (beta - _SANITY_MIDDLE_DEG)))
        directed = np.any(a != 0) and np.any(b != 0)
        angle_deg[k] = beta if along_a - along_b > 0 else -beta
        smooth[k] = directed and min(abs(along_a), abs(along_b)) <= crease * seed_m + step_m
        sane[k] = directed and np.degrees(np.arccos(min(skew, 1.0))) >= limit
    return angle_deg, smooth, sane
