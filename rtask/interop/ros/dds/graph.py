"""The operations of a server as services of ROS 2, and its commits as a topic."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.changes import Follow, change_message, commits_of
from rtask.interop.ros.clouds import packed_cloud
from rtask.interop.ros.dds.node import DdsNode
from rtask.interop.ros.operations import Caller, OperationHandler, best_grasp
from rtask.interop.ros.schema import PACKAGE, Schema

__all__ = ["ChangeFeed", "GraphServices"]

log = logging.getLogger(__name__)

_GRASP = "moveit_msgs/msg/Grasp"


class GraphServices:
    """One service for each operation, and the best grasp of the last answer as a latched topic.

    An operation that was refused is answered with its reason in the field ``refused``.

    Parameters
    ----------
    client
        Of the server; each call ends within its time limit.
    """

    def __init__(self, node: DdsNode, schema: Schema, client: Caller) -> None:
        self._types = node.types
        make = node.types.make
        self._handler = OperationHandler(schema, client, make, self._publish_grasp, packed_cloud)
        self._grasps = node.publisher("rtask/grasps", _GRASP, is_latched=True)
        for name, service in schema.services.items():
            type_ = f"{PACKAGE}/srv/{service.name}"
            node.serve(f"rtask/{name}", type_, self._answers(name, f"{type_}_Response"))

    def _answers(self, operation: str, response: str) -> Callable[[Any], Any]:
        return lambda message: self._handler.answer_or_refuse(
            operation, message, lambda: self._types.make(response)
        )

    def _publish_grasp(self, operation: str, answer: Mapping[str, Any]) -> None:
        grasp = best_grasp(operation, answer, self._types.make)
        if grasp is not None:
            self._grasps.publish(grasp)


class ChangeFeed:
    """Topic ``rtask/changes``: one message for each commit, from a thread of its own.

    Parameters
    ----------
    follow
        Returns the commits from now on, over as many connections as it takes.
    ended
        Set when the server refused, which ends it; the reason is in ``failure``. A server that is
        away ends nothing.
    """

    def __init__(self, node: DdsNode, follow: Follow, ended: threading.Event) -> None:
        self._topic = node.publisher("rtask/changes", f"{PACKAGE}/msg/Change")
        self._make, self._follow, self._ended = node.types.make, follow, ended
        self.failure: RtaskError | None = None
        threading.Thread(target=self._run, daemon=True, name="rtask-changes").start()

    def _run(self) -> None:
        try:
            for commit in commits_of(self._follow, lambda: not self._ended.is_set()):
                if self._ended.is_set():
                    return
                self._topic.publish(change_message(commit, self._make))
        except RtaskError as error:
            self.failure = error
            self._ended.set()
