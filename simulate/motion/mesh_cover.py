"""Spheres around a mesh, for planning: what a robot's own description brings as files.

Only vertices of Wavefront files are read; the physics engine reads the faces itself.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RobotError

__all__ = ["cover_mesh", "read_vertices"]

Floats = NDArray[np.float64]

_FINEST_M = 0.012
_ALONG, _ACROSS = 0.8, 1.3


def read_vertices(path: str) -> Floats:
    """Return the vertices (n, 3) of a Wavefront file, in its own units.

    Raises
    ------
    RobotError
        The file is missing, of another format or without vertices.
    """
    file = Path(path)
    if file.suffix.lower() != ".obj":
        raise RobotError(f"{file}: shapes are read from .obj files only")
    try:
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise RobotError(f"{file}: {error.strerror}; a link's shape is missing") from error
    rows = [line.split()[1:4] for line in lines if line.startswith("v ")]
    if not rows:
        raise RobotError(f"{file}: no vertices")
    return np.array(rows, dtype=np.float64)


@functools.cache
def cover_mesh(path: str, scale: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return spheres around a mesh: centres (k, 3) m and radii (k,) m, frame of the mesh.

    The mesh is cut along its longest side, each slice along its own, so that parts about as long
    as wide remain; a sphere covers the vertices of each.

    Parameters
    ----------
    path
        Of a Wavefront file.
    scale
        (x, y, z), to m.
    """
    parts = [read_vertices(path) * np.array(scale)]
    centres, radii = [], []
    while parts:
        points = parts.pop()
        low, high = points.min(axis=0), points.max(axis=0)
        size = high - low
        axis = int(np.argmax(size))
        second = float(np.sort(size)[1])
        count = round(float(size[axis]) / max(second * _ALONG, _FINEST_M))
        if count > 1 and size[axis] > _ACROSS * second and len(points) > 2 * count:
            edges = np.linspace(low[axis], high[axis], count + 1)
            cell = np.clip(np.searchsorted(edges, points[:, axis]) - 1, 0, count - 1)
            parts += [points[cell == i] for i in range(count) if (cell == i).any()]
            continue
        centre = (low + high) / 2
        centres.append(centre)
        radii.append(float(np.linalg.norm(points - centre, axis=1).max()))
    return np.array(centres), np.array(radii)
