"""A surface as points spread over it: how the mesh of a robot's link is carried in a request."""

from __future__ import annotations

import base64
import binascii
import math
from dataclasses import dataclass

import numpy as np

from rtask.errors import UsageError
from rtask.interop.ros.scene.shapes import Floats, Solid

__all__ = ["MAX_POINTS", "Surface", "surface_of_mesh", "surface_of_text"]

MAX_POINTS = 20_000
"""Of one surface: 2 m² at a spacing of 1 cm."""
_SPACING_M = 0.01


@dataclass(frozen=True, eq=False)
class Surface:
    """Points on a surface, posed.

    Parameters
    ----------
    points : (n, 3) float, m
        In its own frame.
    radius
        How far a place of the surface may be from the next of them, m.
    pose : (4, 4)
        base_from_surface.
    """

    points: Floats
    radius: float
    pose: Floats

    def ball(self) -> tuple[Floats, float]:
        """Return the middle (3,) of a ball around it, in its own frame, and its radius, m."""
        middle = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        return middle, float(np.linalg.norm(self.points - middle, axis=1).max()) + self.radius

    def as_text(self) -> str:
        """Return its points as float32, little endian, in base64."""
        return base64.b64encode(self.points.astype("<f4").tobytes()).decode("ascii")


def surface_of_mesh(corners: Floats, pose: Floats) -> Surface:
    """Return points 1 cm apart on triangles (n, 3, 3), m; farther apart on a very large mesh.

    Raises
    ------
    UsageError
        It is too large for the body of a robot: farther than 25 m.
    """
    flat = corners.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    spacing = _SPACING_M
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    ).sum() / 2  # fmt: skip
    while area / spacing**2 > MAX_POINTS / 2:
        spacing *= 2
    while True:
        samples = Solid("mesh", (), pose, corners).samples(low, high, spacing / 2)
        cells = np.floor((samples - low) / spacing).astype(np.int64)
        _, of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        if len(counts) <= MAX_POINTS:
            break
        spacing *= 2
    # The middle of a cell's samples is nearer to all of them than any of their own.
    means = np.stack(
        [np.bincount(of.ravel(), samples[:, k], len(counts)) / counts for k in range(3)], axis=1
    )
    return Surface(means, 0.75 * spacing, pose)


def surface_of_text(text: object, radius: float, pose: Floats) -> Surface:
    """Return the surface that a request carries.

    Raises
    ------
    UsageError
        It is none, or has too many points.
    """
    try:
        data = base64.b64decode(str(text), validate=True)
    except (binascii.Error, ValueError) as error:
        raise UsageError(f"points: {error}") from error
    if not data or len(data) % 12 or len(data) > 12 * MAX_POINTS:
        raise UsageError(
            f"points of {len(data)} bytes; expected 12 for each of at most {MAX_POINTS}"
        )
    points = np.frombuffer(data, "<f4").reshape(-1, 3).astype(np.float64)
    extent = np.abs(points).max() if np.isfinite(points).all() else math.inf
    if not (extent < 100.0 and 0 <= radius < 1.0):
        raise UsageError("points that are not finite, 100 m away, or of a radius beyond 1 m")
    return Surface(points, radius, pose)
