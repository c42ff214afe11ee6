"""An arm in ROS 2: its joints from a topic, its trajectories as an action of its own driver."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.convert import fill, make_message
from rtask.ros2.qos import sensor_data
from simulate.drivers.action_arm import ActionArm
from simulate.drivers.joint_states import JointLimits
from simulate.drivers.rosbridge_goals import GoalEnd
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory

__all__ = ["RclpyArm"]

_WAIT_S = 10.0
_CANCEL_S = 2.0
_REJECTED = "the driver rejected the goal: is its controller active?"

log = logging.getLogger(__name__)


class RclpyArm(ActionArm):
    """An arm whose driver takes FollowJointTrajectory goals, such as that of ros2_control.

    Parameters
    ----------
    node
        Of ROS 2; its callbacks run in another thread.
    action
        Name of the action, relative or absolute.
    joints
        In the order of the trajectories.
    topic
        On which a sensor_msgs/JointState tells the joints.
    limits
        Of the joints; states outside them start no motion.
    say
        Receives what people have to know before a motion; logged by default.
    wait_s
        Longest wait for the action server, s.

    Raises
    ------
    RemoteUnavailableError
        No action server answers.
    UsageError
        A package of messages is missing.
    """

    def __init__(
        self,
        node: Any,
        action: str,
        joints: tuple[str, ...],
        topic: str = "/joint_states",
        *,
        limits: JointLimits | None = None,
        say: Callable[[str], object] = log.warning,
        wait_s: float = _WAIT_S,
    ) -> None:
        try:
            from control_msgs.action import FollowJointTrajectory
            from rclpy.action import ActionClient
            from sensor_msgs.msg import JointState
        except ImportError as error:
            raise UsageError(f"{error}: apt-get install ros-$ROS_DISTRO-control-msgs") from error
        # Simulated time is what the states' stamps count, where the node uses it.
        clock = node.get_clock()
        super().__init__(action, joints, 2, limits, lambda: clock.now().nanoseconds / 1e9, say)
        self._goal_type = FollowJointTrajectory.Goal
        self._lock = threading.Lock()
        self._handle: Any = None
        self._is_cancelled = False
        # Broadcasters are reliable, others best effort: a best-effort reader hears both.
        node.create_subscription(
            JointState, topic, lambda state: self.take_state(state), sensor_data()
        )
        self._client = ActionClient(node, FollowJointTrajectory, action)
        if not self._client.wait_for_server(timeout_sec=wait_s):
            raise RemoteUnavailableError(
                f"no action {action} answers within {wait_s:g} s; see `ros2 action list`"
            )

    def send(self, way: Trajectory, ended: Callable[[GoalEnd], None]) -> None:
        """Send a goal; ``ended`` hears how it ended."""
        with self._lock:
            self._handle, self._is_cancelled = None, False
        goal = fill(self._goal_type(), goal_message(way, self._joints), make_message)
        sent = self._client.send_goal_async(goal)  # with an id of its own, a random one
        sent.add_done_callback(lambda future: self._answered(future, ended))

    def _answered(self, future: Any, ended: Callable[[GoalEnd], None]) -> None:
        """Take the driver's answer to a goal."""
        handle = future.result()
        if not handle.accepted:
            ended(GoalEnd("rejected", 0, _REJECTED))
            return
        with self._lock:
            self._handle = handle
            is_late = self._is_cancelled
        if is_late:  # given up before the driver had answered
            handle.cancel_goal_async()
        handle.get_result_async().add_done_callback(lambda done: ended(_end_of(done)))

    def cancel(self) -> None:
        """Cancel the goal, and wait for the answer for at most 2 s."""
        with self._lock:
            self._is_cancelled, handle = True, self._handle
        if handle is None:
            return
        answered = threading.Event()
        handle.cancel_goal_async().add_done_callback(lambda future: answered.set())
        answered.wait(_CANCEL_S)


def _end_of(future: Any) -> GoalEnd:
    answer = future.result()
    result = answer.result
    return GoalEnd(answer.status, int(result.error_code), str(result.error_string))
