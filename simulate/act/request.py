"""Requests of the act service, with the names and the spelling of Gatto 2016, 4.3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rtask.engine.operations.messages import Field, nearest, read
from rtask.errors import UsageError
from simulate.robots import Arm, RobotDescription

__all__ = ["ACTIONS", "ACT_FIELDS", "PLANNERS", "ActRequest"]

ACTIONS = ("reach", "grasp", "place", "pick_place", "home")
PLANNERS = ("rrt_connect",)

ACT_FIELDS = (
    Field("robot_name", "string", "which robot; empty = the one that is asked"),
    Field("action_type", "string", "what to do", default="reach", choices=ACTIONS),
    Field("arm_name", "string", "arm; auto = the one on the goal's side, else the other",
          default="auto"),
    Field("plan_name", "string", "planner", default="rrt_connect", choices=PLANNERS),
    Field("end_eff_name", "string", "hand, instead of the arm"),
    Field("attempts_max_in", "integer", "planning attempts; 0 = 5", default=5, low=0, high=100),
    Field("planing_time_in", "number", "limit over all attempts, s; 0 = 5", default=5.0, low=0.0,
          high=600.0),
    Field("tolerance_min_in", "number", "tolerance of the tool's position, m; 0 = .0025",
          default=0.0025, low=0.0, high=0.05),
    Field("angle_resolution_in", "number",
          "step by which theta is turned, to either side, until it can be reached, rad; "
          "0 = theta only", default=0.2618, low=0.0, high=1.5708),
    Field("grasp_depth_in", "number", "tool below the goal, m; 0 = as the object's height tells",
          default=0.0, low=0.0, high=0.2),
    Field("distance_error_allowed", "number",
          "largest error of the tool that counts as reached, m; 0 = .01", default=0.01, low=0.0,
          high=0.5),
    Field("goal_pose", "pose", "centre of mass of the object, base frame; of the orientation "
          "only the yaw counts: the closing direction"),
)  # fmt: skip


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
            Fields of :data:`ACT_FIELDS`; a number 0 stands for the default where 0 makes no sense,
            as typed ROS clients send every field.
        robot
            Who is asked.
        name
            Under which it is known besides its model's.

        Raises
        ------
        UsageError
            An unknown field (with the nearest known), or a wrong value.
        RobotError
            No such arm.
        """
        given = dict(message)
        if given.get("action_type") == "home":
            given.pop("goal_pose", None)  # means nothing, and typed clients send zeros
        fields = read(ACT_FIELDS, given)
        default = {field.name: field.default for field in ACT_FIELDS}
        known = [robot.name, *([name] if name else [])]
        if fields["robot_name"] and fields["robot_name"] not in known:
            asked = fields["robot_name"]
            hint = nearest(asked, known) or f"; this is {' or '.join(known)}"
            raise UsageError(f"robot_name: unknown robot {asked!r}{hint}", field="robot_name")
        arm = _arm_name(robot, fields["arm_name"], fields["end_eff_name"])
        pose = fields["goal_pose"]
        if pose is None:
            if fields["action_type"] != "home":
                raise UsageError("goal_pose is missing: where to go", field="goal_pose")
            pose = np.eye(4)
        x, y, z = (float(v) for v in pose[:3, 3])
        return cls(
            action=fields["action_type"],
            arm=arm,
            attempts=fields["attempts_max_in"] or default["attempts_max_in"],
            planning_s=fields["planing_time_in"] or default["planing_time_in"],
            tolerance=fields["tolerance_min_in"] or default["tolerance_min_in"],
            angle_step=fields["angle_resolution_in"],
            depth=fields["grasp_depth_in"],
            error_allowed=fields["distance_error_allowed"] or default["distance_error_allowed"],
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
    known: dict[str, Arm] = {}
    for arm in robot.arms.values():
        known.update(dict.fromkeys((arm.end_effector, *arm.aliases), arm))
    if hand not in known:
        hint = nearest(hand, list(known)) or f"; known: {', '.join(known)}"
        raise UsageError(f"end_eff_name: unknown hand {hand!r}{hint}", field="end_eff_name")
    return known[hand]
