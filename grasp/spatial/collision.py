"""Collision of the gripper with support and surrounding objects (Gatto 2016, 3.3.3).

A straight approach sweeps each box of the gripper along its own z axis; what it passes is a longer
box, so that the sweep is exact and costs no more than one pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.gripper import EndEffector, ParallelGripper

if TYPE_CHECKING:
    from grasp.spatial.meshes.mesh import Mesh

__all__ = [
    "FREE",
    "LOW_M",
    "SLIDE",
    "Room",
    "Support",
    "Surroundings",
    "finger_clearances",
    "room_around",
    "swept_boxes",
]

FREE = 0.05
"""Clearance that is reported when nothing is near, m: more than any finger needs."""

_HIT_BY = ("free", "object", "neighbours", "support")
"""Obstacles that a gripper would touch, by code."""

LOW_M = 0.03
"""Things lower than this count as plates, m: what forbids a grasp of them is the support."""

SLIDE = "slide it to the edge of its support and take it by the side that stands over"
"""Advice for a plate that lies flat."""

_TIP_SLACK = 0.004


@dataclass(frozen=True)
class Support:
    """The plane on which things stand.

    Parameters
    ----------
    height
        Of the plane along ``normal``, m.
    normal : (3,)
        Unit vector out of the support, up.
    clearance
        That the gripper keeps from it, m.
    """

    height: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    clearance: float = 0.002

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.normal))
        if not (np.isfinite(self.height) and abs(length - 1) < 1e-6):
            raise ValueError(
                "a support has a finite height, m, and a unit normal, got "
                f"{self.height} and {self.normal}"
            )

    @property
    def up(self) -> NDArray[np.float64]:
        """Unit vector out of the support (3,)."""
        return np.array(self.normal, dtype=np.float64)

    @property
    def plane(self) -> NDArray[np.float64]:
        """Plane n . p + d = 0 under what stands on it, (4,): its normal and d, m."""
        return np.array([*self.normal, -self.height])

    def below(self, poses: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how high the lowest corner of each gripper is over the plane (c,), m."""
        middle, half = boxes.mean(axis=2), np.ptp(boxes, axis=2) / 2
        along = np.einsum("cij,i->cj", poses[:, :3, :3], self.up)
        origin = poses[:, :3, 3] @ self.up - self.height
        low = np.einsum("cbj,cj->cb", middle, along) - np.einsum("cbj,cj->cb", half, abs(along))
        return np.asarray(origin + low.min(axis=1))


@dataclass(frozen=True)
class Surroundings:
    """Obstacles that the gripper must not touch besides the object.

    Parameters
    ----------
    support
        None = the object floats.
    neighbours : (m, 3) or None, m
        Points of other objects, in the object's frame.
    sweep
        Length of the straight approach, m.
    """

    support: Support | None = None
    neighbours: NDArray[np.float64] | None = None
    sweep: float = 0.05


@dataclass(frozen=True)
class Room:
    """Clearance of grippers in their poses.

    Parameters
    ----------
    clearance : (c,), m
        To support, neighbours and object, 0 where one of them is touched; at most :data:`FREE`.
    hit : (c,) int
        0 = nothing is touched, 1 the object, 2 neighbours, 3 the support.
    """

    clearance: NDArray[np.float64]
    hit: NDArray[np.int64]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Poses that touch nothing, (c,) bool."""
        return np.asarray(self.hit == 0)

    def hits(self) -> dict[str, int]:
        """Return how many poses touch each kind of obstacle, by its name."""
        return {name: int((self.hit == k).sum()) for k, name in enumerate(_HIT_BY) if k}


def room_around(
    poses: NDArray[np.float64],
    openings: NDArray[np.float64],
    gripper: EndEffector,
    surroundings: Surroundings,
    mesh: Mesh | None = None,
    cloud: NDArray[np.float64] | None = None,
) -> Room:
    """Check opened grippers at the end of and along a straight approach.

    Parameters
    ----------
    poses : (c, 4, 4)
        ``object_from_gripper``.
    openings : (c,), m
        Before closing.
    mesh
        Of the object: tested exactly.
    cloud : (n, 3) or None, m
        Of the object; with a mesh only its distance counts, without one its points are obstacles.
    """
    from grasp.spatial.boxes import boxes_meet_mesh, distance_to_points

    count = len(poses)
    clearance, hit = np.full(count, FREE), np.zeros(count, np.int64)
    if count == 0:
        return Room(clearance, hit)
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    swept = swept_boxes(gripper, openings, surroundings.sweep)
    if surroundings.support is not None:
        height = surroundings.support.below(poses, swept)
        hit[height < surroundings.support.clearance] = 3
        clearance = np.minimum(clearance, np.maximum(height, 0.0))
    obstacles = [(surroundings.neighbours, 2), (cloud, 1)]
    for points, code in obstacles:
        if points is None or len(points) == 0:
            continue
        near = np.ascontiguousarray(points[np.isfinite(points).all(axis=1)], dtype=np.float64)
        away = distance_to_points(near, poses, swept, FREE)
        clearance = np.minimum(clearance, away)
        hit[away <= 0] = code
    rest = np.flatnonzero(hit == 0)
    if mesh is not None and len(mesh.faces) and len(rest):
        touched = boxes_meet_mesh(*mesh.tree.arrays, poses[rest], swept[rest])
        hit[rest[touched]] = 1
    clearance[hit != 0] = 0.0
    return Room(clearance, hit)


def swept_boxes(
    gripper: EndEffector, openings: NDArray[np.float64], sweep: float
) -> NDArray[np.float64]:
    """Return the boxes (c, b, 2, 3), m, of a gripper at openings (c,) along straight approaches."""
    values, which = np.unique(openings, return_inverse=True)
    return np.stack([gripper.boxes(float(value), sweep) for value in values])[which]


def finger_clearances(
    centres: NDArray[np.float64],
    thetas: NDArray[np.float64],
    openings: NDArray[np.float64],
    tip_heights: NDArray[np.float64],
    gripper: ParallelGripper,
    neighbours: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """Return the distance (n,) from the opened fingers to the nearest neighbour, m.

    Each finger is a post of square section that stands on its tip outside the opening. Both are
    checked at the opening from which they close; on the way they only move inwards.

    Parameters
    ----------
    centres : (n, 2), m
        Midway between the jaws.
    thetas : (n,), rad
        Closing directions.
    openings : (n,), m
        Distances between the jaws before closing.
    tip_heights : (n,), m
        Of the fingertips over the support; what lies lower passes under them.
    neighbours : (m, 3) or None, m
        Points of other objects: x, y in the frame of ``centres``, z over the support; not finite
        ones are left out.

    Returns
    -------
    0 when a finger would stand in a neighbour; at most :data:`FREE`.
    """
    if neighbours is not None:
        neighbours = neighbours[np.isfinite(neighbours).all(axis=1)]
    if neighbours is None or len(neighbours) == 0:
        return np.full(len(thetas), FREE)
    cos, sin = np.cos(thetas), np.sin(thetas)
    frame_from_jaws = np.stack(
        [np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1
    )
    local = (neighbours[None, :, :2] - centres[:, None]) @ frame_from_jaws
    half = gripper.finger_width / 2
    out_x = np.abs(np.abs(local[..., 0]) - (openings / 2 + half)[:, None]) - half
    out_y = np.abs(local[..., 1]) - half
    distance = np.hypot(np.maximum(out_x, 0.0), np.maximum(out_y, 0.0))
    reached = neighbours[None, :, 2] > (tip_heights - _TIP_SLACK)[:, None]
    distance[~reached] = FREE
    return np.asarray(np.minimum(distance.min(axis=1), FREE))
