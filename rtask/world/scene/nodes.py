"""A scene as a tree of nodes, before it is written in any format."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AXIS_M",
    "Fact",
    "Kind",
    "Scene",
    "SceneNode",
    "SceneSurface",
    "Unplaced",
    "box_corners",
    "grasp_lines",
    "region_lines",
    "wall_boxes",
]

Kind: TypeAlias = Literal["frame", "robot", "place", "thing", "grasp"]
Fact: TypeAlias = str | float

AXIS_M = 0.1
"""Length of the axes that are drawn for a frame, m."""
_WALL_M = 0.004
_FINGER_M, _STEM_M, _DEFAULT_OPENING_M = 0.04, 0.04, 0.05


@dataclass(frozen=True, eq=False)
class SceneSurface:
    """A surface in the frame of its node.

    Parameters
    ----------
    vertices : (v, 3) float64, m
    faces : (f, 3) int64
        Counter-clockwise from outside.
    seen : (v,) bool
        Whether a measurement supports the vertex.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    seen: NDArray[np.bool_]

    @property
    def seen_faces(self) -> NDArray[np.bool_]:
        """Which faces (f,) have only vertices that were seen."""
        return np.asarray(self.seen[self.faces].all(axis=1))


@dataclass(frozen=True, eq=False)
class SceneNode:
    """A frame, robot, place, thing or grasp.

    Parameters
    ----------
    iri, label
        What it is in the graph, and its name for people.
    parent
        Number of the node above it in the scene; None for the root.
    parent_from_node : (4, 4) float64, m
    size_m
        Extents of a thing's box along x, y and z; None if not all are known. The origin is the
        centre of its footprint, at the height of its support. Of a place, such as a table or box,
        the size of its surface and the height of the walls around it; the origin is the middle of
        the surface.
    opening_m
        Of the jaws of a grasp.
    region_m
        Of a thing whose own pose nobody knows, the size of the place somewhere on or in which it
        is, as of a place; its pose is that of the place. None for others, and where that is not
        known.
    surface
        Reconstructed surface of a thing's product, drawn in place of the box; None if there is no
        current one. Its parts that nobody has seen are drawn in grey.
    facts
        What else is known, by the names under which formats store it.
    """

    kind: Kind
    iri: str
    label: str
    parent: int | None
    parent_from_node: NDArray[np.float64]
    size_m: tuple[float, float, float] | None = None
    opening_m: float = _DEFAULT_OPENING_M
    region_m: tuple[float, float, float] | None = None
    surface: SceneSurface | None = None
    facts: dict[str, Fact] = field(default_factory=dict)


@dataclass(frozen=True)
class Unplaced:
    """A thing or frame that is not in the scene, and why, in words."""

    iri: str
    label: str
    reason: str


@dataclass(frozen=True, eq=False)
class Scene:
    """What is where in one tree of frames at an instant.

    Parameters
    ----------
    time_s
        Unix time.
    nodes
        Each one after its parent; the first is the root of the tree. Empty if the graph has no
        frames.
    other_roots
        IRIs of the roots of the other trees, and how many things are in each. They cannot be
        drawn in the same space, for nobody knows how they stand to this one.
    unplaced
        Things that have a place without a pose, and frames that contradict each other.
    """

    time_s: float
    nodes: tuple[SceneNode, ...]
    other_roots: tuple[tuple[str, int], ...] = ()
    unplaced: tuple[Unplaced, ...] = ()

    @property
    def root(self) -> str:
        """IRI of the frame in which the scene is, or ""."""
        return self.nodes[0].iri if self.nodes else ""

    def root_from_nodes(self) -> list[NDArray[np.float64]]:
        """Return the pose (4, 4), m, of each node in the root."""
        poses: list[NDArray[np.float64]] = []
        for node in self.nodes:
            above = np.eye(4) if node.parent is None else poses[node.parent]
            poses.append(above @ node.parent_from_node)
        return poses


def grasp_lines(opening_m: float) -> NDArray[np.float64]:
    """Return the lines (4, 2, 3), m, that draw a gripper in the frame of its grasp.

    Two fingers along z that close along x, the palm between them, and a stem.
    """
    half = opening_m / 2
    return np.array([
        [(half, 0, -_FINGER_M), (half, 0, 0)],
        [(-half, 0, -_FINGER_M), (-half, 0, 0)],
        [(half, 0, -_FINGER_M), (-half, 0, -_FINGER_M)],
        [(0, 0, -_FINGER_M), (0, 0, -_FINGER_M - _STEM_M)],
    ])  # fmt: skip


def region_lines(size_m: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the edges (n, 2, 3), m, of the space within a place; four of one without a rim.

    >>> len(region_lines((0.4, 0.3, 0.1))), len(region_lines((0.4, 0.3, 0.0)))
    (12, 4)
    """
    corners = box_corners(size_m)
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
    if not size_m[2]:
        edges = [(a, b) for a, b in edges if not (a % 2 or b % 2)]
    return np.asarray(corners[np.array(edges)])


def wall_boxes(size_m: tuple[float, float, float]) -> list[NDArray[np.float64]]:
    """Return the corners (8, 3), m, of each part of a place: its plate, and the walls if any.

    The plate lies below the surface, and the walls around it, so that things stand between them.

    >>> len(wall_boxes((0.5, 0.8, 0.0))), len(wall_boxes((0.2, 0.2, 0.1)))
    (1, 5)
    """
    length, width, rim = size_m
    outer = (length + 2 * _WALL_M, width + 2 * _WALL_M) if rim else (length, width)
    parts = [((*outer, _WALL_M), (0.0, 0.0, -_WALL_M))]
    if rim:
        for sign in (-1, 1):
            parts += [
                ((_WALL_M, outer[1], rim), (sign * (length + _WALL_M) / 2, 0.0, 0.0)),
                ((length, _WALL_M, rim), (0.0, sign * (width + _WALL_M) / 2, 0.0)),
            ]
    return [box_corners(size) + np.array(middle) for size, middle in parts]


def box_corners(size_m: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the corners (8, 3), m, of a thing's box in its frame, x changing slowest.

    >>> box_corners((0.2, 0.1, 0.3))[[0, 7]].tolist()
    [[-0.1, -0.05, 0.0], [0.1, 0.05, 0.3]]
    """
    x, y, z = size_m
    return np.array(
        [(a * x / 2, b * y / 2, c * z) for a in (-1, 1) for b in (-1, 1) for c in (0, 1)]
    )
