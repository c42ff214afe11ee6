"""A client of the driver of a real arm: control_msgs/FollowJointTrajectory with limits."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RemoteUnavailableError, RobotError
from rtask.interop.ros.convert import fill
from rtask.interop.ros.package import make_message
from simulate.motion.joint_messages import check_start, goal_message
from simulate.motion.trajectory import Trajectory

__all__ = ["ArmDriver"]

_SPARE_S = 5.0
_STATE_S = 5.0
_SUCCEEDED = 3


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

    Raises
    ------
    RemoteUnavailableError
        No action server answers.
    """

    def __init__(self, action: str, joints: tuple[str, ...], wait_s: float) -> None:
        import actionlib
        import rospy

        self._joints = joints
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
        if set(self._joints) <= set(state.name):
            with self._came:
                self._newest = state
                self._came.notify_all()

    def measured(self) -> NDArray[np.float64]:
        """Return the measured joints (dof,), rad.

        Raises
        ------
        RemoteUnavailableError
            Nobody tells them.
        """
        with self._came:
            if not self._came.wait_for(lambda: self._newest is not None, _STATE_S):
                raise RemoteUnavailableError(
                    f"/joint_states tells no {', '.join(self._joints)} within {_STATE_S:g} s"
                )
            positions = dict(zip(self._newest.name, self._newest.position, strict=True))
        return np.array([positions[name] for name in self._joints])

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory, and wait for its end; cancelled on every other exit.

        Raises
        ------
        RobotError
            It starts away from the measured pose, or the driver ended it with an error.
        RemoteUnavailableError
            It did not end in its time and 5 s.
        """
        check_start(way, self._joints, self.measured())
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
        if self._client.get_state() != _SUCCEEDED or result.error_code:
            words = result.error_string or self._client.get_goal_status_text()
            raise RobotError(f"{self._name} ended with {result.error_code}: {words}")

    def _goal(self, way: Trajectory) -> Any:
        goal = make_message("control_msgs/FollowJointTrajectoryGoal")
        return fill(goal, goal_message(way, self._joints), make_message)
