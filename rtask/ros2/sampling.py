"""The action ``rtask/sample_grasp_poses`` of ROS 2, for the MoveIt Task Constructor."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.convert import make_message
from rtask.interop.ros.operations import refusal
from rtask.interop.ros.sampling import ACTION, AGAIN_S, candidates, sampling_goal, target_of
from rtask.interop.ros.schema import REFUSED
from rtask.ros2.seeing import SeeAction

__all__ = ["SampleAction"]

_TYPES = {ACTION: "rtask_msgs", f"{ACTION}_mtc": "moveit_task_constructor_msgs"}
"""Package of the type SampleGraspPoses by the name of an action; the second is in few releases."""


class SampleAction:
    """Looks, and answers with the grasps of one object as poses with costs.

    A goal ends what ``rtask/see`` is doing, and the other way round: there is one camera.

    Parameters
    ----------
    see
        Which examines the view, and shows MoveIt that the hand may touch the object.
    """

    def __init__(
        self, node: Any, see: SeeAction, group: Any, is_active: Callable[[], bool]
    ) -> None:
        self._node, self._see, self._group, self._is_active = node, see, group, is_active
        self.servers = []
        for name, package in _TYPES.items():
            try:
                kind = importlib.import_module(f"{package}.action").SampleGraspPoses
            except (ImportError, AttributeError):
                continue
            self.servers.append(self._serve(name, kind))

    def _serve(self, name: str, kind: Any) -> Any:
        from rclpy.action import ActionServer, CancelResponse, GoalResponse

        def accepts(goal: Any) -> Any:
            return GoalResponse.ACCEPT if self._is_active() else GoalResponse.REJECT

        return ActionServer(
            self._node,
            kind,
            name,
            lambda handle: self._execute(handle, kind),
            callback_group=self._group,
            goal_callback=accepts,
            handle_accepted_callback=self._see.accept,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )

    def _execute(self, handle: Any, kind: Any) -> Any:
        """Answer one goal."""
        answer, result = kind.Result(), self._see.make_result()
        look = self._see.examine(handle, sampling_goal(make_message), result, lambda item: None)
        if look is None:
            answer.grasp_state = getattr(result, REFUSED)
            return answer
        asked = str(handle.request.action_name)
        if asked.strip("/").endswith((ACTION, f"{ACTION}_mtc")):
            asked = ""
        try:
            name = asked or str(self._node.get_parameter("grasp_target").value)
            target = target_of(name, result.objects)
            poses, costs = candidates(result.objects[target])
        except RtaskError as error:
            answer.grasp_state = refusal(error)
            handle.abort()
            return answer
        self._see.show(look, result, target)
        feedback = kind.Feedback()
        feedback.grasp_candidates, feedback.costs = poses, costs
        handle.publish_feedback(feedback)
        threading.Event().wait(AGAIN_S)
        handle.publish_feedback(feedback)
        answer.grasp_state = f"{len(poses)} grasps of {result.objects[target].name or 'unknown'}"
        handle.succeed()
        return answer
