"""Action servers for the arms of a simulated robot: control_msgs/FollowJointTrajectory.

The action thread only posts a goal; the physics, in its own thread, follows it.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import make_message, mapping_of
from simulate.motion.joint_messages import (
    GOAL_TOLERANCE,
    INVALID_GOAL,
    INVALID_JOINTS,
    InvalidJointsError,
    off_goal,
    read_trajectory,
)
from simulate.motion.trajectory import Trajectory
from simulate.world.robot_body import RobotBody

__all__ = ["ArmAction"]

_STEP_S = 0.01
_SETTLE_S = 0.3
_FEEDBACK_S = 0.1


@dataclass
class Goal:
    """A goal on its way from the action thread to the physics.

    Parameters
    ----------
    outcome
        Code and words at the end; a joint state before it.
    """

    message: Any
    cancelled: threading.Event = field(default_factory=threading.Event)
    outcome: queue.Queue[Any] = field(default_factory=queue.Queue)


class ArmAction:
    """Action server ``<arm>_controller/follow_joint_trajectory``.

    Parameters
    ----------
    post
        Hands work to the thread of the physics.
    is_free
        Tells whether the arm may be moved now.
    """

    def __init__(
        self,
        robot: RobotBody,
        arm: str,
        post: Callable[[Callable[[], None]], None],
        is_free: Callable[[], bool],
    ) -> None:
        import actionlib

        self._robot, self._arm, self._post, self._is_free = robot, arm, post, is_free
        self._joints = robot.arm(arm).joints
        self._goal: Goal | None = None
        kind = type(make_message("control_msgs/FollowJointTrajectoryAction"))
        self.name = f"{arm}_controller/follow_joint_trajectory"
        self._server = actionlib.SimpleActionServer(self.name, kind, self._execute, False)
        self._server.register_preempt_callback(self._cancel)
        self._server.start()

    def _cancel(self) -> None:
        goal = self._goal
        if goal is not None:
            goal.cancelled.set()

    def _execute(self, message: Any) -> None:
        """Wait for the end of one goal, in the action's thread."""
        goal = self._goal = Goal(message)
        if self._server.is_preempt_requested():
            goal.cancelled.set()
        self._post(lambda: self._run(goal))
        while True:
            news = goal.outcome.get()
            if isinstance(news, tuple):
                break
            self._server.publish_feedback(news)
        result = make_message("control_msgs/FollowJointTrajectoryResult")
        result.error_code, result.error_string = news
        if goal.cancelled.is_set():
            self._server.set_preempted(result, "cancelled")
        elif result.error_code:
            self._server.set_aborted(result, result.error_string)
        else:
            self._server.set_succeeded(result)

    def _run(self, goal: Goal) -> None:
        """Follow a goal, in the thread of the physics."""
        code, words = INVALID_GOAL, "the simulation ended"
        try:
            code, words = self._follow(goal)
        except InvalidJointsError as error:
            code, words = INVALID_JOINTS, str(error)
        except UsageError as error:
            code, words = INVALID_GOAL, str(error)
        finally:
            goal.outcome.put((code, words))

    def _follow(self, goal: Goal) -> tuple[int, str]:
        if not self._is_free():
            raise UsageError("the act service has the arm; call it with action_type home first")
        asked = mapping_of(goal.message)
        now = self._robot.arm_joints(self._arm)
        way = read_trajectory(asked["trajectory"], self._joints, now)
        for state in self._states(way, goal):
            goal.outcome.put(state)
        now = self._robot.arm_joints(self._arm)
        if goal.cancelled.is_set():
            self._robot.command_arm(self._arm, now)
            return 0, "cancelled"
        words = off_goal(asked, self._joints, way.positions[-1], now)
        return (GOAL_TOLERANCE, words) if words else (0, "")

    def _states(self, way: Trajectory, goal: Goal) -> Iterator[Any]:
        """Move along a trajectory until its end or a cancel, and yield the feedback that is due."""
        time, due = 0.0, 0.0
        while time < way.duration + _SETTLE_S and not goal.cancelled.is_set():
            position, velocity = way.at(time)
            self._robot.command_arm(self._arm, position, velocity)
            self._robot.world.step(_STEP_S)
            time += _STEP_S
            if time >= due:
                due += _FEEDBACK_S
                yield self._feedback(position)

    def _feedback(self, desired: NDArray[np.float64]) -> Any:
        import rospy

        feedback = make_message("control_msgs/FollowJointTrajectoryFeedback")
        now = self._robot.arm_joints(self._arm)
        feedback.header.stamp, feedback.joint_names = rospy.Time.now(), list(self._joints)
        feedback.desired.positions, feedback.actual.positions = desired.tolist(), now.tolist()
        feedback.error.positions = (desired - now).tolist()
        return feedback
