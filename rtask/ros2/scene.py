"""The planning scene of MoveIt 2: its service and its topic."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.scene.source import ALL_COMPONENTS, SceneSource
from rtask.ros2.qos import events

__all__ = ["SceneClient"]

_ANSWER_S = 5.0


class SceneClient:
    """Asks ``get_planning_scene``, and hears ``monitored_planning_scene`` where nobody offers it.

    Parameters
    ----------
    group
        Of callbacks that run beside a goal which waits for the answer.
    hand_links
        Links of the hand, as MoveIt names them.
    """

    def __init__(self, node: Any, group: Any, hand_links: tuple[str, ...]) -> None:
        from moveit_msgs.msg import PlanningScene
        from moveit_msgs.srv import GetPlanningScene

        self.source = SceneSource(self._fetch, hand_links)
        self._request: Callable[[], Any] = GetPlanningScene.Request
        self.client = node.create_client(
            GetPlanningScene, "get_planning_scene", callback_group=group
        )
        self.subscription = node.create_subscription(
            PlanningScene, "monitored_planning_scene", self.source.take, events(100),
            callback_group=group,
        )  # fmt: skip

    def _fetch(self) -> Any:
        if not self.client.service_is_ready():
            return None
        request = self._request()
        request.components.components = ALL_COMPONENTS
        answered = threading.Event()
        future = self.client.call_async(request)
        future.add_done_callback(lambda done: answered.set())
        if not answered.wait(_ANSWER_S):
            self.client.remove_pending_request(future)
            raise RemoteUnavailableError(
                f"{self.client.srv_name} is offered and did not answer within {_ANSWER_S:g} s: "
                "where MoveIt's obstacles are is not known"
            )
        return future.result().scene
