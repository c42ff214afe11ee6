"""What a simulated body takes of ROS, the same for ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from rtask.interop.ros.convert import JsonObject

__all__ = ["Ending", "Front", "Publisher", "TrajectoryGoal"]


class Publisher(Protocol):
    """Publishes the messages of one topic."""

    def publish(self, message: Any) -> None:
        """Publish a message."""

    def is_heard(self) -> bool:
        """Whether anybody subscribes."""


@dataclass(frozen=True)
class TrajectoryGoal:
    """A goal of ``control_msgs/FollowJointTrajectory``.

    Parameters
    ----------
    message
    is_cancelled
        Tells whether its client gave it up, or a newer goal came; may be called from any thread.
    feedback
        Sends a message of feedback.
    """

    message: Any
    is_cancelled: Callable[[], bool]
    feedback: Callable[[Any], None]


@dataclass(frozen=True)
class Ending:
    """How a goal ended.

    Parameters
    ----------
    code, words
        Of the result; 0 = it was carried out, or given up.
    """

    code: int
    words: str


class Front(Protocol):
    """Topics, services, actions and the time of one version of ROS."""

    def publisher(self, topic: str, type_: str, *, is_latched: bool = False) -> Publisher:
        """Return a publisher of messages such as ``sensor_msgs/Image``."""

    def describe(self, urdf: str) -> None:
        """Tell the model of the robot, as ``robot_description``."""

    def stamp(self, seconds: float | None) -> Any:
        """Return a time as messages carry it, s; None = now, by the clock of the wall."""

    def feedback(self) -> Any:
        """Return an empty message of feedback about a trajectory."""

    def offer_trajectories(self, name: str, carry_out: Callable[[TrajectoryGoal], Ending]) -> None:
        """Offer an action ``control_msgs/FollowJointTrajectory``; each goal in its own thread."""

    def offer_act(self, name: str, act: Callable[[JsonObject], JsonObject]) -> None:
        """Offer a service ``rtask_msgs/Act``; an RtaskError is told to the caller."""
