"""A client of the driver of a real arm in ROS 1, by actionlib."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.convert import fill, make_message
from simulate.drivers.action_arm import ActionArm
from simulate.drivers.joint_states import JointLimits
from simulate.drivers.rosbridge_goals import GoalEnd
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory

__all__ = ["ArmDriver"]

log = logging.getLogger(__name__)


class ArmDriver(ActionArm):
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
    say
        Receives what people have to know before a motion; logged by default.

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
        say: Callable[[str], object] = log.warning,
    ) -> None:
        import actionlib
        import rospy

        name = rospy.resolve_name(action)
        # Simulated time is what the states' stamps count, where the node uses it.
        super().__init__(name, joints, 1, limits, lambda: float(rospy.Time.now().to_sec()), say)
        kind = type(make_message("sensor_msgs/JointState"))
        rospy.Subscriber("/joint_states", kind, lambda state: self.take_state(state), queue_size=1)
        action_kind = type(make_message("control_msgs/FollowJointTrajectoryAction"))
        # A SimpleActionClient knows its goal only after it was sent, and loses the end of one that
        # ends before.
        self._client = actionlib.ActionClient(action, action_kind)
        self._goal: Any = None
        if not self._client.wait_for_server(rospy.Duration.from_sec(wait_s)):
            raise RemoteUnavailableError(f"no action {name} answers within {wait_s:g} s")

    def send(self, way: Trajectory, ended: Callable[[GoalEnd], None]) -> None:
        """Send a goal; ``ended`` hears how it ended."""
        from actionlib import CommState

        def changed(goal: Any) -> None:
            if goal.get_comm_state() == CommState.DONE:
                ended(_end(goal))

        message = make_message("control_msgs/FollowJointTrajectoryGoal")
        fill(message, goal_message(way, self._joints), make_message)
        self._goal = self._client.send_goal(message, changed)

    def cancel(self) -> None:
        """Cancel the goal."""
        if self._goal is not None:
            self._goal.cancel()


def _end(goal: Any) -> GoalEnd:
    """Return how a goal ended, given its handle."""
    result = goal.get_result()
    words = result.error_string if result is not None else ""
    return GoalEnd(
        goal.get_goal_status(),
        result.error_code if result is not None else 0,
        words or str(goal.get_goal_status_text()),
    )
