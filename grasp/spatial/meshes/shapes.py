"""Meshes of plain bodies, centred on the origin of their frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.meshes.mesh import Mesh, as_mesh

__all__ = ["box_mesh", "cup_mesh", "lathed_mesh", "sphere_mesh"]

_BOX = ((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3))  # fmt: skip


def box_mesh(size: tuple[float, float, float]) -> Mesh:
    """Return a box of full ``size`` (x, y, z), m.

    >>> box_mesh((0.04, 0.06, 0.1)).areas.sum().round(4)
    np.float64(0.0248)
    """
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    return as_mesh(np.array(corners) * size, _BOX)


def sphere_mesh(radius: float, rings: int = 24) -> Mesh:
    """Return a sphere of ``rings`` rings of faces and twice as many around."""
    angles = np.linspace(0, np.pi, rings + 1)
    profile = np.stack([radius * np.sin(angles), -radius * np.cos(angles)], axis=1)
    profile[[0, -1], 0] = 0.0
    return lathed_mesh(profile, 2 * rings)


def lathed_mesh(profile: NDArray[np.float64] | list[tuple[float, float]], around: int = 36) -> Mesh:
    """Return a body of revolution about z.

    Parameters
    ----------
    profile : (n, 2)
        Radius and height, m, from one point of the axis to another with the body on its left when
        the radius points right: upwards on the outside.
    around
        Faces around the axis.
    """
    ring = np.asarray(profile, dtype=np.float64)
    if ring[0, 0] > 0:
        ring = np.vstack([[0.0, ring[0, 1]], ring])
    if ring[-1, 0] > 0:
        ring = np.vstack([ring, [0.0, ring[-1, 1]]])
    angle = 2 * np.pi * np.arange(around) / around
    vertices = np.stack(
        [
            ring[:, None, 0] * np.cos(angle),
            ring[:, None, 0] * np.sin(angle),
            np.broadcast_to(ring[:, None, 1], (len(ring), around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(len(ring), around)
    low, high = index[:-1], index[1:]
    low_next, high_next = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    first = np.stack([low, low_next, high_next], axis=-1).reshape(-1, 3)
    second = np.stack([low, high_next, high], axis=-1).reshape(-1, 3)
    # At the axis only one of two triangles has an area.
    first, second = (
        first[np.repeat(ring[:-1, 0] > 0, around)],
        second[np.repeat(ring[1:, 0] > 0, around)],
    )
    return as_mesh(vertices, np.vstack([first, second]))


def cup_mesh(radius: float, height: float, wall: float, around: int = 36) -> Mesh:
    """Return a cup that is open above, its walls and floor ``wall`` m thick."""
    half, inner = height / 2, radius - wall
    profile = [(radius, -half), (radius, half), (inner, half), (inner, wall - half)]
    return lathed_mesh(profile, around)
