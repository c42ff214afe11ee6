"""Support found in a cloud from which nobody cut the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.collision import Support

__all__ = ["ShownSupport", "find_support"]

_NEAR_M, _CUT_M, _ABOVE_M = 0.004, 0.006, 0.012
_MIN_SIDE_M, _MARGIN_M = 0.12, 0.01
_MIN_SHARE, _BELOW_SHARE, _FEWEST = 0.2, 0.01, 30
_SUBSET, _TRIPLES, _SEED = 3000, 400, 5
_INNER = (1.0, 99.0)
"""Percentiles, so that single wrong points neither widen a table nor overhang it."""


@dataclass(frozen=True, eq=False)
class ShownSupport:
    """A support that a cloud shows.

    Parameters
    ----------
    support
        In the frame of the points.
    standing : (m, 3), m
        What of the cloud stands on it.
    note
        One line for people.
    """

    support: Support
    standing: FloatArray
    note: str


def find_support(points: FloatArray) -> ShownSupport | None:
    """Return the support that a cloud shows under what stands on it; None without one.

    A plane counts as the support if it holds a fifth of the points, nothing lies below it, it is at
    least 12 cm wide both ways, and it reaches beyond what stands on it on three sides or four. A
    box's own face, a plate or the foot of a bracket does none or not all of that.

    Parameters
    ----------
    points : (n, 3), m
        In any frame.
    """
    own = points[np.isfinite(points).all(axis=1)]
    if len(own) < 4 * _FEWEST:
        return None
    plane = _best_plane(own)
    if plane is None:
        return None
    normal, height = plane
    above = own @ normal - height
    if (above > _ABOVE_M).sum() < (above < -_ABOVE_M).sum():
        normal, height, above = -normal, -height, -above
    standing, flat = own[above > _ABOVE_M], own[np.abs(above) <= _NEAR_M]
    if len(standing) < _FEWEST or (above < -_ABOVE_M).mean() > _BELOW_SHARE:
        return None
    axes = _in_plane(flat, normal)
    low, high = np.percentile(flat @ axes.T, _INNER, axis=0)
    sides = high - low
    inner_low, inner_high = np.percentile(standing @ axes.T, _INNER, axis=0)
    free = np.concatenate([inner_low - low, high - inner_high]) >= _MARGIN_M
    if len(flat) < _MIN_SHARE * len(own) or sides.min() < _MIN_SIDE_M or free.sum() < 3:
        return None
    x, y, z = (float(v) for v in normal)
    wide, deep = (100 * sides).tolist()
    note = (
        f"a flat surface of {wide:.0f} x {deep:.0f} cm under the object was taken for its support "
        f"({len(flat)} of {len(own)} points)"
    )
    return ShownSupport(Support(float(height), (x, y, z)), own[above > _CUT_M], note)


def _best_plane(points: FloatArray) -> tuple[FloatArray, float] | None:
    """Return unit normal and height of the plane near most points, of those through three."""
    rng = np.random.default_rng(_SEED)
    some = points[rng.permutation(len(points))[:_SUBSET]]
    a, b, c = (some[rng.integers(0, len(some), _TRIPLES)] for _ in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    usable = lengths > 1e-9
    if not usable.any():
        return None
    normals = normals[usable] / lengths[usable, None]
    heights = np.einsum("ij,ij->i", normals, a[usable])
    counts = (np.abs(some @ normals.T - heights) <= _NEAR_M).sum(axis=0)
    best = int(np.argmax(counts))
    normal, height = normals[best], float(heights[best])
    for _ in range(3):
        near = points[np.abs(points @ normal - height) <= _NEAR_M]
        if len(near) < 3:
            return None
        middle = near.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((near - middle).T))
        normal = vectors[:, 0] * np.sign(vectors[:, 0] @ normal or 1.0)
        height = float(middle @ normal)
    return np.asarray(normal / np.linalg.norm(normal)), height


def _in_plane(flat: FloatArray, normal: FloatArray) -> FloatArray:
    """Return two unit vectors (2, 3) in a plane, along the narrowest box around its points."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    turns = np.deg2rad(np.arange(0, 90, 5))
    best: tuple[float, FloatArray] | None = None
    for turn in turns.tolist():
        axes = np.stack([
            np.cos(turn) * first + np.sin(turn) * second,
            np.cos(turn) * second - np.sin(turn) * first,
        ])  # fmt: skip
        low, high = np.percentile(flat @ axes.T, _INNER, axis=0)
        area = float(np.prod(high - low))
        if best is None or area < best[0]:
            best = (area, axes)
    assert best is not None
    return best[1]
