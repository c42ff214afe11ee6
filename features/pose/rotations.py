"""Rotations: an evenly spread set, and the angle between two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray

__all__ = ["angle_between", "rotation_about", "super_fibonacci"]

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041


def super_fibonacci(count: int) -> NDArray[np.float64]:
    """Return rotations that cover all turns evenly (Alexa 2022).

    Returns
    -------
    (count, 3, 3) float64

    Examples
    --------
    >>> turns = super_fibonacci(64)
    >>> bool(np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3)))
    True
    """
    s = np.arange(count) + 0.5
    r, q = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = 2 * np.pi * s / _PHI, 2 * np.pi * s / _PSI
    x, y, z, w = r * np.sin(a), r * np.cos(a), q * np.sin(b), q * np.cos(b)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def rotation_about(axis: FloatArray, angle_rad: float) -> NDArray[np.float64]:
    """Return the rotation (3, 3) about a unit axis (3,) after Rodrigues.

    >>> np.round(rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2), 6)[0, 1]
    np.float64(-1.0)
    """
    x, y, z = (float(c) for c in axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: NDArray[np.float64] = (
        np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
    )
    return turned


def angle_between(
    a: NDArray[np.float64], b: NDArray[np.float64], symmetries: NDArray[np.float64] | None = None
) -> float:
    """Return the angle between two rotations of one object, rad.

    Parameters
    ----------
    a, b : (3, 3) float64
    symmetries : (k, 3, 3) float64, optional
        Turns that leave the object as it is; the least angle over them counts.

    Examples
    --------
    >>> half = rotation_about(np.array([1.0, 0.0, 0.0]), np.pi)
    >>> angle_between(np.eye(3), half, np.stack([np.eye(3), half])).__round__(6)
    0.0
    """
    between = a.T @ b
    group = np.eye(3)[None] if symmetries is None else symmetries
    trace = np.einsum("ij,kji->k", between, group)
    return float(np.arccos(np.clip((trace.max() - 1) / 2, -1.0, 1.0)))
