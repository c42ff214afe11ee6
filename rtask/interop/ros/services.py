"""The operations of the engine as ROS services, and what is published of their answers."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.convert import Converter, fill
from rtask.interop.ros.node import Caller
from rtask.interop.ros.package import make_message
from rtask.interop.ros.schema import PACKAGE, Schema

__all__ = ["BestGrasps", "OperationServices", "service_names", "service_type"]

log = logging.getLogger(__name__)

_MAX_WORDS = 500
Heard = Callable[[str, Mapping[str, Any]], None]


def service_names(schema: Schema) -> list[str]:
    """Return the relative names of the services of all operations."""
    return [f"rtask/{name}" for name in schema.services]


def service_type(name: str) -> Any:
    """Return the class of a service of the package, ``RecogniseForGrasp``."""
    return getattr(importlib.import_module(f"{PACKAGE}.srv"), name)


def refusal(error: Exception) -> str:
    """Return an error as a service tells it: its first line, at most 500 characters."""
    return (str(error).strip() or repr(error)).partition("\n")[0][:_MAX_WORDS]


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

        self._schema, self._client, self._heard = schema, client, heard
        self._converter = Converter(schema, make_message)
        self._served = [
            rospy.Service(f"rtask/{name}", service_type(service.name), self._handler(name))
            for name, service in schema.services.items()
        ]

    def _handler(self, operation: str) -> Callable[[Any], Any]:
        import rospy

        answer_class = service_type(self._schema.services[operation].name)._response_class

        def handle(message: Any) -> Any:
            try:
                request = self._converter.request(operation, message)
                data = self._client.call(operation, **request)
                answer = self._converter.answer(operation, data, answer_class())
            except RtaskError as error:
                raise rospy.ServiceException(refusal(error)) from error
            self._heard(operation, data)
            return answer

        return handle


class BestGrasps:
    """Latched topic with the best grasp of the last answer that had one."""

    def __init__(self) -> None:
        import rospy

        grasp = type(make_message("moveit_msgs/Grasp"))
        self._topic = rospy.Publisher("rtask/grasps", grasp, queue_size=1, latch=True)

    def heard(self, operation: str, answer: Mapping[str, Any]) -> None:
        """Publish the best grasp of an answer of ``recognise_for_grasp``."""
        if operation == "recognise_for_grasp" and answer.get("grasps"):
            grasp = fill(make_message("moveit_msgs/Grasp"), answer["grasps"][0], make_message)
            self._topic.publish(grasp)
