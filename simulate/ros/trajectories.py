"""Action servers for the arms of a simulated robot: control_msgs/FollowJointTrajectory.

The action thread only posts a goal; the physics, in its own thread, follows it.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import mapping_of
from simulate.motion.goal_course import (
    INVALID_GOAL,
    INVALID_JOINTS,
    OLD_STAMP,
    GoalCourse,
    OldStampError,
)
from simulate.motion.joint_messages import InvalidJointsError
from simulate.ros.front import Ending, Front, TrajectoryGoal
from simulate.world.robot_body import RobotBody

__all__ = ["ArmAction"]

_STEP_S = 0.01
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
    now
        Clock that stamps trajectories, s.
    """

    def __init__(
        self,
        front: Front,
        robot: RobotBody,
        arm: str,
        post: Callable[[Callable[[], None]], None],
        is_free: Callable[[], bool],
        now: Callable[[], float],
    ) -> None:
        self._front, self._now = front, now
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
        except OldStampError as error:
            code, words = OLD_STAMP, str(error)
        except UsageError as error:
            code, words = INVALID_GOAL, str(error)
        finally:
            goal.outcome.put(Ending(code, words))

    def _follow(self, goal: Goal) -> tuple[int, str]:
        if not self._is_free():
            raise UsageError("the act service has the arm; call it with action_type home first")
        asked = mapping_of(goal.asked.message)
        measured = self._robot.arm_joints(self._arm)
        course = GoalCourse(asked, self._joints, measured, self._now())
        elapsed = passed = due = 0.0
        while not goal.asked.is_cancelled():
            position, velocity = course.desired(elapsed)
            self._robot.command_arm(self._arm, position, velocity)
            self._robot.world.step(_STEP_S)
            passed += _STEP_S
            if not course.is_early(self._now()):
                elapsed += _STEP_S
            measured = self._robot.arm_joints(self._arm)
            ending = course.ending(elapsed, measured)
            if ending is not None:
                if ending[0]:  # it stays where it is instead of going on to a goal it cannot reach
                    self._robot.command_arm(self._arm, measured)
                return ending
            if passed >= due:
                due += _FEEDBACK_S
                goal.outcome.put(self._feedback(position))
        self._robot.command_arm(self._arm, measured)
        return 0, "cancelled"

    def _feedback(self, desired: NDArray[np.float64]) -> Any:
        feedback = self._front.feedback()
        now = self._robot.arm_joints(self._arm)
        feedback.header.stamp, feedback.joint_names = self._front.stamp(None), list(self._joints)
        feedback.desired.positions, feedback.actual.positions = desired.tolist(), now.tolist()
        feedback.error.positions = (desired - now).tolist()
        return feedback
