"""What a program finds in a hand when it is started again: felt, looked at, and put down.

A program that is killed while its robot carries something leaves the arm where it is. The next one
knows neither the grasp nor the way; it has what the graph says that the hand holds, the fingers,
and the camera. From these it makes a plan that begins where the arm is.
"""

from __future__ import annotations

import numpy as np

from features.geometry import transform
from grasp.spatial.planar import tip_heights
from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.judgement import CLOSED_ON_SOMETHING, Judgement
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import SPEED
from simulate.motion.collision import Obstacle
from simulate.motion.kinematics import follow_line
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, time_path
from simulate.robots.description import Floats
from simulate.tasks.arms.station_body import RobotAtBench

__all__ = ["is_away", "resumed"]

Size = tuple[float, float, float]

_AWAY_RAD = 0.05
_AROUND_M = 0.10
"""Around the tool, where what a hand holds is seen."""
_FEW_POINTS = 30
_HELD_M = 0.02
"""From the tool, nearer than which only what it holds can be."""
_DEFAULT_M = 0.04
"""Side of what is held, not seen and not known, for which the hand leaves room."""
_WHOLE = 0.8
"""Of the height of a thing, from which on it is seen as a whole."""
_OVER_TABLE_M = 0.004
_SHOWN_M = 0.010


def is_away(robot: RobotAtBench, arm: str) -> bool:
    """Return whether an arm is elsewhere than at home, where programs leave it when they end."""
    joints, home = robot.robot.arm_joints(arm), robot.robot.home(arm)
    return bool(np.max(np.abs(joints - home)) > _AWAY_RAD)


def resumed(
    robot: RobotAtBench, arm: str, seed: int, size: Size | None = None
) -> AttemptRun | None:
    """Return a run with what an arm holds, to be put down; None, with the arm at home, for nothing.

    Parameters
    ----------
    robot
        The robot, whose arm stands where another program left it.
    seed
        Of the planner's choices.
    size
        Extents (x, y, z), m, of what the graph has in the hand, standing; None if unknown.
    """
    plan = _plan(robot, arm, seed, size)
    run = robot.executor.begin(plan)
    run.drive.close()
    opening = run.drive.end("close").opening
    if opening <= CLOSED_ON_SOMETHING:
        run.drive.go_home(plan.free)
        return None
    run.held = Judgement("yes", f"opening {opening:.2f} where the arm was left")
    run.reason = "ok"
    return run


def _plan(robot: RobotAtBench, arm: str, seed: int, size: Size | None) -> PlannedGrasp:
    """Return a plan that ends where the arm is now, with what is held as the camera sees it."""
    body, executor = robot.robot, robot.executor
    space = executor.space_of(body.stance)
    chain, joints, tool = space.chains[arm], body.arm_joints(arm), body.tool_pose(arm)
    table = body.description.workplace.table_height
    points = _held_points(robot, arm, tool, size)
    extent = np.ptp(points, axis=0)
    width = max(body.finger_opening(arm), 0.0) * body.arm(arm).mouth
    closing = float(np.arctan2(tool[1, 0], tool[0, 0]) % np.pi)
    request = GraspRequest(
        float(tool[0, 3]), float(tool[1, 3]), closing, width=width, height=float(extent[2]),
        length=float(max(extent[:2])), table_height=table, arm=arm, points=points,
        bottom=max(float(points[:, 2].min()), table),
    )  # fmt: skip
    down = max(request.base_height - table - _OVER_TABLE_M, 0.0)
    line = follow_line(chain, joints, np.array([0.0, 0.0, -down])) if down > 0 else None
    low = joints if line is None else line[-1]
    lift = np.stack([joints, joints]) if line is None else line[::-1]
    solids = (*_standing_around(robot, arm, tool, table), *robot.station.others())
    around = space.surroundings(arm, table, solids)
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
        obstacles=solids, ik_solutions=0, planning_s=0.0, seed=seed,
        stance=body.stance,
    )  # fmt: skip


def _standing_around(
    robot: RobotAtBench, arm: str, tool: Floats, table: float
) -> tuple[Obstacle, ...]:
    """Return what stands where an arm works, base frame, without what it holds up.

    The program before knew of these things; without them the way would lead through them.
    """
    clouds = [seen.points.astype(np.float64)
              for area in robot.station.post.reach[arm]
              if not robot.station.bench.layout.area(area).is_box
              for seen in robot.look_at(area)[1]]  # fmt: skip
    clouds = [points for points in clouds
              if np.linalg.norm(points - tool[:3, 3], axis=1).min() > _HELD_M]  # fmt: skip
    return tuple(Obstacle.around("neighbour", points, table) for points in clouds)


def _stay(joints: Floats, velocity: Floats) -> Trajectory:
    return time_path(np.stack([joints, joints]), velocity)


def _held_points(robot: RobotAtBench, arm: str, tool: Floats, size: Size | None) -> Floats:
    """Return what is held, (n, 3), m, base frame, without the arm: as seen, else as it is known.

    A thing whose lower end the camera does not show would be pressed into the table: then it
    reaches as far down as it does in a grasp from above.
    """
    body = robot.robot
    table = body.description.workplace.table_height
    points = _seen_points(robot, tool)
    near = np.linalg.norm(points - tool[:3, 3], axis=1) < _AROUND_M
    points = points[near & (points[:, 2] > table + _SHOWN_M)]
    spheres = robot.executor.space_of(body.stance).spheres(arm, body.finger_opening(arm))
    points = points[~spheres.shows(body.arm_joints(arm), points, _SHOWN_M)]
    expected = _expected_points(tool, size)
    if len(points) < _FEW_POINTS:
        return expected
    is_whole = size is None or np.ptp(points[:, 2]) > _WHOLE * size[2]
    return np.asarray(points) if is_whole else np.concatenate([points, expected])


def _seen_points(robot: RobotAtBench, tool: Floats) -> Floats:
    """Return the points (n, 3), m, base frame, of all views of the area that an arm is over."""
    area = robot.station.area_at(tool[:3, 3])
    if not area:
        return robot.eyes.points("left" if tool[1, 3] > 0 else "right")
    clouds = []
    for number in range(len(robot.viewpoints(area))):
        view, _ = robot.look_at(area, number)
        cloud = view.frame.points().reshape(-1, 3).astype(np.float64)
        seen = cloud[np.isfinite(cloud).all(axis=1) & (cloud[:, 2] > 0)]
        clouds.append(np.asarray(transform(view.base_from_camera, seen), dtype=np.float64))
    return np.concatenate(clouds)


def _expected_points(tool: Floats, size: Size | None) -> Floats:
    """Return the corners (8, 3), m, base frame, of what is held, by its size or as a small cube."""
    x, y, z = size or (_DEFAULT_M,) * 3
    low = tip_heights(z, min(x, y), max(x, y))[0]
    corners = np.array(np.meshgrid([-x / 2, x / 2], [-y / 2, y / 2], [-low, max(z - low, 0.0)]))
    return np.asarray(tool[:3, 3] + corners.reshape(3, -1).T)
