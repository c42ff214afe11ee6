"""Spheres that cover a mesh, for planning with the link shapes of a robot's own description.

The physics engine reads the meshes itself.
"""

from __future__ import annotations

import functools
import itertools
from pathlib import Path

import numpy as np

from simulate.robots.description import Floats, Shape
from simulate.robots.mesh_files import load_mesh

__all__ = [
    "cover_mesh",
    "cover_surface",
    "hull_boxes",
    "mesh_box",
    "read_vertices",
    "shape_corners",
    "shape_points",
]

_FINEST_M = 0.012
_ALONG, _ACROSS = 0.8, 1.3
_PATCH_M = 0.02
_SLICE_M = 0.04
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_STEPS = 4
"""Points along the edge of a patch, at least."""


@functools.lru_cache(maxsize=64)
def read_vertices(path: str) -> Floats:
    """Return the vertices (n, 3) of a mesh file (OBJ, STL, PLY, ...), in its own units.

    Raises
    ------
    RobotError
        The file is missing, of an unknown format or without vertices.
    """
    vertices = np.asarray(load_mesh(Path(path)).vertices, dtype=np.float64)
    vertices.flags.writeable = False
    return vertices


def mesh_box(path: str, scale: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return the lowest and the highest corner (3,) m of a mesh file, times ``scale``."""
    scaled = _file_corners(path) * np.array(scale)
    return scaled.min(axis=0), scaled.max(axis=0)


@functools.lru_cache(maxsize=256)
def _file_corners(path: str) -> Floats:
    """Return the lowest and the highest corner (2, 3) of a mesh file, in its own units.

    Kept beside the vertices: a box is asked for a dozen times a mesh, and a million vertices take
    some .1 s each time.
    """
    vertices = read_vertices(path)
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


@functools.cache
def cover_mesh(path: str, scale: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return spheres around a mesh: centres (k, 3) m and radii (k,) m, frame of the mesh.

    The mesh is cut along its longest side, each slice along its own, so that parts about as long
    as wide remain; a sphere covers the vertices of each.

    Parameters
    ----------
    path
        Of a mesh file.
    scale
        (x, y, z), from the file's units to m.
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


@functools.cache
def cover_surface(path: str, scale: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return small spheres on the surface of a mesh: centres (k, 3) m and radii (k,) m.

    They stand out by 1.7 cm at most; the one of :func:`cover_mesh` around the last link of a Panda
    does by 5 cm. They are many more, 89 there, and the inside stays open.

    Parameters
    ----------
    path, scale
        As of :func:`cover_mesh`.
    """
    mesh = load_mesh(Path(path))
    mesh.apply_scale(np.array(scale))
    mesh = mesh.subdivide_to_size(_PATCH_M / _STEPS)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    cells = np.floor((points - points.min(axis=0)) / _PATCH_M).astype(np.int64)
    order = np.lexsort(cells.T)
    changes = np.flatnonzero(np.diff(cells[order], axis=0).any(axis=1)) + 1
    centres, radii = [], []
    for part in np.split(points[order], changes):
        centre = (part.min(axis=0) + part.max(axis=0)) / 2
        centres.append(centre)
        radii.append(float(np.linalg.norm(part - centre, axis=1).max()))
    return np.array(centres), np.array(radii)


@functools.cache
def hull_boxes(path: str, scale: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return boxes around slices of a mesh's convex hull: centres and halves (k, 3) m, mesh frame.

    The hull is what the physics engine collides with. Slices are 4 cm thick at most, across the
    longest side; a few spheres around a body of little detail would reach far beyond it.

    Parameters
    ----------
    path, scale
        As of :func:`cover_mesh`.
    """
    hull = load_mesh(Path(path)).convex_hull
    points = np.asarray(hull.vertices) * np.array(scale)
    low, high = points.min(axis=0), points.max(axis=0)
    axis = int(np.argmax(high - low))
    count = max(int(np.ceil((high - low)[axis] / _SLICE_M)), 1)
    edges = np.linspace(low[axis], high[axis], count + 1)
    first, last = points[hull.edges_unique].transpose(1, 0, 2)
    span = last[:, axis] - first[:, axis]
    centres, halves = [], []
    for bottom, top in itertools.pairwise(edges):
        inside = points[(points[:, axis] >= bottom) & (points[:, axis] <= top)]
        cuts = [inside]
        for level in (bottom, top):
            share = np.divide(
                level - first[:, axis], span, out=np.full(len(span), -1.0), where=np.abs(span) > 0
            )
            crossed = (share >= 0) & (share <= 1)
            cuts.append((first + share[:, None] * (last - first))[crossed])
        part = np.vstack(cuts)
        if len(part):
            centres.append((part.min(axis=0) + part.max(axis=0)) / 2)
            halves.append(np.ptp(part, axis=0) / 2)
    return np.array(centres), np.array(halves)


def shape_corners(shape: Shape) -> Floats:
    """Return the corners (8, 3) m of a box around a shape, in the frame of its link."""
    if shape.kind != "mesh":
        return shape_points(shape)
    low, high = mesh_box(shape.path, shape.size)
    pose = shape.pose.matrix
    corners = (low + high) / 2 + _CORNERS * (high - low)
    return np.asarray(corners @ pose[:3, :3].T + pose[:3, 3])


def shape_points(shape: Shape) -> Floats:
    """Return the corners or vertices (n, 3) m of a shape, in the frame of its link."""
    if shape.kind == "mesh":
        local = read_vertices(shape.path) * np.array(shape.size)
    elif shape.kind == "box":
        local = _CORNERS * np.array(shape.size)
    else:
        radius = shape.size[0]
        length = shape.size[1] if shape.kind == "cylinder" else 2 * radius
        local = _CORNERS * np.array([2 * radius, 2 * radius, length])
    pose = shape.pose.matrix
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3])
