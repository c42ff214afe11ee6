"""The action ``rtask/see`` and the service ``rtask/segment`` of ROS 2."""

from __future__ import annotations

import base64
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.client.calling.client import HeldClient
from rtask.errors import RtaskError
from rtask.interop.ros.convert import JsonObject, fill, make_message
from rtask.interop.ros.looking import Look, SeeOptions, SeeRun
from rtask.interop.ros.operations import Heard, refusal
from rtask.interop.ros.scene.exchange import SceneExchange
from rtask.interop.ros.scene.source import SceneSource
from rtask.interop.ros.schema import REFUSED
from rtask.interop.ros.showing import markers
from rtask.interop.ros.views.newest import Sight
from rtask.ros2.body import RobotBody
from rtask.ros2.camera import CameraTopics
from rtask.ros2.clouds import cloud_json, cloud_of_rows
from rtask.ros2.qos import latched
from rtask.ros2.transforms import TransformBuffer

__all__ = ["Eyes", "SeeAction", "SegmentService"]

_VIEW_S = 5.0
_POLL_S = 0.05
_PERCEPTION = ("rtask/Segmentation", "perceive")


class Eyes:
    """Views of the robot's camera, posed by TF, which the server cuts into objects."""

    def __init__(
        self, camera: CameraTopics, transforms: TransformBuffer, client: HeldClient, frame: str,
        body: RobotBody,
    ) -> None:  # fmt: skip
        self.frame = frame
        self._camera, self._transforms, self._client = camera, transforms, client
        self._body = body

    def look(self, since: Any) -> Look:
        """Return what the camera sees that is not older than a time.

        Raises
        ------
        RtaskError
            Nothing came, TF does not say where the camera was, or the server cannot read it.
        """
        sight = self._camera.wait(_VIEW_S, since)
        answer, pose = self.perceive(sight)
        return Look.from_json(answer, sight.header.stamp, pose)

    def frames_at(self, stamp: Any, wait_s: float = 0.5) -> Callable[[str], NDArray[np.float64]]:
        """Return what looks up the pose (4, 4) of a frame at a time, in the frame of the robot.

        It waits for transforms ``wait_s`` in all.
        """
        ends = time.monotonic() + wait_s

        def lookup(frame: str) -> NDArray[np.float64]:
            if frame == self.frame.lstrip("/"):
                return np.eye(4)
            left_s = max(ends - time.monotonic(), 0.0)
            return np.array(self._transforms.lookup(self.frame, frame, stamp, left_s).as_matrix())

        return lookup

    def perceive(self, sight: Sight[JsonObject], **options: Any) -> tuple[JsonObject, JsonObject]:
        """Return the server's answer to a view, and the pose of its camera."""
        header = sight.header
        pose = self._transforms.lookup(self.frame, header.frame_id, header.stamp).as_pose()
        request = {"sensor_pose": pose, **options, **sight.read()}
        body = self._body.placed(self.frames_at(header.stamp), self.frame)
        if body:
            request["body"] = body
        return self._client.read_method(*_PERCEPTION, request), pose


class SegmentService:
    """Service ``rtask/segment``: a cloud in, its objects out."""

    def __init__(self, node: Any, eyes: Eyes, group: Any, is_active: Callable[[], bool]) -> None:
        from rtask_msgs.srv import SegmentCloud

        self._eyes, self._is_active = eyes, is_active
        self.service = node.create_service(
            SegmentCloud, "rtask/segment", self._handle, callback_group=group
        )

    def _handle(self, request: Any, response: Any) -> Any:
        cloud = request.cloud
        if not self._is_active():
            setattr(response, REFUSED, "the node is not active")
            return response
        try:
            sight = Sight(cloud.header, lambda: {"cloud": cloud_json(cloud)})
            answer, _ = self._eyes.perceive(sight, points=True)
        except RtaskError as error:
            setattr(response, REFUSED, refusal(error))
            return response
        height = answer["table_height"]
        response.header.stamp, response.header.frame_id = cloud.header.stamp, self._eyes.frame
        response.status = answer["status"]
        response.table_height = float("nan") if height is None else float(height)
        for number, seen in enumerate(answer["objects"], start=1):
            segment = make_message("rtask_msgs/CloudSegment")
            segment.label = number
            fill(segment.pose, seen["pose"], make_message)
            segment.size.x, segment.size.y, segment.size.z = (float(v) for v in seen["size"])
            rows = base64.b64decode(seen["points"])
            segment.cloud = cloud_of_rows(rows, cloud.header, make_message)
            response.segments.append(segment)
        return response


class SeeAction:
    """Action ``rtask/see`` with feedback for each object; a cancelled goal ends at once.

    One goal at a time: a newer one ends its predecessor, as actionlib's simple server did.

    Parameters
    ----------
    heard
        Called with the operation and the answer after each call.
    scene
        MoveIt's, which grasps keep clear of; None to leave it aside.
    """

    def __init__(
        self, node: Any, eyes: Eyes, client: HeldClient, options: SeeOptions, heard: Heard,
        group: Any, is_active: Callable[[], bool], scene: SceneSource | None = None,
    ) -> None:  # fmt: skip
        from rclpy.action import ActionServer, CancelResponse, GoalResponse
        from rtask_msgs.action import See

        self._eyes, self._client, self._options, self._heard = eyes, client, options, heard
        self._lock = threading.Lock()
        self._newest: Any = None
        self.make_result: Callable[[], Any] = See.Result
        kind = type(make_message("visualization_msgs/MarkerArray"))
        change = type(make_message("moveit_msgs/PlanningScene"))
        self.publishers = [
            node.create_lifecycle_publisher(kind, "rtask/objects", latched()),
            node.create_lifecycle_publisher(change, "rtask/planning_scene", latched()),
        ]
        self.scene = SceneExchange(scene, eyes.frames_at, options.frame, make_message)
        self.server = ActionServer(
            node,
            See,
            "rtask/see",
            self._execute,
            callback_group=group,
            goal_callback=lambda goal: GoalResponse.ACCEPT if is_active() else GoalResponse.REJECT,
            handle_accepted_callback=self.accept,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        self._feedback = See.Feedback

    def accept(self, handle: Any) -> None:
        """Begin a goal, of this action or of one that looks as it does; the last one ends."""
        with self._lock:
            self._newest = handle
        handle.execute()

    def _execute(self, handle: Any) -> Any:
        """Answer one goal."""
        result = self.make_result()
        look = self.examine(handle, handle.request, result, handle.publish_feedback)
        if look is not None:
            self.show(look, result)
            handle.succeed()
        return result

    def examine(
        self, handle: Any, goal: Any, result: Any, feedback: Callable[[Any], None]
    ) -> Look | None:
        """Put each object of a view to the graph; None where the goal ended otherwise."""
        run = SeeRun(
            goal, lambda: self._eyes.look(goal.header.stamp), self._client, self._options,
            self._make, self._heard, self.scene.obstacles,
        )  # fmt: skip
        run.start()
        while True:
            item = self._next(run, handle)
            if item is None:
                # Only the client's cancel may end as cancelled (actions, state machine).
                (handle.canceled if handle.is_cancel_requested else handle.abort)()
                return None
            if isinstance(item, RtaskError):
                setattr(result, REFUSED, refusal(item))
                handle.abort()
                return None
            if isinstance(item, Look):
                result.status, result.scene_notes = item.status, [*item.doubts, *run.notes]
                return item
            result.header = item.object.header
            result.objects.append(item.object)
            feedback(item)

    def _next(self, run: SeeRun, handle: Any) -> Any:
        """Return the next event of a goal; None when it was cancelled or replaced."""
        while True:
            # A handle is cancelled only after its callback, and has no event for that.
            if handle.is_cancel_requested or self._newest is not handle:
                run.cancel()
                return None
            try:
                return run.events.get(timeout=_POLL_S)
            except queue.Empty:
                continue

    def _make(self, type_: str) -> Any:
        return self._feedback() if type_ == "rtask_msgs/SeeFeedback" else make_message(type_)

    def show(self, look: Look, result: Any, target: int | None = None) -> None:
        """Show rviz and MoveIt the objects of a view, one of them as what is to be grasped."""
        shown, scene = self.publishers
        shown.publish(markers(result, self._options.frame, make_message))
        scene.publish(self.scene.change(look, result.objects, target))
