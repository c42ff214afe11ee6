"""The robot's model, as ``robot_state_publisher`` publishes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import JsonObject
from rtask.interop.ros.robot.model import RobotModel
from rtask.ros2.qos import latched

__all__ = ["RobotBody"]


class RobotBody:
    """Subscribes to ``robot_description``; without one nothing is known of the body.

    What of the body cannot be used is said in the log, once.
    """

    def __init__(self, node: Any, group: Any) -> None:
        from std_msgs.msg import String

        self._node = node
        self._model: RobotModel | None = None
        self._is_heard = False
        self._warned: set[str] = set()
        self.subscription = node.create_subscription(
            String, "robot_description", self._take, latched(), callback_group=group
        )

    def placed(self, lookup: Callable[[str], NDArray[np.float64]], base: str) -> list[JsonObject]:
        """Return the shapes of the body at the time of a lookup; see :class:`RobotModel`."""
        if self._model is None:
            if not self._is_heard:
                self._warn("no robot_description was heard: nothing is known of the robot's body")
            return []
        shapes, unplaced = self._model.placed(lookup, base)
        if unplaced:
            self._warn(f"TF does not say where {', '.join(unplaced)} of the robot's body are")
        return shapes

    def _take(self, message: Any) -> None:
        self._is_heard = True
        try:
            self._model = RobotModel(message.data)
        except UsageError as error:
            self._model = None
            self._warn(str(error))
            return
        for note in self._model.notes:
            self._warn(f"robot_description: {note}")

    def _warn(self, words: str) -> None:
        if words not in self._warned:
            self._warned.add(words)
            self._node.get_logger().warning(f"{words}; parts of the robot may be taken for objects")
