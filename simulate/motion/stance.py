"""Stances of a robot: other postures of its torso, and its balance in them.

A stance tilts the torso over the feet and leaves the base frame unchanged, so that plans in
different stances use the same coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rtask.errors import RobotError
from simulate.motion.collision import link_poses
from simulate.robots.description import Floats, Joint, Pose, RobotDescription, Stance

__all__ = ["UPRIGHT", "balance_margin", "centre_of_mass", "on_moving_legs", "stance_of", "standing"]

UPRIGHT = ""
"""Name of the stance in which a robot is described."""


def standing(robot: RobotDescription, name: str) -> RobotDescription:
    """Return a robot in one of its stances, with the joints of the stance fixed.

    Raises
    ------
    RobotError
        It has no such stance.
    """
    if name == UPRIGHT:
        return robot
    stance = stance_of(robot, name)
    joints = tuple(_rotated(joint, stance.joints.get(joint.name, 0.0)) for joint in robot.joints)
    return replace(robot, base_from_root=stance.base_from_root, joints=joints, stances={})


def stance_of(robot: RobotDescription, name: str) -> Stance:
    """Return a stance by its name; that of the description is :data:`UPRIGHT`."""
    if name == UPRIGHT:
        return Stance(robot.base_from_root, {})
    if name not in robot.stances:
        names = ", ".join(robot.stances) or "none"
        raise RobotError(f"robot {robot.name!r} has no stance {name!r}; it has {names}")
    return robot.stances[name]


def on_moving_legs(robot: RobotDescription) -> RobotDescription:
    """Return a robot whose stance joints move; they cost time, so they are welded until needed."""
    moving = {joint for stance in robot.stances.values() for joint in stance.joints}
    joints = tuple(
        replace(joint, kind="revolute") if joint.name in moving else joint for joint in robot.joints
    )
    return replace(robot, joints=joints)


def centre_of_mass(robot: RobotDescription, values: Mapping[str, float]) -> Floats:
    """Return the centre of mass (3,) m, base frame.

    Parameters
    ----------
    robot
        The robot in its stance.
    values
        Joint values, rad; 0 where absent.
    """
    poses = {robot.root: np.eye(4), **link_poses(robot.root, robot.joints, values)}
    masses = np.array([link.inertial.mass for link in robot.links])
    centres = np.array(
        [(poses[link.name] @ [*link.inertial.centre, 1.0])[:3] for link in robot.links]
    )
    centre = masses @ centres / masses.sum()
    return np.asarray((robot.base_from_root.matrix @ [*centre, 1.0])[:3])


def balance_margin(
    robot: RobotDescription,
    values: Mapping[str, float],
    load_kg: float = 0.0,
    load_at: Floats | None = None,
) -> float:
    """Return the distance (m) of the centre of mass inside the support polygon; negative = outside.

    Static balance, since the robot moves slowly. Infinite for a robot that is bolted down.

    Parameters
    ----------
    robot, values
        As of :func:`centre_of_mass`.
    load_kg, load_at
        Mass (kg) and position, (3,) m, base frame, of the held object.
    """
    if not robot.support:
        return float("inf")
    centre = centre_of_mass(robot, values)
    if load_at is not None:
        own = sum(link.inertial.mass for link in robot.links)
        centre = (own * centre + load_kg * load_at) / (own + load_kg)
    corners = np.array(robot.support)
    sides = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return float(np.min(np.sum(inward * (centre[:2] - corners), axis=1)))


def _rotated(joint: Joint, angle: float) -> Joint:
    """Return a fixed joint turned about its axis by an angle, rad."""
    if not angle:
        return joint
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    rotation = np.eye(4)
    rotation[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
    return replace(joint, pose=Pose.of(joint.pose.matrix @ rotation))
