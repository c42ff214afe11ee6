"""Joint states during a motion: whether they keep coming, and whether the arm follows.

An arm whose states stop is driven blind, so that the motion has to end; one whose states stay where
they were has not moved, or its states are frozen. Either may look like success at the end, where
the goal is near the pose that stands still.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.joint_states import OneSource, number_in, stamp_of
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["MotionWatch"]

_SILENT_S = 3.0
_EXCURSION_RAD = 0.1
_FEWEST = 3


class MotionWatch:
    """Follows the joint states of one motion.

    Parameters
    ----------
    way
        That the arm is to follow.
    joints
        Of the arm, in the order of the trajectory.
    clock
        Monotonic, s.
    """

    def __init__(
        self, way: Trajectory, joints: Sequence[str], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._way, self._joints, self._clock = way, joints, clock
        self._farthest = np.zeros(len(joints))
        self._newest_stamp, self._taken = 0.0, 0
        self._source, self._complaint = OneSource(), ""
        self._heard_s = clock()

    @property
    def deadline(self) -> float:
        """Moment of the clock by which the next state has to come, s."""
        return self._heard_s + _SILENT_S

    def take(self, message: Mapping[str, Any]) -> None:
        """Take a sensor_msgs/JointState; what is incomplete, not new or not finite is no sign."""
        stamp = stamp_of(message)
        try:
            values = dict(zip(message["name"], message["position"], strict=False))
            now = np.array([number_in(values[name]) for name in self._joints])
        except (KeyError, TypeError):
            return
        if not np.isfinite(now).all():
            return
        try:
            self._source.take(stamp, now)
        except RobotError as error:
            self._complaint = str(error)
        if not stamp > self._newest_stamp:
            return
        self._newest_stamp, self._heard_s = stamp, self._clock()
        self._taken += 1
        self._farthest = np.maximum(self._farthest, np.abs(now - self._way.positions[0]))

    def check(self) -> None:
        """Check that states keep coming, and from this arm alone.

        Raises
        ------
        RobotError
            They are those of two arms.
        RemoteUnavailableError
            None came for 3 s.
        """
        if self._complaint:
            raise RobotError(self._complaint)
        if self._clock() >= self.deadline:
            raise RemoteUnavailableError(
                f"no new joint state came for {_SILENT_S:g} s during the motion: the link, or the "
                "driver that publishes them, is lost; the motion is given up"
            )

    def check_followed(self, measured: Floats) -> None:
        """Check that the arm went about as far from its start as planned, whatever its end.

        A trajectory may end where it starts: the end alone proves nothing then.

        Parameters
        ----------
        measured : (dof,) float, rad
            After the motion.

        Raises
        ------
        RobotError
            The states hardly changed, or are those of two arms.
        """
        if self._complaint:
            raise RobotError(self._complaint)
        planned = np.abs(self._way.positions - self._way.positions[0]).max(axis=0)
        widest = int(planned.argmax())
        if planned[widest] < _EXCURSION_RAD or self._taken < _FEWEST:
            return
        went = max(self._farthest[widest], abs(measured - self._way.positions[0])[widest])
        if went < planned[widest] / 2:
            raise RobotError(
                f"{self._joints[widest]} was to go {planned[widest]:.2f} rad away from the start, "
                f"and its states went {went:.2f} rad: the arm did not move, or "
                "its joint states are frozen"
            )
