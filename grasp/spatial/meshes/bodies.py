"""Bodies of a mesh: which of them lie apart, and the volume that they fill together."""

from __future__ import annotations

import numpy as np

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.rays import crossings

__all__ = ["bodies_apart", "enclosed_volume"]

_GAP_M = 0.001
_SMALL = 0.05
_LINES = 64


def bodies_apart(mesh: Mesh) -> list[Mesh]:
    """Return the bodies of a mesh that lie more than 1 mm apart, the largest first.

    Only closed surfaces are bodies. Bodies whose boxes along the axes come closer than that count
    as one. Debris smaller than a twentieth of the largest is no body of its own, and is left out
    beside others.

    Examples
    --------
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> box = box_mesh((0.1, 0.1, 0.1))
    >>> len(bodies_apart(box))
    1
    """
    if not mesh.watertight:
        return [mesh]
    parts = _components(mesh.faces, len(mesh.vertices))
    corners = [mesh.vertices[np.unique(mesh.faces[part])] for part in parts]
    sizes = np.array([float(np.ptp(points, axis=0).max()) for points in corners])
    large = [k for k in range(len(parts)) if sizes[k] >= _SMALL * sizes.max()]
    if len(large) < 2:
        return [mesh]
    boxes = [(corners[k].min(axis=0), corners[k].max(axis=0)) for k in large]
    groups = _touching(boxes, _GAP_M)
    if len(groups) < 2:
        return [mesh]
    bodies = [
        as_mesh(mesh.vertices, mesh.faces[np.concatenate([parts[large[k]] for k in group])])
        for group in groups
    ]
    return sorted(bodies, key=lambda body: -float(np.prod(np.maximum(body.extent, 1e-6))))


def enclosed_volume(mesh: Mesh) -> float:
    """Return the volume of a closed mesh, m3, else that of its convex hull; 0 of a flat one.

    Space that several bodies of the mesh fill counts once.

    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> round(enclosed_volume(box_mesh((0.1, 0.1, 0.1))), 6)
    0.001
    """
    from scipy.spatial import ConvexHull, QhullError

    if mesh.com_from != "volume":
        try:
            return float(ConvexHull(mesh.vertices).volume)
        except (QhullError, ValueError):
            return 0.0
    parts = _components(mesh.faces, len(mesh.vertices))
    corners = [mesh.vertices[np.unique(mesh.faces[part])] for part in parts]
    boxes = [(points.min(axis=0), points.max(axis=0)) for points in corners]
    if len(_touching(boxes, 0.0)) < len(boxes):
        return _union_volume(mesh)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - mesh.com for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def _union_volume(mesh: Mesh) -> float:
    """Measure parallel lines within the bodies: a line is inside where it entered more than left.

    Lines run along the longest side, on a grid of 64 x 64.
    """
    along = int(np.argmax(mesh.extent))
    across = [axis for axis in range(3) if axis != along]
    low, extent = mesh.vertices.min(axis=0), mesh.extent
    steps = (np.arange(_LINES) + 0.5) / _LINES
    first, second = np.meshgrid(steps, steps)
    origins = np.tile(low - extent * 0.01, (_LINES**2, 1))
    for axis, step in zip(across, (first, second), strict=True):
        origins[:, axis] = low[axis] + step.ravel() * extent[axis]
    directions = np.zeros_like(origins)
    directions[:, along] = 1.0
    far, index, counts = crossings(mesh.tree, origins, directions, 0.0, 1.1 * extent[along])
    real = np.arange(far.shape[1]) < counts[:, None]
    leaves = mesh.tree.normals[np.where(real, index, 0), along] > 0
    inside = np.cumsum(np.where(real, np.where(leaves, -1, 1), 0), axis=1) > 0
    lengths = np.where(inside[:, :-1] & real[:, 1:], np.diff(far, axis=1), 0.0)
    return float(lengths.sum()) * float(np.prod(extent[across])) / _LINES**2


def _components(faces: IntArray, vertices: int) -> list[IntArray]:
    """Return the faces of each connected part of a mesh."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(vertices, vertices))
    _, labels = connected_components(graph, directed=False)
    of_face = labels[faces[:, 0]] if len(faces) else np.empty(0, dtype=np.int64)
    order = np.argsort(of_face, kind="stable")
    starts = np.flatnonzero(np.diff(of_face[order])) + 1
    return [np.asarray(part) for part in np.split(order, starts)]


def _touching(boxes: list[tuple[FloatArray, FloatArray]], gap: float) -> list[list[int]]:
    """Return groups of boxes (lowest, highest corner) that come closer than a gap, m."""
    groups: list[list[int]] = []
    for k, (low, high) in enumerate(boxes):
        near = [
            group
            for group in groups
            if any((low < boxes[i][1] + gap).all() and (high > boxes[i][0] - gap).all()
                   for i in group)
        ]  # fmt: skip
        merged = [k, *(i for group in near for i in group)]
        groups = [group for group in groups if group not in near] + [sorted(merged)]
    return groups
