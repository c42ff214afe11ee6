"""Robots put together: a gripper hung on an arm, joints that stay still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rtask.errors import RobotError
from simulate.robots.description import (
    Inertial,
    Joint,
    Link,
    Pose,
    RobotDescription,
    Shape,
    transform_from,
)
from simulate.robots.other_hands import links_of, other_hand
from simulate.robots.urdf_reader import ReadRobot, read_urdf

__all__ = ["attach", "gripper_of", "hold_still", "jaw_gripper"]

_TOOL = "tool0"
_PAD = (0.020, 0.010, 0.050)
"""Of a finger of the generated gripper: across, along the closing axis, long, m."""
_PALM_M = 0.06


def gripper_of(text: str, strict: bool) -> ReadRobot:
    """Return the links of a gripper.

    Parameters
    ----------
    text
        A URDF file, ``jaw:STROKE``, ``suction:RADIUS`` or ``three:OPENING`` (m), or a file that
        describes a suction cup or a hand with three fingers.
    """
    other = other_hand(text)
    if other is not None:
        return links_of(other)
    kind, _, stroke = text.partition(":")
    if kind != "jaw":
        return read_urdf(Path(text), strict=strict)
    try:
        return jaw_gripper(float(stroke))
    except ValueError:
        raise RobotError(
            f"gripper {text!r}: expected a URDF file, or jaw:STROKE with the stroke in m"
        ) from None


def jaw_gripper(stroke: float) -> ReadRobot:
    """Return a plain gripper with two sliding jaws, which closes along y and approaches along z.

    Parameters
    ----------
    stroke
        Opening between the open jaws, 0.01 to 0.2 m.
    """
    if not 0.01 <= stroke <= 0.2:
        raise RobotError(f"a jaw of {stroke:g} m: the stroke must lie in 0.01 .. 0.2 m")
    _, thick, long = _PAD
    wide = stroke + 4 * thick
    palm = Shape("box", (0.05, wide, _PALM_M), Pose((0.0, 0.0, _PALM_M / 2)))
    links = [Link("jaw_palm", _box_inertial(0.6, palm), (palm,))]
    joints = []
    for side, sign in (("left", 1), ("right", -1)):
        pad = Shape("box", _PAD, Pose((0.0, sign * thick / 2, long / 2)))
        links.append(Link(f"jaw_{side}", _box_inertial(0.1, pad), (pad,)))
        joints.append(
            Joint(
                f"jaw_{side}_joint", "jaw_palm", f"jaw_{side}", Pose((0.0, 0.0, _PALM_M)),
                (0.0, float(sign), 0.0), "prismatic", 0.0, stroke / 2, 0.2, 20.0,
            )
        )  # fmt: skip
    return ReadRobot("jaw", "jaw_palm", tuple(links), tuple(joints))


def _box_inertial(mass: float, shape: Shape) -> Inertial:
    x, y, z = (side**2 for side in shape.size)
    moments = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    return Inertial(mass, shape.pose.xyz, moments)


def attach(
    arm: ReadRobot, gripper: ReadRobot, on: str | None = None
) -> tuple[ReadRobot, tuple[str, ...]]:
    """Return a robot with a gripper fixed to one of its links, and the gripper's warnings.

    Parameters
    ----------
    arm, gripper
        Both robots; links and joints of the gripper whose names are taken get the prefix
        ``gripper_``.
    on
        The link; None = ``tool0``, else the last link of the longest chain.
    """
    links = {link.name for link in arm.links}
    flange = on or (_TOOL if _TOOL in links else _longest_end(arm))
    if flange not in links:
        raise RobotError(f"the gripper cannot hang on {flange!r}: the robot has no such link")
    taken = links | {joint.name for joint in arm.joints}

    def free(name: str) -> str:
        return f"gripper_{name}" if name in taken else name

    more_links = tuple(replace(link, name=free(link.name)) for link in gripper.links)
    more_joints = tuple(
        replace(
            joint,
            name=free(joint.name),
            parent=free(joint.parent),
            child=free(joint.child),
            mimic=(free(joint.mimic[0]), joint.mimic[1]) if joint.mimic else None,
        )
        for joint in gripper.joints
    )
    mount = Joint("gripper_mount", flange, free(gripper.root), Pose(), kind="fixed")
    joined = replace(
        arm, links=(*arm.links, *more_links), joints=(*arm.joints, mount, *more_joints)
    )
    return joined, gripper.warnings


def _longest_end(robot: ReadRobot) -> str:
    """Return the last link of the chain with the most moving joints."""
    moving, depth = {robot.root: 0}, {robot.root: 0}
    for joint in robot.joints:  # parents come first
        moving[joint.child] = moving[joint.parent] + (joint.kind != "fixed")
        depth[joint.child] = depth[joint.parent] + 1
    most = max(moving.values())
    return max((link for link in moving if moving[link] == most), key=lambda link: depth[link])


def hold_still(robot: RobotDescription, rest: Mapping[str, float]) -> RobotDescription:
    """Return a robot with the joints of ``rest`` fixed at their values (rad or m), welded."""
    names = {joint.name for joint in robot.joints}
    for name in rest:
        if name not in names:
            raise RobotError(f"robot {robot.name!r} has no joint {name!r} to hold still")
    joints = tuple(
        _fixed_at(joint, rest[joint.name]) if joint.name in rest else joint
        for joint in robot.joints
    )
    return replace(robot, joints=joints).welded()


def _fixed_at(joint: Joint, value: float) -> Joint:
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    if joint.kind == "prismatic":
        x, y, z = (float(v) for v in value * axis)
        moved = transform_from((x, y, z))
    else:
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        moved = np.eye(4)
        moved[:3, :3] += np.sin(value) * cross + (1 - np.cos(value)) * cross @ cross
    return replace(joint, pose=Pose.of(joint.pose.matrix @ moved), kind="fixed", mimic=None)
