"""Shapes of a planning scene: primitives, meshes and planes, and how far points are from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

__all__ = ["Solid", "mesh_of", "plane_of", "pose_of", "primitive_of"]

Floats = NDArray[np.float64]
_KINDS = {1: ("box", 3), 2: ("sphere", 1), 3: ("cylinder", 2), 4: ("cone", 2)}
"""Types of shape_msgs/SolidPrimitive, and how many dimensions each has."""
MAX_TRIANGLES = 500_000
_CHUNK = 4_000_000
_LARGE = 4000
"""Samples along the edge of a triangle beyond which it is too large: some 25 m."""


@dataclass(frozen=True, eq=False)
class Solid:
    """One shape.

    Parameters
    ----------
    kind
        ``box``, ``sphere``, ``cylinder``, ``cone``, ``plane`` or ``mesh``.
    size
        Sides of a box, radius of a sphere, height and radius of the others, m; a, b, c and d of a
        plane, with (a, b, c) of length 1.
    pose : (4, 4)
        object_from_shape.
    corners : (n, 3, 3) or None
        Triangles of a mesh, m, in its own frame.
    """

    kind: str
    size: tuple[float, ...]
    pose: Floats
    corners: Floats | None = None

    def ball(self) -> tuple[Floats, float]:
        """Return the middle (3,) of a ball around it, in its own frame, and its radius, m."""
        if self.kind == "plane":
            return np.zeros(3), math.inf
        if self.corners is not None:
            points = self.corners.reshape(-1, 3)
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            return middle, float(np.linalg.norm(points - middle, axis=1).max())
        if self.kind == "box":
            return np.zeros(3), math.hypot(*self.size) / 2
        height, radius = (0.0, *self.size)[-2:]
        return np.zeros(3), math.hypot(height / 2, radius)

    def distance(self, points: Floats) -> Floats:
        """Return distances (n,), m, of points (n, 3) in its own frame; negative inside a body.

        Of cones never more than the true one; planes are surfaces without an inside, and so are
        meshes, of which only :meth:`samples` are known.
        """
        if self.kind == "plane":
            return np.asarray(np.abs(points @ np.array(self.size[:3]) + self.size[3]))
        if self.corners is not None:
            return np.full(len(points), np.inf)
        if self.kind == "sphere":
            return np.asarray(np.linalg.norm(points, axis=1) - self.size[0])
        if self.kind == "box":
            return _outside(np.abs(points) - np.array(self.size) / 2)
        height, radius = self.size
        around, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        if self.kind == "cylinder":
            return _outside(np.stack([around - radius, np.abs(z) - height / 2], axis=1))
        # The apex is up; the slope is a line in the plane through the axis.
        slope = (around - radius * (0.5 - z / height)) * height / math.hypot(height, radius)
        return np.asarray(np.maximum(slope, np.abs(z) - height / 2))

    def samples(self, low: Floats, high: Floats, spacing: float) -> Floats:
        """Return points (n, 3) of a mesh, m, in its own frame, no farther apart than a spacing.

        Only triangles that reach into a box of that frame, given by its corners, are covered.
        """
        assert self.corners is not None
        reach = (self.corners.min(axis=1) <= high) & (self.corners.max(axis=1) >= low)
        near = self.corners[reach.all(axis=1)]
        edges = np.linalg.norm(near - np.roll(near, 1, axis=1), axis=2)
        counts = np.maximum(np.ceil(edges.max(axis=1, initial=0.0) / spacing), 1).astype(np.int64)
        made = [np.zeros((0, 3))]
        for count in np.unique(counts):
            part = near[counts == count]
            if count > _LARGE:
                raise UsageError(f"a mesh with a triangle of {float(edges.max()):.3g} m")
            i, j = np.divmod(np.arange((count + 1) ** 2), count + 1)
            shares = np.stack([i, j, count - i - j], axis=1)[i + j <= count] / count
            for few in np.array_split(part, -(-len(part) * len(shares) // _CHUNK)):
                points = (shares @ few).reshape(-1, 3)
                made.append(points[((points >= low) & (points <= high)).all(axis=1)])
        return np.concatenate(made)


def _outside(over: Floats) -> Floats:
    """Return the distance of points whose distances (n, k) from k slabs are known."""
    out = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.asarray(out + np.minimum(over.max(axis=1), 0.0))


def pose_of(message: Any, what: str) -> Floats:
    """Return a geometry_msgs/Pose as (4, 4).

    An orientation of zeros is none, as in MoveIt.

    Raises
    ------
    UsageError
        A number is not finite, or the orientation is no unit quaternion.
    """
    place, turn = message.position, message.orientation
    move = np.array([place.x, place.y, place.z], dtype=np.float64)
    x, y, z, w = quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    if not (np.isfinite(move).all() and np.isfinite(quaternion).all()):
        raise UsageError(f"{what}: its pose holds a number that is not finite")
    length = float(np.linalg.norm(quaternion))
    made = np.eye(4)
    made[:3, 3] = move
    if length == 0:
        return made
    if abs(length - 1) > 1e-2:
        raise UsageError(f"{what}: its orientation is no unit quaternion, but {length:.3g} long")
    x, y, z, w = quaternion / length
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return made


def primitive_of(message: Any, pose: Floats) -> Solid:
    """Return a shape_msgs/SolidPrimitive.

    Raises
    ------
    UsageError
        Its type is not known, or its dimensions are not positive and finite.
    """
    if message.type not in _KINDS:
        raise UsageError(
            f"a primitive of type {message.type}; expected box, sphere, cylinder or cone"
        )
    kind, count = _KINDS[message.type]
    size = tuple(float(value) for value in message.dimensions)
    if len(size) != count or not all(0 < value < math.inf for value in size):
        raise UsageError(f"a {kind} of {list(size)}; expected {count} positive dimensions, m")
    return Solid(kind, size, pose)


def mesh_of(message: Any, pose: Floats) -> Solid:
    """Return a shape_msgs/Mesh.

    Raises
    ------
    UsageError
        It has no triangles, too many, vertices that are not finite, or triangles of none.
    """
    if not len(message.triangles) or not len(message.vertices):
        raise UsageError("a mesh without triangles")
    if len(message.triangles) > MAX_TRIANGLES:
        raise UsageError(
            f"a mesh of {len(message.triangles)} triangles; at most {MAX_TRIANGLES} are read"
        )
    vertices = np.array([(v.x, v.y, v.z) for v in message.vertices], dtype=np.float64)
    if not np.isfinite(vertices).all():
        raise UsageError("a mesh with a vertex that is not finite")
    indices = np.array([list(t.vertex_indices) for t in message.triangles], dtype=np.int64)
    if indices.max() >= len(vertices) or indices.min() < 0:
        raise UsageError(
            f"a mesh whose triangles name vertex {int(indices.max())} of {len(vertices)}"
        )
    return Solid("mesh", (), pose, vertices[indices])


def plane_of(message: Any, pose: Floats) -> Solid:
    """Return a shape_msgs/Plane, a x + b y + c z + d = 0.

    Raises
    ------
    UsageError
        A number is not finite, or a, b and c are zero.
    """
    coefficients = np.array([float(value) for value in message.coef])
    length = float(np.linalg.norm(coefficients[:3]))
    if not np.isfinite(coefficients).all() or length < 1e-9:
        raise UsageError(f"a plane of {coefficients.tolist()}; expected a, b, c, d with a normal")
    return Solid("plane", tuple((coefficients / length).tolist()), pose)
