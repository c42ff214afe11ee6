"""What a program finds in a hand when it is started again: felt, looked at, and put down.

A program that is killed while its robot carries something leaves the arm where it is. The next one
knows neither the grasp nor the way; it has what the graph says that the hand holds, the fingers,
and the camera. From these it makes a plan that begins where the arm is.
"""

from __future__ import annotations

import numpy as np

from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.judgement import CLOSED_ON_SOMETHING, Judgement
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import SPEED
from simulate.motion.kinematics import follow_line
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, time_path
from simulate.robots.description import Floats
from simulate.tasks.arms.station_body import RobotAtBench

__all__ = ["is_away", "resumed"]

_AWAY_RAD = 0.05
_AROUND_M = 0.10
"""Around the tool, where what a hand holds is seen."""
_FEW_POINTS = 30
_DEFAULT_M = 0.04
"""Side of what is held and not seen, for which the hand leaves room."""
_OVER_TABLE_M = 0.004
_SHOWN_M = 0.010


def is_away(robot: RobotAtBench, arm: str) -> bool:
    """Return whether an arm is elsewhere than at home, where programs leave it when they end."""
    joints, home = robot.robot.arm_joints(arm), robot.robot.home(arm)
    return bool(np.max(np.abs(joints - home)) > _AWAY_RAD)


def resumed(robot: RobotAtBench, arm: str, seed: int) -> AttemptRun | None:
    """Return a run with what an arm holds, to be put down; None, with the arm at home, for nothing.

    Parameters
    ----------
    robot
        The robot, whose arm stands where another program left it.
    seed
        Of the planner's choices.
    """
    plan = _plan(robot, arm, seed)
    run = robot.executor.begin(plan)
    run.drive.close()
    opening = run.drive.end("close").opening
    if opening <= CLOSED_ON_SOMETHING:
        run.drive.go_home(plan.free)
        return None
    run.held = Judgement("yes", f"opening {opening:.2f} where the arm was left")
    run.reason = "ok"
    return run


def _plan(robot: RobotAtBench, arm: str, seed: int) -> PlannedGrasp:
    """Return a plan that ends where the arm is now, with what is held as the camera sees it."""
    body, executor = robot.robot, robot.executor
    space = executor.space_of(body.stance)
    chain, joints, tool = space.chains[arm], body.arm_joints(arm), body.tool_pose(arm)
    table = body.description.workplace.table_height
    points = _held_points(robot, arm, tool)
    size = np.ptp(points, axis=0)
    width = max(body.finger_opening(arm), 0.0) * body.arm(arm).mouth
    closing = float(np.arctan2(tool[1, 0], tool[0, 0]) % np.pi)
    request = GraspRequest(
        float(tool[0, 3]), float(tool[1, 3]), closing, width=width, height=float(size[2]),
        length=float(max(size[:2])), table_height=table, arm=arm, points=points,
        bottom=max(float(points[:, 2].min()), table),
    )  # fmt: skip
    down = max(request.base_height - table - _OVER_TABLE_M, 0.0)
    line = follow_line(chain, joints, np.array([0.0, 0.0, -down])) if down > 0 else None
    low = joints if line is None else line[-1]
    lift = np.stack([joints, joints]) if line is None else line[::-1]
    around = space.surroundings(arm, table, robot.station.others())
    home = np.asarray(body.home(arm))
    free = space.path(arm, space.spheres(arm, 1.0), around, home, low, seed)
    if isinstance(free, str):
        free = time_path(np.stack([home, low]), SPEED["return"] * chain.velocity)
    return PlannedGrasp(
        request=request, arm=arm, opening=1.0, closing_angle=closing,
        tilt=float(np.arccos(np.clip(-tool[2, 2], -1.0, 1.0))),
        tool_height=float(tool[2, 3]) - table, posture=joints, free=free,
        approach=_stay(low, chain.velocity),
        lift=time_path(lift, SPEED["lift"] * chain.velocity, CARRYING_ACCELERATION),
        obstacles=tuple(robot.station.others()), ik_solutions=0, planning_s=0.0, seed=seed,
        stance=body.stance,
    )  # fmt: skip


def _stay(joints: Floats, velocity: Floats) -> Trajectory:
    return time_path(np.stack([joints, joints]), velocity)


def _held_points(robot: RobotAtBench, arm: str, tool: Floats) -> Floats:
    """Return what is seen around the tool (n, 3), m, base frame, without the arm; else a cube."""
    side = "left" if tool[1, 3] > 0 else "right"
    points = robot.eyes.points(side)
    body = robot.robot
    table = body.description.workplace.table_height
    near = np.linalg.norm(points - tool[:3, 3], axis=1) < _AROUND_M
    points = points[near & (points[:, 2] > table + _SHOWN_M)]
    spheres = robot.executor.space_of(body.stance).spheres(arm, body.finger_opening(arm))
    points = points[~spheres.shows(body.arm_joints(arm), points, _SHOWN_M)]
    if len(points) >= _FEW_POINTS:
        return np.asarray(points)
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.asarray(tool[:3, 3] + corners * _DEFAULT_M / 2)
