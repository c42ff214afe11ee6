"""Motions of a real arm: reach, grasp, come home; planned with the robot's model."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from rtask.errors import RobotError
from simulate.grasping.executor import Workcell
from simulate.grasping.judgement import CLOSED_ON_SOMETHING, Judgement, judge_held
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.collision import Obstacle, PointField
from simulate.motion.trajectory import Trajectory, join, reverse
from simulate.robots.description import Floats

__all__ = ["ArmDriver", "HandDriver", "bring_home", "grasp", "reach"]

_HOLD_S = 2.0
_AT_HOME_RAD = 0.05


class ArmDriver(Protocol):
    """An arm that tells its joints and follows trajectories."""

    def measured(self) -> Floats:
        """Return the measured joints (dof,), rad."""

    def follow(self, way: Trajectory) -> None:
        """Follow a trajectory from the measured pose, and wait for its end."""


class HandDriver(ArmDriver, Protocol):
    """An arm with a hand that opens and closes."""

    def move_hand(self, opening: float) -> None:
        """Drive the hand towards an opening, 0 (closed) to 1, and wait until it stops."""

    def opening(self) -> float:
        """Return the measured opening of the hand, 0 to 1."""


def reach(driver: ArmDriver, plan: PlannedGrasp, back: bool) -> None:
    """Move to the grasp of a plan and stay there, or return the same way.

    Raises
    ------
    RobotError, RemoteUnavailableError
        The arm does not follow; it stays where it is.
    """
    way = join([plan.free, plan.approach])
    driver.follow(way)
    if back:
        driver.follow(reverse(way))


def grasp(
    driver: HandDriver,
    plan: PlannedGrasp,
    cell: Workcell,
    wait: Callable[[float], None] = time.sleep,
) -> Judgement:
    """Grasp, lift, hold for two seconds, put back and go home; return whether something was held.

    The robot judges by the opening of its hand and by where its joints say that the tool is, as in
    simulation.

    Parameters
    ----------
    driver
        Of the plan's arm.
    plan
        The grasp.
    cell
        With the model of the robot.
    wait
        Sleeps so many seconds.

    Raises
    ------
    RobotError, RemoteUnavailableError
        The arm does not follow; it stays where it is, with what it holds.
    """
    driver.move_hand(plan.opening)
    driver.follow(join([plan.free, plan.approach]))
    driver.move_hand(0.0)
    openings, heights = {"close": driver.opening()}, [_tool_height(driver, plan, cell)]
    # A hand that closed fully has nothing to lift, and lifting would prove nothing.
    if openings["close"] <= CLOSED_ON_SOMETHING:
        held = Judgement("no", f"opening {openings['close']:.2f} after closing")
    else:
        driver.follow(plan.lift)
        openings["lift"] = driver.opening()
        wait(_HOLD_S)
        openings["hold"] = driver.opening()
        heights.append(_tool_height(driver, plan, cell))
        held = judge_held(openings, heights[-1] - heights[0])
        # It is put back where it stood before the hand opens.
        driver.follow(reverse(plan.lift))
    driver.move_hand(plan.opening)
    driver.follow(reverse(join([plan.free, plan.approach])))
    return held


def _tool_height(driver: ArmDriver, plan: PlannedGrasp, cell: Workcell) -> float:
    """Return the height of the tool at the measured joints, m, base frame."""
    chain = cell.executor.space_of(plan.stance).chains[plan.arm]
    return float(chain.tool_poses(driver.measured()[None])[1][0, 2])


def bring_home(
    driver: ArmDriver,
    cell: Workcell,
    arm: str,
    seed: int,
    obstacles: Sequence[Obstacle | PointField] = (),
) -> float:
    """Move an arm home along a path that is free of the table and the robot; return its seconds.

    Parameters
    ----------
    driver
        Of the arm.
    cell
        With the model of the robot.
    arm
        Name of the arm.
    seed
        Of the path.
    obstacles
        What else stands around, base frame.

    Raises
    ------
    RobotError
        There is no such path: the arm touches something where it is, or nearly.
    """
    executor = cell.executor
    space, home = executor.space_of(cell.robot.stance), cell.robot.home(arm)
    start = driver.measured()
    if np.abs(start - home).max() <= _AT_HOME_RAD:
        return 0.0
    around = space.surroundings(arm, cell.world.table_height, obstacles)
    way = space.path(arm, space.spheres(arm, 1.0), around, start, home, seed)
    if isinstance(way, str):
        raise RobotError(
            f"no free path leads home from where {arm} is; move it by hand", reason=way
        )
    driver.follow(way)
    return way.duration
