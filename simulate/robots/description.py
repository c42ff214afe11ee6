"""What a robot is, as data: links, joints, arms with their hands, cameras.

A :class:`RobotDescription` knows no simulator. The URDF text, the kinematic chains, the collision
spheres of the planner and the body in the physics engine are all made from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RobotError

__all__ = [
    "Arm",
    "CameraMount",
    "Inertial",
    "Joint",
    "Link",
    "Pose",
    "RobotDescription",
    "Shape",
    "rotation_from_rpy",
    "transform_from",
]

Vector = tuple[float, float, float]
ArmName = Literal["left_arm", "right_arm"]


def rotation_from_rpy(rpy: Vector) -> NDArray[np.float64]:
    """Return the (3, 3) rotation of fixed-axis roll, pitch, yaw in rad (URDF convention)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def transform_from(xyz: Vector, rpy: Vector = (0, 0, 0)) -> NDArray[np.float64]:
    """Return the (4, 4) ``parent_from_child`` of an origin in m and rpy in rad."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(rpy)
    matrix[:3, 3] = xyz
    return matrix


@dataclass(frozen=True)
class Pose:
    """An origin (m) and fixed-axis roll, pitch, yaw (rad) in the parent's frame."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """A collision primitive in the frame of its link.

    ``size`` is (x, y, z) of a box, (radius,) of a sphere, (radius, length along z) of a cylinder.
    """

    kind: Literal["box", "sphere", "cylinder"]
    size: tuple[float, ...]
    pose: Pose = Pose()


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (m) and inertia at it (kg m^2), axes of the link."""

    mass: float
    centre: Vector
    diagonal: Vector
    off_diagonal: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Link:
    """A rigid part."""

    name: str
    inertial: Inertial
    shapes: tuple[Shape, ...] = ()
    colour: tuple[float, float, float, float] = (0.92, 0.92, 0.93, 1.0)


@dataclass(frozen=True)
class Joint:
    """A connection; ``velocity`` in rad/s, ``effort`` in N m."""

    name: str
    parent: str
    child: str
    pose: Pose
    axis: Vector = (0.0, 0.0, 1.0)
    kind: Literal["revolute", "fixed"] = "revolute"
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    mimic: tuple[str, float] | None = None


@dataclass(frozen=True)
class Arm:
    """An arm and the hand at its end.

    Parameters
    ----------
    name
        ``left_arm`` or ``right_arm``.
    side
        +1 left, -1 right: sign of y where the arm works.
    joints
        Names from the shoulder to the wrist.
    wrist
        Link that carries the hand.
    tcp, approach, closing
        Tool centre point (m) and unit axes in the wrist frame: z and x of the gripper frame.
    home
        Joint values (rad) between grasps, clear of the table and of the other arm.
    end_effector
        Name of the hand (Gatto 2016, 4.3: ``end_eff_name``).
    fingers
        Joints that close the hand; each moves from 0 (closed) to ``finger_range`` (open).
    mouth
        Largest object (m) between the fingers.
    max_payload
        kg.
    gripper_type
        Hands of one type share grasps.
    finger_width, finger_length
        m.
    max_force
        Of the closed hand, N.
    """

    name: ArmName
    side: int
    joints: tuple[str, ...]
    wrist: str
    tcp: Vector
    approach: Vector
    closing: Vector
    home: tuple[float, ...]
    end_effector: str
    fingers: tuple[str, ...]
    finger_range: float
    mouth: float
    max_payload: float
    gripper_type: str = "parallel_jaw"
    finger_width: float = 0.0124
    finger_length: float = 0.05
    max_force: float = 10.0


@dataclass(frozen=True)
class CameraMount:
    """An RGB-D camera: ``pose`` has x forward, z up; the optical frame is derived from it."""

    name: str
    parent: str
    pose: Pose
    frame_id: str = "camera_depth_optical_frame"
    size: tuple[int, int] = (640, 480)
    horizontal_fov: float = 1.2
    depth_range: tuple[float, float] = (0.15, 8.0)
    look: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Values of the joints that carry the camera, by side looked at."""


@dataclass(frozen=True)
class RobotDescription:
    """A robot: a tree of links, with arms and cameras named on it.

    ``base_height`` (m) lifts the root link so that the robot stands on z = 0 of its base frame.
    """

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    arms: Mapping[str, Arm]
    cameras: Mapping[str, CameraMount]
    base_height: float = 0.0
    frames: Mapping[str, tuple[str, Pose]] = field(default_factory=dict)
    model: str = ""

    def joint(self, name: str) -> Joint:
        """Return the joint of a name."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise RobotError(f"robot {self.name!r} has no joint {name!r}")

    def link(self, name: str) -> Link:
        """Return the link of a name."""
        for link in self.links:
            if link.name == name:
                return link
        raise RobotError(f"robot {self.name!r} has no link {name!r}")

    def arm(self, name: str) -> Arm:
        """Return the arm of a name."""
        if name not in self.arms:
            raise RobotError(
                f"robot {self.name!r} has no arm {name!r}; it has {', '.join(self.arms)}"
            )
        return self.arms[name]

    def path(self, link: str) -> list[Joint]:
        """Return the joints from the root to a link, in this order."""
        by_child = {joint.child: joint for joint in self.joints}
        path: list[Joint] = []
        while link != self.root:
            if link not in by_child:
                raise RobotError(f"link {link!r} of {self.name!r} hangs on nothing")
            path.append(by_child[link])
            link = path[-1].parent
        return path[::-1]

    def moving_joints(self) -> Iterator[Joint]:
        """Yield the joints that move."""
        return (joint for joint in self.joints if joint.kind != "fixed")
