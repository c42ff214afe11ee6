"""Mass and inertia of a link that states none, from its collision shapes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from simulate.robots.description import Floats, Inertial, Shape
from simulate.robots.mesh_cover import mesh_box

__all__ = ["estimated_inertial"]

_DENSITY = 1000.0
"""kg/m3"""
_MIN_MASS = 0.05
"""kg; less makes iterative solvers unstable."""
_STEPS = (np.arange(10) + 0.5) / 10 - 0.5
_GRID = np.stack(np.meshgrid(_STEPS, _STEPS, _STEPS), axis=-1).reshape(-1, 3)
_DEFAULT_SIDE = 0.03
"""m, of the cube that stands for a link without shapes."""


def estimated_inertial(shapes: Sequence[Shape], mass: float | None = None) -> Inertial:
    """Return the inertial properties of solid shapes of 1000 kg/m3, in the frame of their link.

    Parameters
    ----------
    shapes
        Collision shapes; a mesh counts as the box around it, and space that several share counts
        once. Without any, a cube of 3 cm.
    mass
        The stated mass, kg, if only the inertia is missing; None = from the volume, at least 50 g.

    Examples
    --------
    >>> round(estimated_inertial([Shape("box", (0.1, 0.1, 0.1))]).mass, 6)
    1.0
    """
    boxes = [_box(shape) for shape in shapes] or [(np.eye(4), np.full(3, _DEFAULT_SIDE))]
    volumes = np.array([math.prod(size) for _, size in boxes]) * _own_shares(boxes)
    total = mass if mass is not None else max(float(volumes.sum()) * _DENSITY, _MIN_MASS)
    shares = volumes / volumes.sum() if volumes.sum() > 0 else np.full(len(boxes), 1 / len(boxes))
    joined: Inertial | None = None
    for (pose, size), share in zip(boxes, shares, strict=True):
        part = _solid_box(total * float(share), np.maximum(size, 0.005))
        here = Inertial(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).joined(part, pose)
        joined = here if joined is None else joined.joined(here, np.eye(4))
    assert joined is not None
    return joined


def _own_shares(boxes: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Return the share of each box (n,) that is not in one before it, on a grid within the box."""
    shares = np.ones(len(boxes))
    for i, (pose, size) in enumerate(boxes):
        points = _GRID * size @ pose[:3, :3].T + pose[:3, 3]
        covered = np.zeros(len(points), dtype=bool)
        for other, sides in boxes[:i]:
            local = (points - other[:3, 3]) @ other[:3, :3]
            covered |= (np.abs(local) <= sides / 2).all(axis=1)
        shares[i] = 1 - covered.mean()
    return shares


def _box(shape: Shape) -> tuple[Floats, Floats]:
    """Return ``link_from_box`` (4, 4) and the full size (3,) m of a box of the shape's volume."""
    pose = shape.pose.matrix
    if shape.kind == "box":
        return pose, np.array(shape.size)
    if shape.kind == "sphere":  # of the same volume
        return pose, np.full(3, shape.size[0] * (4 * math.pi / 3) ** (1 / 3))
    if shape.kind == "cylinder":
        side = shape.size[0] * math.sqrt(math.pi)
        return pose, np.array([side, side, shape.size[1]])
    low, high = mesh_box(shape.path, shape.size)
    middle = np.eye(4)
    middle[:3, 3] = (low + high) / 2
    return pose @ middle, high - low


def _solid_box(mass: float, size: Floats) -> Inertial:
    x, y, z = (float(v) ** 2 for v in size)
    moments = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    return Inertial(mass, (0.0, 0.0, 0.0), moments)
