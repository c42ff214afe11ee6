"""A real arm whose motions keep the maker's limits of velocity, acceleration and jerk.

They are sent in pieces that end at rest, unless the whole motion is asked for at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from rtask.errors import RobotError
from simulate.drivers.motions import HandDriver
from simulate.motion.horizon import pieces_of
from simulate.motion.motion_limits import MotionLimits, slowed
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

if TYPE_CHECKING:
    from simulate.drivers.following import FollowingArm

__all__ = ["HORIZON_S", "SlowedArm"]

HORIZON_S = 0.5
"""Longest piece, s. At cautious limits such pieces together take as long as the whole motion would,
whose limits its sharpest bend sets; each is measured at its end besides."""


class SlowedArm:
    """Passes trajectories on to a driver, slowed down as its limits ask.

    Parameters
    ----------
    driver
        Of the arm.
    limits
        Of its joints.
    horizon_s
        Longest piece that the robot gets at once, s; 0 = the whole motion.
    """

    def __init__(
        self, driver: FollowingArm, limits: MotionLimits, horizon_s: float = HORIZON_S
    ) -> None:
        self._driver, self._limits, self._horizon_s = driver, limits, horizon_s

    def measured(self) -> Floats:
        """Return the measured joints (dof,), rad."""
        return self._driver.measured()

    def pieces(self, way: Trajectory) -> list[Trajectory]:
        """Return a trajectory within the limits, as it is sent: in pieces that end at rest."""
        if self._horizon_s > 0:
            return pieces_of(way, self._limits, self._horizon_s)
        return [slowed(way, self._limits)]

    def follow(self, way: Trajectory) -> None:
        """Follow a trajectory within the limits, and wait for its end."""
        self._driver.follow_pieces(self.pieces(way))

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
