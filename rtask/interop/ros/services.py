"""The operations of the engine as ROS services, and what is published of their answers."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.clouds import packed_cloud
from rtask.interop.ros.convert import make_message
from rtask.interop.ros.operations import Caller, Heard, OperationHandler, best_grasp, refusal
from rtask.interop.ros.schema import PACKAGE, Schema
from rtask.interop.ros.world_markers import WORLD_TOPIC, WorldDisplay

__all__ = ["BestGrasps", "OperationServices", "service_type", "world_display"]


def service_type(name: str) -> Any:
    """Return the class of a service of the package, ``RecogniseForGrasp``."""
    return getattr(importlib.import_module(f"{PACKAGE}.srv"), name)


class OperationServices:
    """One ROS service for each operation.

    Parameters
    ----------
    client
        Of the server; each call ends within its time limit.
    heard
        Called with the operation and the answer after each call that was answered.
    """

    def __init__(self, schema: Schema, client: Caller, heard: Heard) -> None:
        import rospy

        self._handler = OperationHandler(schema, client, make_message, heard, packed_cloud)
        self._served = [
            rospy.Service(
                f"rtask/{name}",
                service_type(service.name),
                self._answers(name, service_type(service.name)._response_class),
            )
            for name, service in schema.services.items()
        ]

    def _answers(self, operation: str, response: Callable[[], Any]) -> Callable[[Any], Any]:
        import rospy

        def handle(message: Any) -> Any:
            try:
                return self._handler.answer(operation, message, response())
            except RtaskError as error:
                raise rospy.ServiceException(refusal(error)) from error

        return handle


class BestGrasps:
    """Latched topic with the best grasp of the last answer that had one."""

    def __init__(self) -> None:
        import rospy

        grasp = type(make_message("moveit_msgs/Grasp"))
        self._topic = rospy.Publisher("rtask/grasps", grasp, queue_size=1, latch=True)

    def heard(self, operation: str, answer: Mapping[str, Any]) -> None:
        """Publish the best grasp of an answer of ``recognise_for_grasp``."""
        grasp = best_grasp(operation, answer, make_message)
        if grasp is not None:
            self._topic.publish(grasp)


def world_display(client: Caller) -> WorldDisplay:
    """Return the display of the world on the latched topic ``rtask/world``, for rviz."""
    import rospy
    from visualization_msgs.msg import MarkerArray

    topic = rospy.Publisher(WORLD_TOPIC, MarkerArray, queue_size=1, latch=True)
    return WorldDisplay(
        lambda: client.call("show_world"),
        topic.publish,
        lambda: bool(topic.get_num_connections()),
        make_message,
    )
