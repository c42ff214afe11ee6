"""The action ``rtask/see``: cut the newest view into objects and ask the graph about each.

Also the service ``rtask/segment``, and what shows rviz and MoveIt what was seen.
"""

from __future__ import annotations

import base64
import logging
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from features.codec import encode_frame
from features.perception import Perceived, Seen, neighbour_points, perceive
from grasp.messages import pose_message
from rtask.errors import DataError, RtaskError
from rtask.interop.ros.camera import CameraTopics, Sight
from rtask.interop.ros.clouds import Transforms, cloud_message, frame_of
from rtask.interop.ros.convert import JsonObject, fill
from rtask.interop.ros.node import Caller
from rtask.interop.ros.package import make_message
from rtask.interop.ros.planning_scene import SceneTopic, scene_id
from rtask.interop.ros.services import Heard, refusal, service_type

__all__ = ["Eyes", "SeeAction", "SeeOptions", "SegmentService"]

log = logging.getLogger(__name__)

_VIEW_S = 5.0
_COLOURS = {
    "grasp": (0.1, 0.8, 0.2), "candidate": (0.2, 0.5, 1.0), "no_grasp": (1.0, 0.7, 0.1),
}  # fmt: skip
_GREY = (0.6, 0.6, 0.6)


@dataclass(frozen=True)
class SeeOptions:
    """Values for what a goal leaves out.

    Parameters
    ----------
    frame
        Frame of the robot with z up, in which the answers are.
    gripper_id
        Name or IRI of the end effector; empty if every goal names one.
    table_height
        m, in that frame; None = as seen.
    min_confidence
        None = by the server's policy.
    """

    frame: str = "base_footprint"
    gripper_id: str = ""
    table_height: float | None = None
    min_confidence: float | None = None


@dataclass(frozen=True)
class View:
    """Objects in a view, and the time at which they were seen."""

    stamp: Any
    base_from_camera: Any
    perceived: Perceived

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

    def view(self, sight: Sight) -> View:
        """Return what a view shows; raises as :meth:`look` does."""
        stamp, camera = sight.header.stamp, sight.header.frame_id
        base_from_camera = self.transforms.lookup(self.frame, camera, stamp)
        frame = sight.read()
        try:
            return View(stamp, base_from_camera, perceive(frame, base_from_camera))
        except ValueError as error:
            raise DataError(f"the view in {camera}: {error}; is its depth in m?") from error


def box_of(seen: Seen) -> tuple[Any, Any]:
    """Return the box around an object: Pose of its middle and Vector3 of its size, m."""
    shape = seen.shape
    middle = np.eye(4)
    middle[2, 3] = shape.height / 2
    pose = fill(
        make_message("geometry_msgs/Pose"), pose_message(shape.frame_from_object() @ middle),
        make_message,
    )  # fmt: skip
    size = make_message("geometry_msgs/Vector3")
    size.x, size.y, size.z = shape.length, shape.width, shape.height
    return pose, size


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
            segment.pose, segment.size = box_of(seen)
            inside = seen.crop.mask if seen.crop.mask is not None else seen.crop.depth_m > 0
            rgb = None if seen.crop.rgb is None else seen.crop.rgb[inside]
            segment.cloud = cloud_message(seen.crop.points()[inside], rgb, request.cloud.header)
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
        self._scene = SceneTopic(eyes.frame)
        self._cancel: Callable[[], None] = lambda: None
        kind = type(make_message("rtask_msgs/SeeAction"))
        self._server = actionlib.SimpleActionServer("rtask/see", kind, self._execute, False)
        self._server.register_preempt_callback(lambda: self._cancel())
        self._server.start()

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
        """Answer one goal: the calls run in a thread, so that cancelling does not wait for them."""
        events: queue.Queue[Any] = queue.Queue()
        cancelled = threading.Event()

        def cancel() -> None:
            cancelled.set()
            events.put(None)

        self._cancel = cancel
        result = make_message("rtask_msgs/SeeResult")
        if self._server.is_preempt_requested():
            cancel()
        threading.Thread(target=self._work, args=(goal, events, cancelled), daemon=True).start()
        while True:
            item = events.get()
            if item is None:
                self._server.set_preempted(result, "cancelled")
                return
            if isinstance(item, RtaskError):
                self._server.set_aborted(result, refusal(item))
                return
            if isinstance(item, View):
                self._show(item, result)
                self._server.set_succeeded(result)
                return
            result.header = item.object.header
            result.objects.append(item.object)
            self._server.publish_feedback(item)

    def _show(self, view: View, result: Any) -> None:
        seen = view.perceived
        result.status = seen.status
        self._markers.publish(_markers(result, self._eyes.frame))
        header = view.header(self._eyes.frame)
        named = zip(_names(result.objects), result.objects, strict=True)
        self._scene.publish(header, seen.table, seen.table_height, list(named))

    def _work(self, goal: Any, events: queue.Queue[Any], cancelled: threading.Event) -> None:
        try:
            view = self._eyes.look(goal.header.stamp)
            for number, seen in enumerate(view.perceived.objects, start=1):
                if cancelled.is_set():
                    return
                feedback = make_message("rtask_msgs/SeeFeedback")
                feedback.number, feedback.count = number, len(view.perceived.objects)
                feedback.object = self._ask(goal, view, seen, number)
                events.put(feedback)
            events.put(view)
        except RtaskError as error:
            events.put(error)
        finally:
            # Whatever ended this thread must not leave the goal without an end.
            events.put(RtaskError("the view could not be examined; see the log of the node"))

    def _ask(self, goal: Any, view: View, seen: Seen, number: int) -> Any:
        """Return what the graph knows of one object; an error of the server is part of it."""
        seen_object = make_message("rtask_msgs/SeenObject")
        seen_object.header, seen_object.label = view.header(self._eyes.frame), number
        seen_object.pose, seen_object.size = box_of(seen)
        try:
            answer = self._client.call("recognise_for_grasp", **self._request(goal, view, seen))
        except RtaskError as error:
            seen_object.task_response, seen_object.error = "error", refusal(error)
            return seen_object
        self._heard("recognise_for_grasp", answer)
        seen_object.task_response, seen_object.task_id = answer["task_response"], answer["task_id"]
        seen_object.object, seen_object.name = answer["object"], answer["label"]
        seen_object.class_name, seen_object.class_iri = answer["class"], answer["class_iri"]
        seen_object.confidence = float(answer["confidence"])
        seen_object.grasps = [
            fill(make_message("moveit_msgs/Grasp"), grasp, make_message)
            for grasp in answer["grasps"]
        ]
        return seen_object

    def _request(self, goal: Any, view: View, seen: Seen) -> JsonObject:
        options, stamp = self._options, view.stamp
        table = options.table_height
        asked: JsonObject = {
            "gripper_id": goal.gripper_id or options.gripper_id,
            "data": base64.b64encode(encode_frame(seen.crop)).decode("ascii"),
            "sensor_pose": pose_message(view.base_from_camera),
            "frame_id": self._eyes.frame,
            "support_height": view.perceived.table_height if table is None else table,
            "stamp": {"secs": stamp.secs, "nsecs": stamp.nsecs},
            "propose": bool(goal.propose),
            "neighbours": neighbour_points(seen, view.perceived),
        }
        least = [*goal.min_confidence, options.min_confidence][0]
        optional = {
            "task": goal.task or None, "max_grasps": goal.max_grasps or None,
            "min_confidence": least,
        }  # fmt: skip
        return {**asked, **{name: value for name, value in optional.items() if value is not None}}


def _names(objects: Iterable[Any]) -> list[str]:
    """Return the names of objects in the planning scene."""
    names: list[str] = []
    for seen in objects:
        names.append(scene_id(seen.object, seen.label, names))
    return names


def _markers(result: Any, frame: str) -> Any:
    """Return a visualization_msgs/MarkerArray with a box and a name for each object."""
    from visualization_msgs.msg import MarkerArray

    return MarkerArray([_marker("DELETEALL", result.header, frame), *_boxes(result, frame)])


def _boxes(result: Any, frame: str) -> Iterator[Any]:
    for k, seen in enumerate(result.objects):
        box = _marker("CUBE", seen.header, frame)
        box.ns, box.id, box.pose, box.scale = "objects", k, seen.pose, seen.size
        box.color.r, box.color.g, box.color.b = _COLOURS.get(seen.task_response, _GREY)
        box.color.a = 0.5
        yield box
        name = _marker("TEXT_VIEW_FACING", seen.header, frame)
        name.ns, name.id = "names", k
        name.pose.position.x, name.pose.position.y = seen.pose.position.x, seen.pose.position.y
        name.pose.position.z = seen.pose.position.z + seen.size.z / 2 + 0.03
        name.pose.orientation.w = 1.0
        name.scale.z, name.color.a = 0.03, 1.0
        name.color.r = name.color.g = name.color.b = 1.0
        name.text = f"{seen.name or '?'} {seen.confidence:.2f}"
        yield name


def _marker(kind: str, header: Any, frame: str) -> Any:
    from visualization_msgs.msg import Marker

    marker = Marker(action=Marker.DELETEALL if kind == "DELETEALL" else Marker.ADD)
    marker.header.stamp, marker.header.frame_id = header.stamp, frame
    marker.type = getattr(Marker, kind, 0) if kind != "DELETEALL" else 0
    return marker
