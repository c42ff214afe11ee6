"""Motion of an arm to a goal, planned with the model of the robot for whatever drives the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rtask.errors import RobotError
from simulate.act.request import ActRequest
from simulate.act.service import plan_goal
from simulate.grasping.executor import Workcell
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.collision import Obstacle, PointField

__all__ = ["plan_reach"]


def plan_reach(
    cell: Workcell,
    position: tuple[float, float, float],
    theta: float,
    seed: int,
    obstacles: Sequence[Obstacle | PointField] = (),
) -> PlannedGrasp:
    """Plan to reach a position over a table from the arm's home posture.

    Parameters
    ----------
    cell
        With the model of the robot.
    position
        Of the middle of an object, m, base frame.
    theta
        Closing direction about +z, rad; others are tried if it is out of reach.
    seed
        Of the plan.
    obstacles
        What stands around, base frame.

    Raises
    ------
    RobotError
        No motion was planned, or only one in a stance that a driver of arms cannot take.
    """
    x, y, z = position
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(theta / 2), "w": math.cos(theta / 2)}
    goal = {"position": {"x": x, "y": y, "z": z}, "orientation": turn}
    request = ActRequest.read({"goal_pose": goal}, cell.description)
    plan = plan_goal(cell, request, seed, obstacles)
    if isinstance(plan, str):
        unknown = (
            ""
            if plan == "grasp_collision"
            else "; the search is bounded: another --seed may find one"
        )
        raise RobotError(f"no motion to ({x:g}, {y:g}, {z:g}) was planned: {plan}{unknown}")
    if plan.stance not in ("", cell.robot.stance):
        raise RobotError(f"({x:g}, {y:g}, {z:g}) needs the stance {plan.stance}")
    return plan
