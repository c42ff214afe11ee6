"""From depth to oriented points, from many views' points to one cloud, from that to a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import Frame
from features.pose.search import scene_points

__all__ = ["fused", "oriented_points", "smoothed"]

_MAX_POINTS = 6000
_GRAZING = 0.25
_VOXEL_M = 0.0015
_MAX_MERGED = 40_000
_AROUND, _SMOOTH_M, _ALIKE = 32, 0.005, 0.8
_NEAR_M = 0.5


def oriented_points(
    frame: Frame,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64]]:
    """Return what a view shows of its object.

    Returns
    -------
    (n, 6) float64
        Places (m, camera) and normals towards the camera, 6,000 at most.
    (n, 3) uint8 RGB
    (n,) float64
        Trust: the depth of a structured-light sensor scatters with the square of the distance
        (Khoshelham and Elberink 2012) and the more, the more slanted the surface is; 1 = half a
        metre away, seen straight on.
    """
    points = frame.points()
    mask = frame.object_mask() & np.isfinite(points).all(axis=-1)
    places = points[mask]
    rng = np.random.default_rng(0)
    # Chosen before the normals, which cost most, and by the same draw for the colours below.
    order = np.sort(rng.permutation(len(places))[:_MAX_POINTS])
    chosen = scene_points(places[order], _MAX_POINTS, np.inf, np.random.default_rng(0))
    shuffled = np.random.default_rng(0).permutation(len(order))[:_MAX_POINTS]
    inks = np.full((len(places), 3), 128, np.uint8) if frame.rgb is None else frame.rgb[mask]
    away = np.maximum(np.linalg.norm(chosen.places, axis=1), 1e-9)
    facing = -np.einsum("ni,ni->n", chosen.places, chosen.normals) / away
    # Depth at grazing incidence is smeared between the object and what is behind it.
    steady = facing > _GRAZING
    both = np.hstack([chosen.places, chosen.normals])[steady]
    return both, inks[order][shuffled][steady], (facing * (_NEAR_M / away) ** 2)[steady]


def fused(
    rows: NDArray[np.float64], colours: NDArray[np.uint8], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """Average what lies in one voxel and faces one way; voxels grow until there are few enough.

    Parameters
    ----------
    rows : (n, 6) float64
        Places (m, object frame) and normals.
    colours : (n, 3) uint8
    weights : (n,) float64
        Trust in each.
    """
    edge_m = _VOXEL_M
    merged = _averaged(rows, colours, weights, edge_m)
    while len(merged[0]) > _MAX_MERGED:
        edge_m *= 1.5
        merged = _averaged(rows, colours, weights, edge_m)
    return merged


def _averaged(
    rows: NDArray[np.float64],
    colours: NDArray[np.uint8],
    weights: NDArray[np.float64],
    edge_m: float,
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    # Both faces of a thin wall fall into one voxel; their mean would have no side.
    side = np.abs(rows[:, 3:]).argmax(axis=1)
    sign = np.take_along_axis(rows[:, 3:], side[:, None], axis=1)[:, 0] > 0
    keys = np.floor(rows[:, :3] / edge_m).astype(np.int64)
    keys = np.column_stack([keys, 2 * side + sign])
    _, number = np.unique(keys, axis=0, return_inverse=True)
    number = number.ravel()
    total = np.bincount(number, weights)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = [np.bincount(number, weights * column) / total for column in values.T]
        return np.stack(columns, axis=1)

    cloud = mean(rows)
    cloud[:, 3:] /= np.maximum(np.linalg.norm(cloud[:, 3:], axis=1, keepdims=True), 1e-9)
    inks = np.rint(mean(colours.astype(np.float64))).astype(np.uint8)
    return cloud.astype(np.float32), inks, total.astype(np.float32)


def smoothed(
    cloud: NDArray[np.float32], weights: NDArray[np.float32], most: int
) -> NDArray[np.float64]:
    """Return points of a cloud, each on the mean plane of those around it that face its way.

    Views of a noisy sensor pile up in a layer a few mm thick; its middle is the surface. Points
    round an edge face another way and do not blunt it.

    Parameters
    ----------
    cloud : (n, 6) float32
    weights : (n,) float32
    most
        Points that are returned; drawn with a fixed seed.
    """
    rows = cloud.astype(np.float64)
    if len(rows) < _AROUND:
        return rows
    chosen = np.sort(np.random.default_rng(0).permutation(len(rows))[:most])
    away, near = cKDTree(rows[:, :3]).query(rows[chosen, :3], k=_AROUND)
    alike = np.einsum("nki,ni->nk", rows[near, 3:], rows[chosen, 3:])
    share = np.exp(-((away / _SMOOTH_M) ** 2)) * (alike > _ALIKE) * weights[near]
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-12)
    normals = np.einsum("nk,nki->ni", share, rows[near, 3:])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    middle = np.einsum("nk,nki->ni", share, rows[near, :3])
    off = np.einsum("ni,ni->n", middle - rows[chosen, :3], normals)
    return np.hstack([rows[chosen, :3] + off[:, None] * normals, normals])
