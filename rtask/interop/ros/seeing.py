"""The action ``rtask/see``: cut the newest view into objects and ask the graph about each.

Also the service ``rtask/segment``, and what shows rviz and MoveIt what was seen.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.perception import Perceived, perceive
from rtask.errors import DataError, RtaskError, UsageError
from rtask.interop.ros.clouds import cloud_message, frame_of
from rtask.interop.ros.convert import JsonObject, fill, make_message
from rtask.interop.ros.looking import Look, SeeOptions, SeeRun
from rtask.interop.ros.operations import Caller, Heard, refusal
from rtask.interop.ros.perceived import box_of, look_of, points_of
from rtask.interop.ros.robot.body import body_of_json, body_pixels
from rtask.interop.ros.robot.model import RobotModel
from rtask.interop.ros.sampling import ACTION, AGAIN_S, candidates, sampling_goal, target_of
from rtask.interop.ros.scene.exchange import SceneExchange
from rtask.interop.ros.scene.source import SceneSource
from rtask.interop.ros.services import service_type
from rtask.interop.ros.showing import markers
from rtask.interop.ros.transforms import Transforms
from rtask.interop.ros.views.camera import CameraTopics
from rtask.interop.ros.views.newest import Sight

__all__ = ["Eyes", "SampleAction", "SeeAction", "SegmentService"]

log = logging.getLogger(__name__)

_VIEW_S = 5.0


@dataclass(frozen=True)
class View:
    """Objects in a view, and the time at which they were seen."""

    stamp: Any
    base_from_camera: Any
    perceived: Perceived
    doubts: tuple[str, ...] = ()

    def as_look(self) -> Look:
        """Return it as poses, boxes and crops."""
        return look_of(self.perceived, self.base_from_camera, self.stamp, self.doubts)

    def header(self, frame: str) -> Any:
        """Return the time of the view with another frame."""
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = self.stamp, frame
        return header


class Eyes:
    """Views of the robot's camera: the newest one, posed by TF, cut into objects.

    Parameters
    ----------
    frame
        Of the robot, with z up.
    urdf
        Model of the robot, whose parts are no objects; empty if it is not known.
    """

    def __init__(self, frame: str, urdf: str = "") -> None:
        self.frame = frame
        self._warned: set[str] = set()
        self._model = self._model_of(urdf)
        self.camera = CameraTopics()
        self.transforms = Transforms()

    def _model_of(self, urdf: str) -> RobotModel | None:
        """Return the model; what of the body is not known is said in the log."""
        if not urdf:
            self._warn("there is no robot_description: nothing is known of the robot's own body")
            return None
        try:
            model = RobotModel(urdf)
        except UsageError as error:
            self._warn(str(error))
            return None
        for note in model.notes:
            self._warn(f"robot_description: {note}")
        return model

    def _warn(self, words: str) -> None:
        # Said once: a camera gives thirty views a second.
        if words not in self._warned:
            self._warned.add(words)
            log.warning("%s; parts of the robot may be taken for objects", words)

    def look(self, since: Any) -> View:
        """Return what the camera sees that is not older than a time.

        Raises
        ------
        RemoteUnavailableError, UsageError, DataError
            Nothing came, TF does not say where the camera was, or it shows no picture.
        """
        return self.view(self.camera.wait(_VIEW_S, since))

    def frames_at(self, stamp: Any) -> Callable[[str], NDArray[np.float64]]:
        """Return what looks up the pose (4, 4) of a frame at a time, in the frame of the robot."""

        def lookup(frame: str) -> NDArray[np.float64]:
            if frame == self.frame.lstrip("/"):
                return np.eye(4)
            return self.transforms.lookup(self.frame, frame, stamp)

        return lookup

    def view(self, sight: Sight[Frame]) -> View:
        """Return what a view shows; raises as :meth:`look` does."""
        stamp, camera = sight.header.stamp, sight.header.frame_id
        # Before the image is decoded: a view whose camera is nowhere costs nothing then.
        base_from_camera = self.transforms.lookup(self.frame, camera, stamp)
        frame = sight.read()
        shapes: list[JsonObject] = []
        if self._model is not None:
            shapes, unplaced = self._model.placed(self.frames_at(stamp), self.frame)
            if unplaced:
                self._warn(f"TF does not say where {', '.join(unplaced)} are")
        solids = body_of_json(shapes)
        body = body_pixels(frame.points(), base_from_camera, solids) if solids else None
        try:
            seen = perceive(frame, base_from_camera, body=body)
            return View(stamp, base_from_camera, seen, frame.doubts)
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
    scene
        MoveIt's, which grasps keep clear of; None to leave it aside.
    """

    def __init__(
        self,
        eyes: Eyes,
        client: Caller,
        options: SeeOptions,
        heard: Heard,
        scene: SceneSource | None = None,
    ) -> None:
        import rospy
        from visualization_msgs.msg import MarkerArray

        self._eyes, self._client, self._options, self._heard = eyes, client, options, heard
        self._markers = rospy.Publisher("rtask/objects", MarkerArray, queue_size=1, latch=True)
        change = type(make_message("moveit_msgs/PlanningScene"))
        self._topic = rospy.Publisher("rtask/planning_scene", change, queue_size=1, latch=True)
        self._scene = SceneExchange(scene, eyes.frames_at, eyes.frame, make_message)
        self._run: SeeRun | None = None
        self.server = self.serve("rtask/see", "rtask_msgs/SeeAction", self._execute)

    def serve(self, name: str, type_: str, execute: Callable[[Any], None]) -> Any:
        """Return a started server of an action that looks as this one does."""
        import actionlib

        server = actionlib.SimpleActionServer(name, type(make_message(type_)), execute, False)
        server.register_preempt_callback(self._cancel)
        server.start()
        return server

    def _cancel(self) -> None:
        if self._run is not None:
            self._run.cancel()

    def forget(self) -> None:
        """Forget former goals after a jump back in time."""
        forget_goals(self.server)

    def _execute(self, goal: Any) -> None:
        """Answer one goal."""
        result = make_message("rtask_msgs/SeeResult")
        look = self.examine(self.server, goal, result, self.server.publish_feedback)
        if isinstance(look, Look):
            self.show(look, result)
            self.server.set_succeeded(result)
        elif look is None:
            self.server.set_preempted(result, "cancelled")
        else:
            result.refused = refusal(look)
            self.server.set_aborted(result, result.refused)

    def examine(
        self, server: Any, goal: Any, result: Any, feedback: Callable[[Any], None]
    ) -> Look | RtaskError | None:
        """Put each object of a view to the graph; None if the goal was cancelled."""
        run = self._run = SeeRun(
            goal,
            lambda: self._eyes.look(goal.header.stamp).as_look(),
            self._client,
            self._options,
            make_message,
            self._heard,
            self._scene.obstacles,
        )
        # A goal may be cancelled before its run exists, when there was nothing to cancel yet.
        if server.is_preempt_requested():
            run.cancel()
        run.start()
        while True:
            item = run.events.get()
            if item is None or isinstance(item, RtaskError):
                return item
            if isinstance(item, Look):
                result.status, result.scene_notes = item.status, [*item.doubts, *run.notes]
                return item
            result.header = item.object.header
            result.objects.append(item.object)
            feedback(item)

    def show(self, look: Look, result: Any, target: int | None = None) -> None:
        """Show rviz and MoveIt the objects of a view, one of them as what is to be grasped."""
        self._markers.publish(markers(result, self._eyes.frame, make_message))
        self._topic.publish(self._scene.change(look, result.objects, target))


class SampleAction:
    """Action ``rtask/sample_grasp_poses``: the grasps of one object as poses with costs.

    Parameters
    ----------
    see
        Which examines the view, and shows MoveIt that the hand may touch the object.
    target
        Returns the name of the object where a goal names none; empty for the only one in view.
    """

    def __init__(self, see: SeeAction, target: Callable[[], str]) -> None:
        self._see, self._target = see, target
        self.server = see.serve(ACTION, "rtask_msgs/SampleGraspPosesAction", self._execute)

    def forget(self) -> None:
        """Forget former goals after a jump back in time."""
        forget_goals(self.server)

    def _execute(self, goal: Any) -> None:
        """Answer one goal."""
        result = make_message("rtask_msgs/SeeResult")
        answer = make_message("rtask_msgs/SampleGraspPosesResult")
        asked = sampling_goal(make_message)
        look = self._see.examine(self.server, asked, result, lambda item: None)
        if look is None:
            self.server.set_preempted(answer, "cancelled")
            return
        try:
            if isinstance(look, RtaskError):
                raise look
            name = "" if goal.action_name.strip("/").endswith(ACTION) else goal.action_name
            target = target_of(name or self._target(), result.objects)
            poses, costs = candidates(result.objects[target])
        except RtaskError as error:
            answer.grasp_state = refusal(error)
            self.server.set_aborted(answer, answer.grasp_state)
            return
        self._see.show(look, result, target)
        feedback = make_message("rtask_msgs/SampleGraspPosesFeedback")
        feedback.grasp_candidates, feedback.costs = poses, costs
        self.server.publish_feedback(feedback)
        threading.Event().wait(AGAIN_S)
        self.server.publish_feedback(feedback)
        seen = result.objects[target]
        answer.grasp_state = f"{len(poses)} grasps of {seen.name or 'unknown'}"
        if seen.grasps_left_out > 0:
            answer.grasp_state += f", {seen.grasps_left_out} more are left out"
        self.server.set_succeeded(answer)


def forget_goals(server: Any) -> None:
    """Forget the former goals of a server: actionlib recalls every one older than its last."""
    import actionlib
    import rospy

    with server.lock:
        if not server.is_active():
            server.current_goal = server.next_goal = actionlib.ServerGoalHandle()
        server.action_server.last_cancel = rospy.Time()
