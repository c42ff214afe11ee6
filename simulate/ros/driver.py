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
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory

__all__ = ["ArmDriver"]

_SPARE_S = 5.0
_STATE_S = 5.0


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
                self._came.notify_all()

    def _next_state(self, until: float) -> dict[str, Any] | None:
        """Return the next joint state as a mapping, or None after a time."""
        with self._came:
            self._newest = None
            wait_s = max(until - time.monotonic(), 0.0)
            if not self._came.wait_for(lambda: self._newest is not None, wait_s):
                return None
            state = self._newest
        stamp = {"secs": state.header.stamp.secs, "nsecs": state.header.stamp.nsecs}
        return {
            "header": {"stamp": stamp}, "name": list(state.name),
            "position": list(state.position), "velocity": list(state.velocity),
        }  # fmt: skip

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
            or the measured joints are not at the goal.
        RemoteUnavailableError
            It did not end in its time and 5 s.
        """
        check_motion_start(way, self._joints, self.measured())
        ended = threading.Event()
        try:
            self._client.send_goal(self._goal(way), done_cb=lambda state, result: ended.set())
            if not ended.wait(way.duration + _SPARE_S):
                raise RemoteUnavailableError(
                    f"{self._name} did not end within {way.duration + _SPARE_S:.1f} s; cancelled"
                )
        finally:
            if not ended.is_set():
                self._client.cancel_goal()
        result = self._client.get_result()
        code = result.error_code if result is not None else 0
        words = (result.error_string if result is not None else "") or str(
            self._client.get_goal_status_text()
        )
        if code:
            raise RobotError(f"{self._name} ended with {code}: {words}")
        check_ending(1, self._client.get_state(), self._name, words)
        check_arrival(way.positions[-1], self._joints, self.measured())

    def _goal(self, way: Trajectory) -> Any:
        goal = make_message("control_msgs/FollowJointTrajectoryGoal")
        return fill(goal, goal_message(way, self._joints), make_message)
