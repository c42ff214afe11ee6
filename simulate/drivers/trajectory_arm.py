"""An arm that takes whole trajectories as goals of an action: what each motion checks.

The contract of such drivers is kept here once; a subclass hears joint states, sends goals, and
stops the arm.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from rtask.errors import RobotError
from simulate.drivers.contract import (
    JointLimits,
    RosVersion,
    check_arrival,
    check_ending,
    check_motion_start,
)
from simulate.drivers.rosbridge_goals import GoalEnd
from simulate.drivers.watch import MotionWatch
from simulate.motion.goal_course import named
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["SPARE_S", "STOPPED_S", "TrajectoryArm"]

SPARE_S = 5.0
"""How much longer than planned a motion may take: controllers wait for the arm to settle."""
STOPPED_S = 2.0
"""How long joint states are waited for after a goal was cancelled."""
_STATE_S = 5.0
_NO_WAY_RAD = 1e-6


class TrajectoryArm(ABC):
    """Measures an arm, and moves it by goals of ``control_msgs/FollowJointTrajectory``.

    Parameters
    ----------
    action
        Name of the action, for errors.
    joints
        In the order of the trajectories.
    ros
        Version of ROS whose numbers say how a goal ended.
    limits
        Of the joints; states outside them start no motion.
    say
        Receives what people have to know.
    """

    def __init__(
        self,
        action: str,
        joints: tuple[str, ...],
        ros: RosVersion,
        limits: JointLimits | None,
        say: Callable[[str], object],
    ) -> None:
        self._action, self._joints, self._ros = action, joints, ros
        self._limits, self._say = limits, say

    def measured(self) -> Floats:
        """Return the joints (dof,), rad, of the arm at rest, from fresh states.

        Raises
        ------
        RobotError
            The states are old, without time, incomplete, not finite, outside the limits, or the
            arm moves.
        RemoteUnavailableError
            No joint state comes.
        """
        return self._settled(self._limits, _STATE_S)

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory, and wait until it is there; stopped on every error.

        The driver does not watch this program: an arm goes on to the end of the motion when
        nobody is left to cancel it. That is said before the motion. A trajectory that leads nowhere
        is not sent. Where an arm is not seen to rest after it was stopped, that is said.

        Raises
        ------
        RobotError
            It starts away from the measured pose, the driver refused it or ended it otherwise than
            by success, the measured joints are not at the goal, or did not move as planned.
        RemoteUnavailableError
            It did not end in its time and 5 s, the link was lost, or no joint state came for 3 s.
        """
        start = self.measured()
        check_motion_start(way, self._joints, start)
        if np.abs(way.positions - way.positions[0]).max() <= _NO_WAY_RAD:
            return
        self._say(
            f"if {self._what_may_be_lost()} is lost, the arm may go on for up to "
            f"{way.duration:.1f} s: keep the emergency stop at hand"
        )
        watch = MotionWatch(way, self._joints)
        try:
            end = self._carried_out(way, watch)
            if end.code:
                raise RobotError(f"{self._action} ended with {named(end.code)}: {end.words}")
            check_ending(self._ros, end.status, self._action, end.words)
            measured = self.measured()
            check_arrival(way, self._joints, measured, start)
            watch.check_followed(measured)
        except BaseException:  # Ctrl-C as well: whoever gives up has to stop the arm
            self._stop()
            raise

    @abstractmethod
    def _what_may_be_lost(self) -> str:
        """Return what stands between this program and the arm, for people."""

    @abstractmethod
    def _settled(self, limits: JointLimits | None, wait_s: float) -> Floats:
        """Return the joints (dof,), rad, of the arm at rest, as :meth:`measured` does."""

    @abstractmethod
    def _carried_out(self, way: Trajectory, watch: MotionWatch) -> GoalEnd:
        """Send a goal, and return how it ended; its joint states are handed to the watch."""

    @abstractmethod
    def _stop(self) -> None:
        """Cancel the goal that was sent last, and say so where the arm is not seen to rest."""

    def _say_unseen(self) -> None:
        self._say(
            f"nobody can tell whether the arm of {self._action} has stopped: use the emergency stop"
        )
