"""An arm behind an action of trajectories, whichever ROS carries it.

The contract of every driver is kept here once; a subclass sends goals and hears how they ended.
"""

from __future__ import annotations

import logging
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RemoteUnavailableError, RobotError
from rtask.interop.ros.convert import stamp_json
from simulate.drivers.contract import RosVersion
from simulate.drivers.following import FollowingArm
from simulate.drivers.joint_states import JointLimits, settled_joints
from simulate.drivers.rosbridge_goals import GoalEnd
from simulate.drivers.watch import MotionWatch
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["ActionArm"]

_SPARE_S = 5.0
_STATE_S = 5.0
_STOPPED_S = 2.0

log = logging.getLogger(__name__)


class ActionArm(FollowingArm):
    """Moves an arm by goals of ``control_msgs/FollowJointTrajectory``.

    Parameters
    ----------
    action
        Full name of the action, for errors.
    joints
        In the order of the trajectories.
    ros
        Version of ROS whose numbers say how a goal ended.
    limits
        Of the joints; states outside them start no motion.
    now
        Clock of the stamps of joint states, s.
    say
        Receives what people have to know; logged by default.
    """

    def __init__(
        self,
        action: str,
        joints: tuple[str, ...],
        ros: RosVersion,
        limits: JointLimits | None,
        now: Callable[[], float],
        say: Callable[[str], object] = log.warning,
    ) -> None:
        super().__init__(joints, "this program or the network", "the emergency stop at hand", say)
        self._name, self._ros, self._limits, self._now = action, ros, limits, now
        self._newest: Mapping[str, Any] | None = None
        self._watch: MotionWatch | None = None
        self._came = threading.Condition()

    @abstractmethod
    def send(self, way: Trajectory, ended: Callable[[GoalEnd], None]) -> None:
        """Send a goal; ``ended`` is to be called once, with how it ended."""

    @abstractmethod
    def cancel(self) -> None:
        """Cancel the goal that was sent last, and no other."""

    def take_state(self, message: Any) -> None:
        """Take a sensor_msgs/JointState; one that tells of other joints only is passed over."""
        # Grippers and bases publish states of their own on the same topic.
        if set(self._joints) & set(message.name):
            state = {
                "header": {"stamp": stamp_json(message.header.stamp)}, "name": list(message.name),
                "position": list(message.position), "velocity": list(message.velocity),
            }  # fmt: skip
            with self._came:
                self._newest = state
                if self._watch is not None:
                    self._watch.take(state)
                self._came.notify_all()

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

    def carry_out(self, way: Trajectory) -> Callable[[Floats], None]:
        """Send a goal, and wait until the driver says that it succeeded."""
        watch = MotionWatch(way, self._joints)
        end = self._carried_out(way, watch)
        end.check(self._ros, self._name)
        if doubt := watch.pace_doubt():
            self._say(doubt)
        return watch.check_followed

    def _carried_out(self, way: Trajectory, watch: MotionWatch) -> GoalEnd:
        """Send a goal, and return how it ended; its joint states are watched."""
        ended = threading.Event()
        ends: list[GoalEnd] = []

        def end(how: GoalEnd) -> None:
            ends.append(how)
            ended.set()

        # Under the lock, or a state could come before it is watched.
        with self._came:
            self._watch = watch
        try:
            self.send(way, end)
            until = time.monotonic() + way.duration + _SPARE_S
            while (now := time.monotonic()) < until:
                # A driver that died sends no end; its joint states end, too.
                watch.check()
                if ended.wait(max(min(until, watch.deadline) - now, 0.0)):
                    return ends[0]
        finally:
            with self._came:
                self._watch = None
        raise RemoteUnavailableError(
            f"{self._name} did not end within {way.duration + _SPARE_S:.1f} s; a cancel was sent"
        )

    def stop(self) -> None:
        """Cancel the goal, and say so where the arm is not seen to rest afterwards."""
        try:
            # Cancelled is not stopped: only states at rest show that.
            self.cancel()
            self._settled(None, _STOPPED_S)
        except (RemoteUnavailableError, RobotError):
            self._say(
                f"nobody can tell whether the arm of {self._name} has stopped: "
                "use the emergency stop"
            )

    def _settled(self, limits: JointLimits | None, wait_s: float) -> Floats:
        return settled_joints(self._next_state, self._joints, limits, wait_s, now=self._now)

    def _next_state(self, until: float) -> Mapping[str, Any] | None:
        """Return the next joint state, or None after a time."""
        with self._came:
            # Only what comes from now on is fresh.
            self._newest = None
            wait_s = max(until - time.monotonic(), 0.0)
            if not self._came.wait_for(lambda: self._newest is not None, wait_s):
                return None
            return self._newest
