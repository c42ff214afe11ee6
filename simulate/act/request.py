"""Requests of the act service, with the names and the spelling of Gatto 2016, 4.3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

import numpy as np
from annotated_types import Ge, Le

from rtask.errors import UsageError, nearest
from rtask.wire.message import Message, read
from rtask.wire.types import Number, Pose, Text, Unit, Whole
from simulate.robots import Arm, RobotDescription

__all__ = ["ACTIONS", "ActMessage", "ActRequest"]


class ActMessage(Message):
    """Request to the act service, as it comes over the wire."""

    robot_name: Text | None = None
    """which robot; empty = the one that is called"""
    action_type: Literal["reach", "grasp", "place", "pick_place", "home"] = "reach"
    """what to do"""
    arm_name: Text = "auto"
    """arm; auto = the one on the goal's side, else the other"""
    plan_name: Literal["rrt_connect"] = "rrt_connect"
    """planner"""
    end_eff_name: Text | None = None
    """hand, instead of the arm"""
    attempts_max_in: Annotated[Whole, Ge(0), Le(100)] = 5
    """planning attempts; 0 = 5"""
    planing_time_in: Annotated[Number, Unit("s"), Ge(0), Le(600)] = 5.0
    """limit over all attempts, in time of an idle machine; 0 = 5 s"""
    tolerance_min_in: Annotated[Number, Unit("m"), Ge(0), Le(0.05)] = 0.0025
    """tolerance of the tool's position; 0 = 2.5 mm"""
    angle_resolution_in: Annotated[Number, Unit("rad"), Ge(0), Le(1.5708)] = 0.2618
    """step by which theta is turned, to either side, until it can be reached; 0 = theta only"""
    grasp_depth_in: Annotated[Number, Unit("m"), Ge(0), Le(0.2)] = 0.0
    """tool below the goal; 0 = as the object's height tells"""
    distance_error_allowed: Annotated[Number, Unit("m"), Ge(0), Le(0.5)] = 0.01
    """largest error of the tool that counts as reached; 0 = 1 cm"""
    goal_pose: Pose | None = None
    """centre of mass of the object, base frame; of the orientation only the yaw counts: the
    closing direction"""


ACTIONS = get_args(ActMessage.model_fields["action_type"].annotation)


@dataclass(frozen=True)
class ActRequest:
    """A checked request.

    Parameters
    ----------
    action
        One of :data:`ACTIONS`.
    arm
        Name of an arm, or ``auto``.
    attempts, planning_s, tolerance, angle_step, depth, error_allowed
        Limits; s, m, rad.
    position : (x, y, z), m, base frame
    theta
        Closing direction about +z, rad.
    """

    action: str
    arm: str = "auto"
    attempts: int = 5
    planning_s: float = 5.0
    tolerance: float = 0.0025
    angle_step: float = 0.2618
    depth: float = 0.0
    error_allowed: float = 0.01
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    theta: float = 0.0

    @classmethod
    def read(
        cls, message: Mapping[str, Any], robot: RobotDescription, name: str = ""
    ) -> ActRequest:
        """Check a message.

        Parameters
        ----------
        message
            Fields of :class:`ActMessage`; a number 0 stands for the default where 0 makes no sense,
            as typed ROS clients send every field.
        robot
            The robot that is called.
        name
            Further name of the robot, besides that of its model.

        Raises
        ------
        UsageError
            An unknown field (with a suggestion), or an invalid value.
        RobotError
            No such arm.
        """
        given = dict(message)
        if given.get("action_type") == "home":
            given.pop("goal_pose", None)  # means nothing, and typed clients send zeros
        fields, default = read(ActMessage, given), ActMessage()
        names = [robot.name, *([name] if name else [])]
        if fields.robot_name and fields.robot_name not in names:
            asked = fields.robot_name
            hint = nearest(asked, names) or f"; this is {' or '.join(names)}"
            raise UsageError(f"robot_name: unknown robot {asked!r}{hint}", field="robot_name")
        arm = _arm_name(robot, fields.arm_name, fields.end_eff_name)
        pose = fields.goal_pose
        if pose is None:
            if fields.action_type != "home":
                raise UsageError("goal_pose is missing: the pose to reach", field="goal_pose")
            pose = np.eye(4)
        x, y, z = (float(v) for v in pose[:3, 3])
        return cls(
            action=fields.action_type,
            arm=arm,
            attempts=fields.attempts_max_in or default.attempts_max_in,
            planning_s=fields.planing_time_in or default.planing_time_in,
            tolerance=fields.tolerance_min_in or default.tolerance_min_in,
            angle_step=fields.angle_resolution_in,
            depth=fields.grasp_depth_in,
            error_allowed=fields.distance_error_allowed or default.distance_error_allowed,
            position=(x, y, z),
            theta=float(np.arctan2(pose[1, 0], pose[0, 0])),
        )


def _arm_name(robot: RobotDescription, arm: str, hand: str | None) -> str:
    """Return the arm that arm_name and end_eff_name select."""
    named = None if arm == "auto" else robot.arm(arm)
    if not hand:
        return "auto" if named is None else named.name
    owner = _owner(robot, hand)
    if named is not None and named is not owner:
        raise UsageError(
            f"end_eff_name: {hand!r} is the hand of {owner.name}, not of {named.name}",
            field="end_eff_name",
        )
    return owner.name


def _owner(robot: RobotDescription, hand: str) -> Arm:
    arm_of_name: dict[str, Arm] = {}
    for arm in robot.arms.values():
        arm_of_name.update(dict.fromkeys((arm.end_effector, *arm.aliases), arm))
    if hand not in arm_of_name:
        hint = nearest(hand, list(arm_of_name)) or f"; known: {', '.join(arm_of_name)}"
        raise UsageError(f"end_eff_name: unknown hand {hand!r}{hint}", field="end_eff_name")
    return arm_of_name[hand]
