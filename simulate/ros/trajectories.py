"""Action servers for the arms of a simulated robot: control_msgs/FollowJointTrajectory.

The action thread only posts a goal; the physics, in its own thread, follows it.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import mapping_of
from simulate.motion.joint_messages import (
    GOAL_TOLERANCE,
    INVALID_GOAL,
    INVALID_JOINTS,
    InvalidJointsError,
    off_goal,
    read_trajectory,
)
from simulate.motion.trajectory import Trajectory
from simulate.ros.front import Ending, Front, TrajectoryGoal
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
        An Ending at the end; feedback before it.
    """

    asked: TrajectoryGoal
    outcome: queue.Queue[Any] = field(default_factory=queue.Queue)


class ArmAction:
    """Action server ``<arm>_controller/follow_joint_trajectory``.

    Parameters
    ----------
    front
        ROS.
    post
        Hands work to the thread of the physics.
    is_free
        Tells whether the arm may be moved now.
    """

    def __init__(
        self,
        front: Front,
        robot: RobotBody,
        arm: str,
        post: Callable[[Callable[[], None]], None],
        is_free: Callable[[], bool],
    ) -> None:
        self._front = front
        self._robot, self._arm, self._post, self._is_free = robot, arm, post, is_free
        self._joints = robot.arm(arm).joints
        self.name = f"{arm}_controller/follow_joint_trajectory"
        front.offer_trajectories(self.name, self._execute)

    def _execute(self, asked: TrajectoryGoal) -> Ending:
        """Wait for the end of one goal, in the action's thread."""
        goal = Goal(asked)
        self._post(lambda: self._run(goal))
        while not isinstance(news := goal.outcome.get(), Ending):
            asked.feedback(news)
        return news

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
            goal.outcome.put(Ending(code, words))

    def _follow(self, goal: Goal) -> tuple[int, str]:
        if not self._is_free():
            raise UsageError("the act service has the arm; call it with action_type home first")
        asked = mapping_of(goal.asked.message)
        now = self._robot.arm_joints(self._arm)
        way = read_trajectory(asked["trajectory"], self._joints, now)
        for state in self._states(way, goal):
            goal.outcome.put(state)
        now = self._robot.arm_joints(self._arm)
        if goal.asked.is_cancelled():
            self._robot.command_arm(self._arm, now)
            return 0, "cancelled"
        words = off_goal(asked, self._joints, way.positions[-1], now)
        return (GOAL_TOLERANCE, words) if words else (0, "")

    def _states(self, way: Trajectory, goal: Goal) -> Iterator[Any]:
        """Move along a trajectory until its end or a cancel, and yield the feedback that is due."""
        time, due = 0.0, 0.0
        while time < way.duration + _SETTLE_S and not goal.asked.is_cancelled():
            position, velocity = way.at(time)
            self._robot.command_arm(self._arm, position, velocity)
            self._robot.world.step(_STEP_S)
            time += _STEP_S
            if time >= due:
                due += _FEEDBACK_S
                yield self._feedback(position)

    def _feedback(self, desired: NDArray[np.float64]) -> Any:
        feedback = self._front.feedback()
        now = self._robot.arm_joints(self._arm)
        feedback.header.stamp, feedback.joint_names = self._front.stamp(None), list(self._joints)
        feedback.desired.positions, feedback.actual.positions = desired.tolist(), now.tolist()
        feedback.error.positions = (desired - now).tolist()
        return feedback
