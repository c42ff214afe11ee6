"""A client of the driver of a real arm: control_msgs/FollowJointTrajectory with limits."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RemoteUnavailableError, RobotError
from rtask.interop.ros.convert import fill, make_message
from simulate.drivers.contract import (
    JointLimits,
    check_arrival,
    check_ending,
    check_motion_start,
    settled_joints,
)
from simulate.drivers.watch import MotionWatch
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory

__all__ = ["ArmDriver"]

_SPARE_S = 5.0
_STATE_S = 5.0
_NO_WAY_RAD = 1e-6


class ArmDriver:
    """An arm behind an action of trajectories.

    Parameters
    ----------
    action
        Name of the action, relative or absolute.
    joints
        In the order of the trajectories.
    wait_s
        Longest wait for the action server.
    limits
        Of the joints; states outside them start no motion.

    Raises
    ------
    RemoteUnavailableError
        No action server answers.
    """

    def __init__(
        self,
        action: str,
        joints: tuple[str, ...],
        wait_s: float,
        limits: JointLimits | None = None,
    ) -> None:
        import actionlib
        import rospy

        self._joints, self._limits = joints, limits
        # Simulated time is what the states' stamps count, where the node uses it.
        self._clock = lambda: float(rospy.Time.now().to_sec())
        self._newest: Any = None
        self._watch: MotionWatch | None = None
        self._came = threading.Condition()
        kind = type(make_message("sensor_msgs/JointState"))
        rospy.Subscriber("/joint_states", kind, self._take, queue_size=1)
        action_kind = type(make_message("control_msgs/FollowJointTrajectoryAction"))
        self._client = actionlib.SimpleActionClient(action, action_kind)
        self._name = rospy.resolve_name(action)
        if not self._client.wait_for_server(rospy.Duration.from_sec(wait_s)):
            raise RemoteUnavailableError(f"no action {self._name} answers within {wait_s:g} s")

    def _take(self, state: Any) -> None:
        # Other publishers of /joint_states may tell of other joints.
        if set(self._joints) & set(state.name):
            with self._came:
                self._newest = state
                if self._watch is not None:
                    self._watch.take(_as_mapping(state))
                self._came.notify_all()

    def _next_state(self, until: float) -> dict[str, Any] | None:
        """Return the next joint state as a mapping, or None after a time."""
        with self._came:
            self._newest = None
            wait_s = max(until - time.monotonic(), 0.0)
            if not self._came.wait_for(lambda: self._newest is not None, wait_s):
                return None
            return _as_mapping(self._newest)

    def measured(self) -> NDArray[np.float64]:
        """Return the joints (dof,), rad, of the arm at rest, from fresh states.

        Raises
        ------
        RobotError
            The states are old, without time, incomplete, not finite, outside the limits, or the
            arm moves.
        RemoteUnavailableError
            No joint state comes.
        """
        return settled_joints(
            self._next_state, self._joints, self._limits, _STATE_S, now=self._clock
        )

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory, and wait until it is there; cancelled on every error.

        Raises
        ------
        RobotError
            It starts away from the measured pose, the driver ended it otherwise than by success,
            or the measured joints are not at the goal, or did not move as planned.
        RemoteUnavailableError
            It did not end in its time and 5 s, or no joint state came for 3 s.
        """
        start = self.measured()
        check_motion_start(way, self._joints, start)
        if np.abs(way.positions - way.positions[0]).max() <= _NO_WAY_RAD:
            return
        watch = MotionWatch(way, self._joints)
        try:
            self._carry_out(way, watch)
            result = self._client.get_result()
            code = result.error_code if result is not None else 0
            words = (result.error_string if result is not None else "") or str(
                self._client.get_goal_status_text()
            )
            if code:
                raise RobotError(f"{self._name} ended with {code}: {words}")
            check_ending(1, self._client.get_state(), self._name, words)
            measured = self.measured()
            check_arrival(way, self._joints, measured, start)
            watch.check_followed(measured)
        except BaseException:
            self._client.cancel_goal()
            raise

    def _carry_out(self, way: Trajectory, watch: MotionWatch) -> None:
        """Send a goal, and wait until it ended; its joint states are watched."""
        ended = threading.Event()
        with self._came:
            self._watch = watch
        try:
            self._client.send_goal(self._goal(way), done_cb=lambda state, result: ended.set())
            until = time.monotonic() + way.duration + _SPARE_S
            while (now := time.monotonic()) < until:
                watch.check_alive()
                if ended.wait(max(min(until, watch.deadline) - now, 0.0)):
                    return
        finally:
            with self._came:
                self._watch = None
        raise RemoteUnavailableError(
            f"{self._name} did not end within {way.duration + _SPARE_S:.1f} s; cancelled"
        )

    def _goal(self, way: Trajectory) -> Any:
        goal = make_message("control_msgs/FollowJointTrajectoryGoal")
        return fill(goal, goal_message(way, self._joints), make_message)


def _as_mapping(state: Any) -> dict[str, Any]:
    """Return a sensor_msgs/JointState as a mapping."""
    stamp = {"secs": state.header.stamp.secs, "nsecs": state.header.stamp.nsecs}
    return {
        "header": {"stamp": stamp}, "name": list(state.name),
        "position": list(state.position), "velocity": list(state.velocity),
    }  # fmt: skip
