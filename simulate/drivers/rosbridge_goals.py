"""Goals of FollowJointTrajectory as rosbridge carries them: actions of ROS 2, topics of ROS 1.

The bridge of ROS 2 has operations for actions. That of ROS 1 knows none of them; an action there is
five topics of actionlib, which clients publish and subscribe themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from rtask.errors import RobotError
from simulate.drivers.contract import RosVersion, check_ending
from simulate.motion.goal_course import named

__all__ = ["GoalEnd", "Goals", "goals_of", "is_topic"]

Messages = list[dict[str, Any]]


@dataclass(frozen=True)
class GoalEnd:
    """How a goal ended.

    Parameters
    ----------
    status
        As the controller sent it; None where the bridge says that the call failed.
    code, words
        Of the controller's result.
    """

    status: object
    code: object
    words: str

    def check(self, ros: RosVersion, action: str) -> None:
        """Check that the controller says that the goal succeeded, by its code and by its status.

        Raises
        ------
        RobotError
            It says otherwise, or what is unknown.
        """
        # Code and status may disagree: whichever says failure is believed.
        if self.code:
            raise RobotError(f"{action} ended with {named(self.code)}: {self.words}")
        check_ending(ros, self.status, action, self.words)


class Goals(Protocol):
    """Messages about the goals of one action."""

    def opening(self) -> Messages:
        """Return what a connection sends before any goal."""

    def begin(self, goal: str, args: Mapping[str, Any]) -> Messages:
        """Return what sends a goal."""

    def cancel(self, goal: str) -> Messages:
        """Return what cancels this goal, and no other."""

    def end(self, goal: str, message: Mapping[str, Any]) -> GoalEnd | None:
        """Return how a goal ended, if a message says so."""


def goals_of(ros: RosVersion, action: str) -> Goals:
    """Return the messages for an action behind the bridge of a version of ROS."""
    return _Ros1Goals(action) if ros == 1 else _Ros2Goals(action)


def is_topic(message: Mapping[str, Any], topic: str) -> bool:
    """Tell whether a message is of a topic, whose name some bridges complete to a global one."""
    named = message.get("topic")
    return isinstance(named, str) and named.lstrip("/") == topic.lstrip("/")


@dataclass(frozen=True)
class _Ros2Goals:
    action: str

    def opening(self) -> Messages:
        return []

    def begin(self, goal: str, args: Mapping[str, Any]) -> Messages:
        kind = "control_msgs/action/FollowJointTrajectory"
        about = {"action": self.action, "id": goal, "action_type": kind}
        return [{"op": "send_action_goal", "args": args, "feedback": False, **about}]

    def cancel(self, goal: str) -> Messages:
        return [{"op": "cancel_action_goal", "action": self.action, "id": goal}]

    def end(self, goal: str, message: Mapping[str, Any]) -> GoalEnd | None:
        if message.get("op") != "action_result" or message.get("id") != goal:
            return None
        values = message.get("values")
        about = values if isinstance(values, dict) else {"error_string": str(values or "")}
        # "result" is true for every goal that ended, and false where the call itself failed.
        status = None if message.get("result") is False else message.get("status")
        return GoalEnd(status, about.get("error_code", 0), str(about.get("error_string", "")))


@dataclass(frozen=True)
class _Ros1Goals:
    action: str

    def opening(self) -> Messages:
        kinds = {
            "goal": "control_msgs/FollowJointTrajectoryActionGoal",
            "cancel": "actionlib_msgs/GoalID",
        }
        topics = [
            {"op": "advertise", "topic": f"{self.action}/{name}", "type": kind}
            for name, kind in kinds.items()
        ]
        result = "control_msgs/FollowJointTrajectoryActionResult"
        subscribe = {"op": "subscribe", "topic": f"{self.action}/result", "type": result}
        return [*topics, subscribe]

    def begin(self, goal: str, args: Mapping[str, Any]) -> Messages:
        message = {"goal_id": {"stamp": {"secs": 0, "nsecs": 0}, "id": goal}, "goal": args}
        return [{"op": "publish", "topic": f"{self.action}/goal", "msg": message}]

    def cancel(self, goal: str) -> Messages:
        # A stamp would cancel the goals of others as well, all those from before it.
        message = {"stamp": {"secs": 0, "nsecs": 0}, "id": goal}
        return [{"op": "publish", "topic": f"{self.action}/cancel", "msg": message}]

    def end(self, goal: str, message: Mapping[str, Any]) -> GoalEnd | None:
        if message.get("op") != "publish" or not is_topic(message, f"{self.action}/result"):
            return None
        about = message.get("msg")
        status = about.get("status") if isinstance(about, dict) else None
        if not isinstance(status, dict) or not isinstance(about, dict):
            return None
        named = status.get("goal_id")
        if not isinstance(named, dict) or named.get("id") != goal:
            return None
        result = about.get("result")
        result = result if isinstance(result, dict) else {}
        words = str(result.get("error_string") or status.get("text") or "")
        return GoalEnd(status.get("status"), result.get("error_code", 0), words)
