"""Joint states during a motion: whether they keep coming, and whether the arm follows.

An arm whose states stop is driven blind, so that the motion has to end; one whose states stay where
they were has not moved, or its states are frozen. Either may look like success at the end, where
the goal is near the pose that stands still. One that leaves its way is moved by somebody else, even
if it is at the goal in the end.
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
_ASIDE_RAD = 0.15
"""Beyond every position of a way, no controller overshoots by so much."""
_TIMES_FASTER, _SPARE_RAD_S, _APART_S = 2.0, 0.5, 0.05
"""From when on an arm is faster than asked, and over which time that is measured."""


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
        self._low, self._high = way.positions.min(axis=0), way.positions.max(axis=0)
        self._last_stamp, self._taken, self._aside = 0.0, 0, 0
        self._source, self._complaint = OneSource(), ""
        self._paced: tuple[float, Floats] | None = None
        self._fastest = 0.0
        self._heard_s = clock()

    @property
    def deadline(self) -> float:
        """Moment of the clock by which the next state has to come, s."""
        return self._heard_s + _SILENT_S

    def take(self, message: Mapping[str, Any]) -> None:
        """Take a sensor_msgs/JointState; what is incomplete, not new or not finite is no sign."""
        stamp = stamp_of(message)
        if not stamp > 0:
            return
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
        # New against the one before, not against the newest: a single stamp from the far future
        # would make all that follow old.
        is_new, self._last_stamp = stamp > self._last_stamp, stamp
        if not is_new:
            return
        self._heard_s = self._clock()
        self._taken += 1
        self._farthest = np.maximum(self._farthest, np.abs(now - self._way.positions[0]))
        self._note_aside(now)
        self._note_pace(stamp, now)

    def _note_aside(self, now: Floats) -> None:
        """Complain of an arm that is off its way in several states, one after another."""
        off = np.maximum(self._low - now, now - self._high)
        worst = int(off.argmax())
        # A single one may be that of another publisher, which is another complaint.
        self._aside = self._aside + 1 if off[worst] > _ASIDE_RAD else 0
        if self._aside >= _FEWEST and not self._complaint:
            self._complaint = (
                f"{self._joints[worst]} is {off[worst]:.2f} rad off the way that was sent: another "
                "program or controller moves the arm, or its model is another one"
            )

    def _note_pace(self, stamp: float, now: Floats) -> None:
        if self._paced is None or stamp < self._paced[0]:
            self._paced = stamp, now
        seconds = stamp - self._paced[0]
        if seconds >= _APART_S:
            self._fastest = max(self._fastest, float(np.abs(now - self._paced[1]).max()) / seconds)
            self._paced = stamp, now

    def pace_doubt(self) -> str:
        """Return a sentence about an arm that was far faster than asked, or nothing.

        It is no failure, since simulated arms may run faster than the wall's time.
        """
        steps = np.abs(np.diff(self._way.positions, axis=0)).max(axis=1, initial=0.0)
        seconds = np.diff(self._way.times)
        asked = float((steps / np.maximum(seconds, 1e-6)).max(initial=0.0))
        if self._fastest <= _TIMES_FASTER * asked + _SPARE_RAD_S:
            return ""
        return (
            f"the arm went at {self._fastest:.1f} rad/s where {asked:.1f} were asked for: its "
            "controller keeps no velocities, or it is a simulation that runs ahead of time"
        )

    def check(self) -> None:
        """Check that states keep coming, and from this arm alone.

        Raises
        ------
        RobotError
            They are those of two arms, or off the way.
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
