"""A simulated body in ROS 2."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rtask.errors import RtaskError, UsageError
from rtask.interop.ros.convert import JsonObject, fill, make_message, mapping_of, time_like
from rtask.interop.ros.operations import refusal
from rtask.ros2.qos import events, latched
from simulate.ros.front import Ending, Publisher, TrajectoryGoal

__all__ = ["RclpyFront"]


class _Topic:
    def __init__(self, node: Any, topic: str, type_: str, is_latched: bool) -> None:
        qos = latched() if is_latched else events()
        self._publisher = node.create_publisher(type(make_message(type_)), topic, qos)

    def publish(self, message: Any) -> None:
        self._publisher.publish(message)

    def is_heard(self) -> bool:
        return bool(self._publisher.get_subscription_count())


class RclpyFront:
    """See :class:`~simulate.ros.front.Front`.

    Parameters
    ----------
    node
        Whose callbacks run in several threads: a goal waits for the physics in one.

    Raises
    ------
    UsageError
        A package of messages is missing.
    """

    def __init__(self, node: Any) -> None:
        from rclpy.callback_groups import ReentrantCallbackGroup

        try:
            from control_msgs.action import FollowJointTrajectory
            from rtask_msgs.srv import Act
        except ImportError as error:
            raise UsageError(
                f"{error}: apt-get install ros-$ROS_DISTRO-control-msgs, build the package of "
                "`rtask ros messages` with colcon, and source both"
            ) from error
        self._node, self._group = node, ReentrantCallbackGroup()
        self._action, self._act = FollowJointTrajectory, Act
        self._servers: list[Any] = []

    def publisher(self, topic: str, type_: str, *, is_latched: bool = False) -> Publisher:
        """Return a publisher; reliable, which subscribers of sensors hear as well."""
        return _Topic(self._node, topic, type_, is_latched)

    def describe(self, urdf: str) -> None:
        """Publish the model, latched."""
        message = make_message("std_msgs/String")
        message.data = urdf
        self.publisher("robot_description", "std_msgs/String", is_latched=True).publish(message)

    def stamp(self, seconds: float | None) -> Any:
        """Return a time."""
        nanoseconds = (
            self._node.get_clock().now().nanoseconds if seconds is None else round(seconds * 1e9)
        )
        made: Any = make_message("builtin_interfaces/Time")
        return time_like(made, *divmod(nanoseconds, 10**9))

    def feedback(self) -> Any:
        """Return an empty message of feedback."""
        return self._action.Feedback()

    def offer_trajectories(self, name: str, carry_out: Callable[[TrajectoryGoal], Ending]) -> None:
        """Offer an action; a newer goal ends its predecessor, as controllers of ros2_control do."""
        from rclpy.action import ActionServer, CancelResponse, GoalResponse

        lock = threading.Lock()
        newest: list[Any] = []

        def accept(handle: Any) -> None:
            with lock:
                newest[:] = [handle]
            handle.execute()

        def is_replaced(handle: Any) -> bool:
            with lock:
                return newest[0] is not handle

        def execute(handle: Any) -> Any:
            ending = carry_out(
                TrajectoryGoal(
                    handle.request,
                    lambda: handle.is_cancel_requested or is_replaced(handle),
                    handle.publish_feedback,
                )
            )
            result = self._action.Result()
            result.error_code, result.error_string = ending.code, ending.words
            if is_replaced(handle) and not ending.code:
                result.error_string = "a newer goal came"
            if handle.is_cancel_requested:
                handle.canceled()
            elif ending.code or is_replaced(handle):
                handle.abort()
            else:
                handle.succeed()
            return result

        self._servers.append(
            ActionServer(
                self._node, self._action, name, execute, callback_group=self._group,
                goal_callback=lambda goal: GoalResponse.ACCEPT, handle_accepted_callback=accept,
                cancel_callback=lambda handle: CancelResponse.ACCEPT,
            )
        )  # fmt: skip

    def offer_act(self, name: str, act: Callable[[JsonObject], JsonObject]) -> None:
        """Offer the act service; ROS 2 has no exceptions in services, so an error is a reason."""

        def handle(request: Any, response: Any) -> Any:
            try:
                answer = act(mapping_of(request))
            except RtaskError as error:
                answer = {"reason": refusal(error)}
            return fill(response, answer, make_message)

        self._servers.append(
            self._node.create_service(self._act, name, handle, callback_group=self._group)
        )
