"""Description of a robot as data: links, joints, arms with their hands, cameras.

A :class:`RobotDescription` is independent of any simulator. The URDF text, the kinematic chains,
the planner's collision spheres and the body in the physics engine are all derived from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from features.geometry import pose_matrix
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand
from rtask.errors import RobotError

__all__ = [
    "Arm",
    "CameraMount",
    "Floats",
    "Inertial",
    "Joint",
    "Link",
    "Pose",
    "RobotDescription",
    "Shape",
    "Workplace",
    "rotation_from_rpy",
    "rpy_from_rotation",
    "transform_from",
]

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]
Range = tuple[float, float]


def rpy_from_rotation(rotation: Floats) -> Vector:
    """Return fixed-axis roll, pitch, yaw (rad) of a (3, 3) rotation."""
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    if abs(np.cos(pitch)) < 1e-9:  # gimbal lock: all of the turn goes into roll
        roll = float(np.arctan2(-rotation[1, 2], rotation[1, 1]))
        return (roll, pitch, 0.0)
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return (roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0])))


def rotation_from_rpy(rpy: Vector) -> Floats:
    """Return the (3, 3) rotation of fixed-axis roll, pitch, yaw in rad (URDF convention)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def transform_from(xyz: Vector, rpy: Vector = (0, 0, 0)) -> Floats:
    """Return the (4, 4) ``parent_from_child`` of an origin in m and rpy in rad."""
    return pose_matrix(rotation_from_rpy(rpy), xyz)


@dataclass(frozen=True)
class Pose:
    """An origin (m) and fixed-axis roll, pitch, yaw (rad) in the parent's frame."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, matrix: Floats) -> Pose:
        """Return the pose of a (4, 4) transform."""
        x, y, z = (float(v) for v in matrix[:3, 3])
        return cls((x, y, z), rpy_from_rotation(matrix[:3, :3]))

    @property
    def matrix(self) -> Floats:
        """``parent_from_child`` (4, 4)."""
        return transform_from(self.xyz, self.rpy)


@dataclass(frozen=True)
class Shape:
    """A collision shape in the frame of its link.

    ``size`` is (x, y, z) of a box, (radius,) of a sphere, (radius, length along z) of a cylinder,
    scale (x, y, z) of a mesh. The file of a mesh, ``path``, is the user's own.
    """

    kind: Literal["box", "sphere", "cylinder", "mesh"]
    size: tuple[float, ...]
    pose: Pose = Pose()
    path: str = ""


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (m) and inertia at it (kg m^2), axes of the link."""

    mass: float
    centre: Vector
    diagonal: Vector
    off_diagonal: Vector = (0.0, 0.0, 0.0)

    @property
    def tensor(self) -> Floats:
        """Inertia (3, 3) at the centre of mass."""
        (xx, yy, zz), (xy, xz, yz) = self.diagonal, self.off_diagonal
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def joined(self, other: Inertial, self_from_other: Floats) -> Inertial:
        """Return both as one rigid part, in the frame of the first."""
        rotation, offset = self_from_other[:3, :3], self_from_other[:3, 3]
        centres = [np.array(self.centre), rotation @ np.array(other.centre) + offset]
        tensors = [self.tensor, rotation @ other.tensor @ rotation.T]
        masses = [self.mass, other.mass]
        mass = sum(masses)
        if mass == 0:
            return self
        centre = sum(m * c for m, c in zip(masses, centres, strict=True)) / mass
        total = np.zeros((3, 3))
        for m, c, tensor in zip(masses, centres, tensors, strict=True):  # Steiner
            arm = c - centre
            total += tensor + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        x, y, z = (float(v) for v in centre)
        xx, yy, zz = (float(v) for v in np.diag(total))
        off = (float(total[0, 1]), float(total[0, 2]), float(total[1, 2]))
        return Inertial(mass, (x, y, z), (xx, yy, zz), off)


@dataclass(frozen=True)
class Link:
    """A rigid part."""

    name: str
    inertial: Inertial
    shapes: tuple[Shape, ...] = ()
    colour: tuple[float, float, float, float] = (0.92, 0.92, 0.93, 1.0)


@dataclass(frozen=True)
class Joint:
    """A connection; a prismatic one counts in m, m/s and N instead of rad, rad/s and N m."""

    name: str
    parent: str
    child: str
    pose: Pose
    axis: Vector = (0.0, 0.0, 1.0)
    kind: Literal["revolute", "prismatic", "fixed"] = "revolute"
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    mimic: tuple[str, float] | None = None
    """Joint that this one follows, and by which factor."""
    mimic_offset: float = 0.0


@dataclass(frozen=True)
class Arm:
    """An arm and the hand at its end.

    Parameters
    ----------
    name
        Such as ``left_arm``.
    side
        Sign of y where the arm works: +1 left, -1 right, 0 the whole table.
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
    aliases
        Other names accepted for the hand.
    fingers
        Joints that close the hand.
    finger_range
        Value at which each is open, rad or m; closed is 0.
    finger_closed, finger_open
        Values of each finger joint, rad or m, where they differ from 0 and ``finger_range``; empty
        where they do not.
    mouth
        Largest object (m) between the fingers.
    max_payload
        kg.
    grip
        How the hand grasps: ``diagonal_mouth`` approaches from aside and below the fingers,
        ``parallel_jaws`` and ``three_fingers`` straight down, ``suction_cup`` onto what it takes.
    cup
        The cup where it grasps by suction; it has no fingers then.
    three
        The hand where it grasps with three fingers about an axis.
    kind
        Class of end effector in the ontology.
    gripper_type
        Hands of one type share grasps.
    finger_width, finger_length
        m.
    max_force
        Of the closed hand, N.
    close_effort, open_effort
        Of each finger joint, N m (prismatic: N).
    finger_speed
        rad/s (prismatic: m/s).
    """

    name: str
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
    close_effort: float = 0.06
    open_effort: float = 0.144
    finger_speed: float = 3.0
    grip: Literal["diagonal_mouth", "parallel_jaws", "suction_cup", "three_fingers"] = (
        "diagonal_mouth"
    )
    kind: Literal["Hand", "ParallelJawGripper", "SuctionCup", "ThreeFingerHand"] = "Hand"
    aliases: tuple[str, ...] = ()
    finger_closed: tuple[float, ...] = ()
    finger_open: tuple[float, ...] = ()
    cup: SuctionCup | None = None
    three: ThreeFingerHand | None = None

    @property
    def has_single_jaw(self) -> bool:
        """Whether one jaw moves and the other is part of the wrist link, where it stands still."""
        return self.grip == "parallel_jaws" and len(self.fingers) == 1

    def opening_share(self, opening_m: float) -> float:
        """Return an opening, m, as a share 0 .. 1 of the widest; a cup is always open."""
        return 1.0 if self.cup is not None else min(opening_m / self.mouth, 1.0)

    def finger_values(self, opening: float) -> dict[str, float]:
        """Return the value (rad or m) of each finger joint at an opening, 0 (closed) to 1."""
        closed, opened = self._finger_ends()
        values = closed + opening * (opened - closed)
        return {name: float(value) for name, value in zip(self.fingers, values, strict=True)}

    def finger_openings(self, values: Floats) -> Floats:
        """Return the opening (n,) of each finger joint at its value (n,), rad or m."""
        closed, opened = self._finger_ends()
        return np.asarray((values - closed) / (opened - closed))

    def _finger_ends(self) -> tuple[Floats, Floats]:
        count = len(self.fingers)
        closed = np.array(self.finger_closed or (0.0,) * count)
        return closed, np.array(self.finger_open or (self.finger_range,) * count)


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
class Workplace:
    """The table that suits a robot, with its boxes, base frame, m.

    Parameters
    ----------
    table_height, table_near, table_size
        Height of the top, x of the edge next to the robot, full size of the plate.
    box_centre, box_inner, box_height
        Boxes to place into: x and absolute y of their middles, inner side, height of the walls.
    area_x, area_abs_y
        Area for objects.
    eye, target
        Viewpoint of pictures for people, and the point that they show, on the right side.
    """

    table_height: float = 0.27
    table_near: float = 0.09
    table_size: Vector = (0.5, 0.8, 0.02)
    box_centre: Range = (0.15, 0.29)
    box_inner: float = 0.14
    box_height: float = 0.03
    area_x: Range = (0.120, 0.180)
    area_abs_y: Range = (0.030, 0.180)
    eye: Vector = (0.60, -0.34, 0.56)
    target: Vector = (0.12, -0.13, 0.32)

    @property
    def table_x(self) -> Range:
        """Range of x of the table top."""
        return (self.table_near, self.table_near + self.table_size[0])

    @property
    def table_y(self) -> Range:
        """Range of y of the table top."""
        return (-self.table_size[1] / 2, self.table_size[1] / 2)


@dataclass(frozen=True)
class Stance:
    """An alternative stance: the pose of the root link and the joints (rad) that produce it."""

    base_from_root: Pose
    joints: Mapping[str, float]


@dataclass(frozen=True)
class RobotDescription:
    """A robot: a tree of links, with arms and cameras named on it.

    ``base_from_root`` is the pose of the root link when the robot stands on z = 0 of its base
    frame. ``support`` holds the corners (x, y) m of its support polygon, counter-clockwise; it is
    empty for a robot that is bolted down. ``stances`` are alternative stances, the most similar
    first. ``may_touch`` are pairs of its links whose contact means nothing, because their shapes
    overlap.
    """

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    arms: Mapping[str, Arm]
    cameras: Mapping[str, CameraMount]
    base_from_root: Pose = Pose()
    frames: Mapping[str, tuple[str, Pose]] = field(default_factory=dict)
    model: str = ""
    base_frame: str = "base_footprint"
    workplace: Workplace = Workplace()
    stances: Mapping[str, Stance] = field(default_factory=dict)
    support: tuple[tuple[float, float], ...] = ()
    may_touch: tuple[tuple[str, str], ...] = ()

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
        """Return the arm of a name; ``left`` and ``right`` mean the arm that works on that side."""
        for arm in (name, f"{name}_arm"):
            if arm in self.arms:
                return self.arms[arm]
        for candidate in self.arms.values():
            if name in ("left", "right") and candidate.side == 0:
                return candidate
        raise RobotError(f"robot {self.name!r} has no arm {name!r}; it has {', '.join(self.arms)}")

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

    def welded(self) -> RobotDescription:
        """Return the same robot without fixed joints: child and parent become one link, which
        carries the frames of both.

        This saves the simulator the work for links that never move.
        """
        links = {link.name: link for link in self.links}
        joints, frames = list(self.joints), dict(self.frames)
        while fixed := next((joint for joint in joints if joint.kind == "fixed"), None):
            parent, child = links[fixed.parent], links.pop(fixed.child)
            offset = fixed.pose.matrix
            moved = tuple(
                replace(shape, pose=Pose.of(offset @ shape.pose.matrix)) for shape in child.shapes
            )
            inertial = parent.inertial.joined(child.inertial, offset)
            links[parent.name] = replace(parent, inertial=inertial, shapes=(*parent.shapes, *moved))
            frames = {
                name: (parent.name, Pose.of(offset @ pose.matrix))
                if link == child.name
                else (link, pose)
                for name, (link, pose) in frames.items()
            }
            joints.remove(fixed)
            joints = [
                replace(joint, parent=parent.name, pose=Pose.of(offset @ joint.pose.matrix))
                if joint.parent == child.name
                else joint
                for joint in joints
            ]
        return replace(self, links=tuple(links.values()), joints=tuple(joints), frames=frames)

    def moving_joints(self) -> Iterator[Joint]:
        """Yield the joints that move."""
        return (joint for joint in self.joints if joint.kind != "fixed")
