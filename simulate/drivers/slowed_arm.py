"""A real arm whose motions keep the maker's limits of velocity, acceleration and jerk."""

from __future__ import annotations

from typing import cast

from rtask.errors import RobotError
from simulate.drivers.motions import ArmDriver, HandDriver
from simulate.motion.motion_limits import MotionLimits, slowed
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["SlowedArm"]


class SlowedArm:
    """Passes trajectories on to a driver, slowed down as its limits ask.

    Parameters
    ----------
    driver
        Of the arm.
    limits
        Of its joints.
    """

    def __init__(self, driver: ArmDriver, limits: MotionLimits) -> None:
        self._driver, self._limits = driver, limits

    def measured(self) -> Floats:
        """Return the measured joints (dof,), rad."""
        return self._driver.measured()

    def follow(self, way: Trajectory) -> None:
        """Follow a trajectory within the limits, and wait for its end."""
        self._driver.follow(slowed(way, self._limits))

    def move_hand(self, opening: float) -> None:
        """Drive the hand towards an opening, 0 (closed) to 1, and wait until it stops."""
        self._hand().move_hand(opening)

    def opening(self) -> float:
        """Return the measured opening of the hand, 0 to 1."""
        return self._hand().opening()

    def _hand(self) -> HandDriver:
        if not hasattr(self._driver, "move_hand"):
            raise RobotError("this driver moves no hand")
        return cast("HandDriver", self._driver)
