"""Log of an arm's joints and hand during an attempt: what was commanded and what was measured."""

from __future__ import annotations

import numpy as np

from rtask.interop.episodes.motion import Motion
from simulate.robots.description import Floats
from simulate.world.robot_body import RobotBody

__all__ = ["MotionLog"]

_PERIOD_S = 0.05


class MotionLog:
    """Samples an arm twenty times a second.

    Parameters
    ----------
    robot
        The body.
    arm
        Name of the arm.
    """

    def __init__(self, robot: RobotBody, arm: str) -> None:
        self._robot, self._arm = robot, arm
        self._started = self._due = robot.world.time
        self._times: list[float] = []
        self._measured: list[Floats] = []
        self._commanded: list[Floats] = []

    def sample(self) -> None:
        """Take a sample if one is due; nothing where the physics diverged."""
        robot, now = self._robot, self._robot.world.time
        if now < self._due:
            return
        joints = robot.arm_joints(self._arm)
        measured = np.append(joints, robot.finger_opening(self._arm))
        if not np.isfinite(measured).all():
            return
        self._due = now + _PERIOD_S
        opening = robot.commanded_opening[self._arm]
        self._times.append(now - self._started)
        self._measured.append(measured)
        self._commanded.append(np.append(robot.commanded.get(self._arm, joints), opening))

    @property
    def motion(self) -> Motion | None:
        """The motion so far; None without a sample."""
        if not self._times:
            return None
        hand = self._robot.arm(self._arm)
        return Motion(
            (*hand.joints, hand.end_effector),
            np.array(self._times),
            np.stack(self._measured),
            np.stack(self._commanded),
        )
