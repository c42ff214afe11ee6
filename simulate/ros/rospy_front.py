"""A simulated body in ROS 1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.convert import JsonObject, make_message, mapping_of
from rtask.interop.ros.operations import refusal
from rtask.interop.ros.services import service_type
from simulate.ros.front import Ending, Publisher, TrajectoryGoal

__all__ = ["RospyFront"]


class _Topic:
    def __init__(self, topic: str, type_: str, is_latched: bool) -> None:
        import rospy

        kind = type(make_message(type_))
        self._publisher = rospy.Publisher(topic, kind, queue_size=10, latch=is_latched)

    def publish(self, message: Any) -> None:
        self._publisher.publish(message)

    def is_heard(self) -> bool:
        return bool(self._publisher.get_num_connections())


class RospyFront:
    """See :class:`~simulate.ros.front.Front`; the node is that of this process."""

    def __init__(self) -> None:
        self._servers: list[Any] = []

    def publisher(self, topic: str, type_: str, *, is_latched: bool = False) -> Publisher:
        """Return a publisher."""
        return _Topic(topic, type_, is_latched)

    def describe(self, urdf: str) -> None:
        """Set the parameter that holds the model."""
        import rospy

        rospy.set_param("robot_description", urdf)

    def stamp(self, seconds: float | None) -> Any:
        """Return a time."""
        import rospy

        return rospy.Time.now() if seconds is None else rospy.Time.from_sec(seconds)

    def feedback(self) -> Any:
        """Return an empty message of feedback."""
        return make_message("control_msgs/FollowJointTrajectoryFeedback")

    def offer_trajectories(self, name: str, carry_out: Callable[[TrajectoryGoal], Ending]) -> None:
        """Offer an action; a newer goal preempts its predecessor."""
        import actionlib

        def execute(message: Any) -> None:
            ending = carry_out(
                TrajectoryGoal(message, server.is_preempt_requested, server.publish_feedback)
            )
            result = make_message("control_msgs/FollowJointTrajectoryResult")
            result.error_code, result.error_string = ending.code, ending.words
            if server.is_preempt_requested():
                server.set_preempted(result, "cancelled")
            elif result.error_code:
                server.set_aborted(result, result.error_string)
            else:
                server.set_succeeded(result)

        kind = type(make_message("control_msgs/FollowJointTrajectoryAction"))
        server = actionlib.SimpleActionServer(name, kind, execute, False)
        server.start()
        self._servers.append(server)

    def offer_act(self, name: str, act: Callable[[JsonObject], JsonObject]) -> None:
        """Offer the act service; an error becomes an exception of ROS."""
        import rospy

        kind = service_type("Act")

        def handle(message: Any) -> Any:
            try:
                answer = act(mapping_of(message))
            except RtaskError as error:
                raise rospy.ServiceException(refusal(error)) from None
            made = kind._response_class()
            for field, value in answer.items():
                setattr(made, field, value)
            return made

        self._servers.append(rospy.Service(name, kind, handle))
