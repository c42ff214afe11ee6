"""Shapes of a hand with a fixed jaw, with the mouth between the jaws left open.

A physics engine takes a moving mesh by its convex hull, which closes the mouth of a link that has
both a palm and a jaw. Its meshes are cut into slices along the approach, and each slice into the
boxes around what lies apart along the closing axis.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from features.geometry import pose_matrix
from simulate.robots.description import Arm, Floats, Joint, Pose, RobotDescription, Shape
from simulate.robots.mesh_cover import read_vertices
from simulate.robots.mesh_files import load_mesh

__all__ = ["is_coarse", "shape_surface", "with_open_mouths"]

_SLICE_M = 0.01
_APART_M = 0.012
"""Gap along the closing axis beyond which two parts of a slice are boxes of their own."""
_EDGE_M = 0.006
_SAME_M = 0.003
_THIN_M = 0.002
_FEW_VERTICES = 200


def with_open_mouths(robot: RobotDescription) -> RobotDescription:
    """Return a robot in which hands with a single moving jaw have boxes in place of meshes."""
    for arm in robot.arms.values():
        if arm.has_single_jaw:
            joint = robot.joint(arm.fingers[0])
            closed = (arm.finger_closed or (0.0,))[0]
            turn = _closed_turn(joint, closed)
            robot = _boxed(robot, arm.wrist, _axes(arm))
            robot = _boxed(robot, joint.child, turn.T @ _axes(arm))
    return robot


def _axes(arm: Arm) -> Floats:
    """Return across, closing and approach as the columns (3, 3), wrist frame."""
    closing, approach = np.array(arm.closing), np.array(arm.approach)
    return np.stack([np.cross(closing, approach), closing, approach], axis=1)


def _closed_turn(joint: Joint, value: float) -> Floats:
    """Return ``wrist_from_jaw`` (3, 3) at a joint value."""
    turn = joint.pose.matrix[:3, :3]
    if joint.kind == "prismatic":
        return np.asarray(turn)
    x, y, z = np.array(joint.axis) / np.linalg.norm(joint.axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(turn @ (np.eye(3) + np.sin(value) * skew + (1 - np.cos(value)) * skew @ skew))


def _boxed(robot: RobotDescription, name: str, axes: Floats) -> RobotDescription:
    link = robot.link(name)
    shapes = [
        made
        for shape in link.shapes
        for made in (_boxes(shape, axes) if shape.kind == "mesh" else (shape,))
    ]
    changed = replace(link, shapes=tuple(shapes))
    return replace(robot, links=tuple(changed if k.name == name else k for k in robot.links))


def _boxes(shape: Shape, axes: Floats) -> Iterator[Shape]:
    """Yield boxes along the axes (3, 3) around the slices of a mesh."""
    local = shape_surface(shape) @ axes
    low, high = float(local[:, 2].min()), float(local[:, 2].max())
    count = max(round((high - low) / _SLICE_M), 1)
    edges = np.linspace(low, high, count + 1)
    index = np.clip(np.searchsorted(edges, local[:, 2], side="right") - 1, 0, count - 1)
    waiting: list[tuple[Floats, Floats]] = []
    for number in range(count):
        parts = [
            _bounds(part, edges[number], edges[number + 1])
            for part in _parts(local[index == number])
        ]
        if len(parts) == len(waiting) and all(map(_alike, waiting, parts)):
            waiting = [
                (np.minimum(a, c), np.maximum(b, d))
                for (a, b), (c, d) in zip(waiting, parts, strict=True)
            ]
            continue
        yield from (_box(*ends, axes) for ends in waiting)
        waiting = parts
    yield from (_box(*ends, axes) for ends in waiting)


def shape_surface(shape: Shape) -> Floats:
    """Return points (n, 3) m on the surface of a mesh, 6 mm apart at most, in its link's frame."""
    pose = shape.pose.matrix
    return np.asarray(_surface(shape.path, shape.size) @ pose[:3, :3].T + pose[:3, 3])


def is_coarse(shape: Shape) -> bool:
    """Tell whether a mesh has so few vertices that they do not show where its surface is."""
    return len(read_vertices(shape.path)) < _FEW_VERTICES


def _parts(points: Floats) -> list[Floats]:
    """Return the parts of a slice that lie apart along the closing axis."""
    if not len(points):
        return []
    order = points[np.argsort(points[:, 1], kind="stable")]
    cuts = np.flatnonzero(np.diff(order[:, 1]) > _APART_M) + 1
    return np.split(order, cuts)


def _bounds(points: Floats, low: float, high: float) -> tuple[Floats, Floats]:
    least, most = points.min(axis=0), points.max(axis=0)
    least[2], most[2] = low, high
    return least, most


def _alike(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> bool:
    ends = zip(first, second, strict=True)
    return all(float(np.abs(a[:2] - b[:2]).max()) <= _SAME_M for a, b in ends)


def _box(low: Floats, high: Floats, axes: Floats) -> Shape:
    matrix = pose_matrix(axes, axes @ ((low + high) / 2))
    x, y, z = (float(side) for side in np.maximum(high - low, _THIN_M))
    return Shape("box", (x, y, z), Pose.of(matrix))


@functools.lru_cache(maxsize=16)
def _surface(path: str, scale: tuple[float, ...]) -> Floats:
    """Return points (n, 3) m on a mesh, no two neighbours farther apart than the finest gap."""
    mesh = load_mesh(Path(path))
    mesh.apply_scale(np.array(scale))
    points = np.asarray(mesh.subdivide_to_size(_EDGE_M, max_iter=20).vertices, dtype=np.float64)
    points.flags.writeable = False
    return points
