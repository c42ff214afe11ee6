"""Trajectories for a simulated robot's arms as actions over rosbridge.

Each arm has the action ``<arm>_controller/follow_joint_trajectory`` (control_msgs/
FollowJointTrajectory), by which MoveIt moves a robot (Gatto 2016, 4.2).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rtask.errors import UsageError
from simulate.act.service import ActService
from simulate.motion.goal_course import (
    GOAL_TOLERANCE,
    INVALID_GOAL,
    INVALID_JOINTS,
    OLD_STAMP,
    GoalCourse,
    OldStampError,
)
from simulate.motion.joint_messages import InvalidJointsError
from simulate.robots.description import Floats

__all__ = ["ABORTED", "ACTION_TYPE", "ArmGoals"]

ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"
SUCCEEDED, CANCELLED, ABORTED = 4, 5, 6
"""Status of a goal in action_msgs/GoalStatus."""
_STEP_S = 0.01
_FEEDBACK_S = 0.1


class ArmGoals:
    """Carries out goals of trajectories, one at a time, in the thread of the physics.

    Parameters
    ----------
    service
        The act service of the robot; while it has the arm, goals are refused.
    """

    def __init__(self, service: ActService) -> None:
        self._service = service
        self._robot = service.cell.robot
        self.actions: Mapping[str, str] = {
            f"{arm}_controller/follow_joint_trajectory": arm for arm in self._robot.arms
        }
        """Arms by the relative names of their actions."""

    def joint_states(self) -> dict[str, Any]:
        """Return the measured joints as a sensor_msgs/JointState, rad."""
        values = self._robot.joint_values()
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        return {
            "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": ""},
            "name": list(values),
            "position": list(values.values()),
            "velocity": [],
            "effort": [],
        }

    def follow(
        self,
        action: str,
        goal: Mapping[str, Any],
        tell: Callable[[dict[str, Any]], None],
        is_cancelled: Callable[[], bool],
    ) -> tuple[int, dict[str, Any]]:
        """Follow a trajectory to its end, or until the goal is cancelled.

        Parameters
        ----------
        action
            Relative name of the action.
        goal
            A control_msgs/FollowJointTrajectoryGoal.
        tell
            Receives feedback every 0.1 s of the robot's time.
        is_cancelled
            Asked as often.

        Returns
        -------
        status
            4 = succeeded, 5 = cancelled, 6 = aborted.
        result
            A control_msgs/FollowJointTrajectoryResult.
        """
        try:
            code, words = self._follow(self.actions[action], goal, tell, is_cancelled)
        except InvalidJointsError as error:
            code, words = INVALID_JOINTS, str(error)
        except OldStampError as error:
            code, words = OLD_STAMP, str(error)
        except UsageError as error:
            code, words = INVALID_GOAL, str(error)
        status = CANCELLED if words == "cancelled" else ABORTED if code else SUCCEEDED
        return status, {"error_code": code, "error_string": words}

    def _follow(
        self,
        arm: str,
        goal: Mapping[str, Any],
        tell: Callable[[dict[str, Any]], None],
        is_cancelled: Callable[[], bool],
    ) -> tuple[int, str]:
        if self._service.has_the_arm:
            raise UsageError("the act service has the arm; call it with action_type home first")
        joints, robot = self._robot.arm(arm).joints, self._robot
        course = GoalCourse(goal, joints, robot.arm_joints(arm), time.time())
        elapsed = passed = due = 0.0
        while True:
            position, velocity = course.desired(elapsed)
            robot.command_arm(arm, position, velocity)
            robot.world.step(_STEP_S)
            passed += _STEP_S
            if not course.is_early(time.time()):
                elapsed += _STEP_S
            measured = robot.arm_joints(arm)
            if not np.isfinite(measured).all():
                return GOAL_TOLERANCE, "the simulation broke down: joints are not numbers"
            ending = course.ending(elapsed, measured)
            if ending is not None:
                if ending[0]:
                    robot.command_arm(arm, measured)
                return ending
            if passed >= due:
                due += _FEEDBACK_S
                tell(_feedback(joints, position, measured))
                if is_cancelled():
                    robot.command_arm(arm, measured)
                    return 0, "cancelled"


def _feedback(joints: tuple[str, ...], desired: Floats, now: Floats) -> dict[str, Any]:
    """Return a control_msgs/FollowJointTrajectoryFeedback."""

    def point(values: Floats) -> dict[str, Any]:
        return {"positions": np.asarray(values).tolist()}

    return {
        "joint_names": list(joints),
        "desired": point(desired),
        "actual": point(now),
        "error": point(desired - now),
    }
