"""The action ``rtask/see``: cut the newest view into objects and ask the graph about each.

Also the service ``rtask/segment``, and what shows rviz and MoveIt what was seen.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

from features.geometry import Frame
from features.perception import Perceived, perceive
from rtask.errors import DataError, RtaskError
from rtask.interop.ros.clouds import cloud_message, frame_of
from rtask.interop.ros.convert import fill, make_message
from rtask.interop.ros.looking import Look, SeeOptions, SeeRun
from rtask.interop.ros.operations import Caller, Heard, refusal
from rtask.interop.ros.perceived import box_of, look_of, points_of
from rtask.interop.ros.services import service_type
from rtask.interop.ros.showing import SceneChanges, markers
from rtask.interop.ros.transforms import Transforms
from rtask.interop.ros.views.camera import CameraTopics
from rtask.interop.ros.views.newest import Sight

__all__ = ["Eyes", "SeeAction", "SegmentService"]

log = logging.getLogger(__name__)

_VIEW_S = 5.0


@dataclass(frozen=True)
class View:
    """Objects in a view, and the time at which they were seen."""

    stamp: Any
    base_from_camera: Any
    perceived: Perceived

    def as_look(self) -> Look:
        """Return it as poses, boxes and crops."""
        return look_of(self.perceived, self.base_from_camera, self.stamp)

    def header(self, frame: str) -> Any:
        """Return the time of the view with another frame."""
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = self.stamp, frame
        return header


class Eyes:
    """Views of the robot's camera: the newest one, posed by TF, cut into objects."""

    def __init__(self, frame: str) -> None:
        self.frame = frame
        self.camera = CameraTopics()
        self.transforms = Transforms()

    def look(self, since: Any) -> View:
        """Return what the camera sees that is not older than a time.

        Raises
        ------
        RemoteUnavailableError, UsageError, DataError
            Nothing came, TF does not say where the camera was, or it shows no picture.
        """
        return self.view(self.camera.wait(_VIEW_S, since))

    def view(self, sight: Sight[Frame]) -> View:
        """Return what a view shows; raises as :meth:`look` does."""
        stamp, camera = sight.header.stamp, sight.header.frame_id
        base_from_camera = self.transforms.lookup(self.frame, camera, stamp)
        frame = sight.read()
        try:
            return View(stamp, base_from_camera, perceive(frame, base_from_camera))
        except ValueError as error:
            raise DataError(f"the view in {camera}: {error}; is its depth in m?") from error


class SegmentService:
    """Service ``rtask/segment``: a cloud in, its objects out."""

    def __init__(self, eyes: Eyes) -> None:
        import rospy

        self._eyes = eyes
        kind = service_type("SegmentCloud")
        self._answer = kind._response_class
        self._served = rospy.Service("rtask/segment", kind, self._handle)

    def _handle(self, request: Any) -> Any:
        import rospy

        try:
            cloud = request.cloud
            view = self._eyes.view(Sight(cloud.header, lambda: frame_of(cloud)))
        except RtaskError as error:
            raise rospy.ServiceException(refusal(error)) from error
        answer = self._answer()
        answer.header = view.header(self._eyes.frame)
        answer.status = view.perceived.status
        answer.table_height = view.perceived.table_height
        for number, seen in enumerate(view.perceived.objects, start=1):
            segment = make_message("rtask_msgs/CloudSegment")
            segment.label = number
            pose, (segment.size.x, segment.size.y, segment.size.z) = box_of(seen)
            fill(segment.pose, pose, make_message)
            segment.cloud = cloud_message(*points_of(seen), request.cloud.header)
            answer.segments.append(segment)
        return answer


class SeeAction:
    """Action ``rtask/see`` with feedback for each object; a cancelled goal ends at once.

    Parameters
    ----------
    heard
        Called with the operation and the answer after each call.
    """

    def __init__(self, eyes: Eyes, client: Caller, options: SeeOptions, heard: Heard) -> None:
        import actionlib
        import rospy
        from visualization_msgs.msg import MarkerArray

        self._eyes, self._client, self._options, self._heard = eyes, client, options, heard
        self._markers = rospy.Publisher("rtask/objects", MarkerArray, queue_size=1, latch=True)
        scene = type(make_message("moveit_msgs/PlanningScene"))
        self._topic = rospy.Publisher("rtask/planning_scene", scene, queue_size=1, latch=True)
        self._scene = SceneChanges(eyes.frame, make_message)
        self._run: SeeRun | None = None
        kind = type(make_message("rtask_msgs/SeeAction"))
        self._server = actionlib.SimpleActionServer("rtask/see", kind, self._execute, False)
        self._server.register_preempt_callback(self._cancel)
        self._server.start()

    def _cancel(self) -> None:
        if self._run is not None:
            self._run.cancel()

    def forget(self) -> None:
        """Forget former goals after a jump back in time.

        actionlib recalls every goal that is older than its last one.
        """
        import actionlib
        import rospy

        server = self._server
        with server.lock:
            if not server.is_active():
                server.current_goal = server.next_goal = actionlib.ServerGoalHandle()
            server.action_server.last_cancel = rospy.Time()

    def _execute(self, goal: Any) -> None:
        """Answer one goal."""
        run = self._run = SeeRun(
            goal,
            lambda: self._eyes.look(goal.header.stamp).as_look(),
            self._client,
            self._options,
            make_message,
            self._heard,
        )
        result = make_message("rtask_msgs/SeeResult")
        if self._server.is_preempt_requested():
            run.cancel()
        run.start()
        while True:
            item = run.events.get()
            if item is None:
                self._server.set_preempted(result, "cancelled")
                return
            if isinstance(item, RtaskError):
                result.refused = refusal(item)
                self._server.set_aborted(result, result.refused)
                return
            if isinstance(item, Look):
                self._show(item, result)
                self._server.set_succeeded(result)
                return
            result.header = item.object.header
            result.objects.append(item.object)
            self._server.publish_feedback(item)

    def _show(self, look: Look, result: Any) -> None:
        result.status = look.status
        self._markers.publish(markers(result, self._eyes.frame, make_message))
        self._topic.publish(self._scene.change(look, result.objects))
