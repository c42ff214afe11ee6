"""The goal of ``rtask/see``: each object of a view is put to the graph.

Knows neither rospy nor rclpy, and no camera: a front hands in how to look and takes the events.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from rtask.errors import RtaskError
from rtask.interop.ros.convert import JsonObject, Make, fill, stamp_json
from rtask.interop.ros.operations import Caller, Heard, refusal

__all__ = ["Board", "Look", "Obstacles", "SeeOptions", "SeeRun", "ViewedObject"]

_MAX_POINTS = 500
"""Most points of neighbours in a request."""


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
class ViewedObject:
    """One object of a view.

    Parameters
    ----------
    pose
        geometry_msgs/Pose of the middle of its box; z along the height.
    size
        Length, width and height of its box, m.
    data
        base64 of its crop of the view, as the operations take it.
    neighbours
        Points (n, 3) of what stands near it, m.
    """

    pose: JsonObject
    size: tuple[float, float, float]
    data: str
    neighbours: list[list[float]]


@dataclass(frozen=True)
class Board:
    """The visible part of a table as a box.

    Parameters
    ----------
    pose
        geometry_msgs/Pose of its middle.
    size
        Length, width and thickness, m.
    """

    pose: JsonObject
    size: tuple[float, float, float]


class Obstacles(Protocol):
    """What stands around beside what the camera sees, at the time of a view."""

    @property
    def notes(self) -> list[str]:
        """What of it does not count, in words."""

    def near(
        self, pose: Any, size: tuple[float, float, float], support_height: float, most: int
    ) -> list[list[float]]:
        """Return points (n, 3), m, near the box of an object, nearest first."""


@dataclass(frozen=True)
class Look:
    """What a camera saw at one time, in the frame of the robot.

    Parameters
    ----------
    stamp
        Time of the view, as ROS has it.
    sensor_pose
        geometry_msgs/Pose of the camera.
    status
        ``ok``, or why there are no objects: ``empty``, ``no_table``, ``table_only``.
    table_height
        m; NaN without a table.
    doubts
        Sentences about what of the view is doubtful, such as the unit of its depth.
    """

    stamp: Any
    sensor_pose: JsonObject
    status: str
    table_height: float
    table: Board | None
    objects: tuple[ViewedObject, ...]
    doubts: tuple[str, ...] = ()

    @classmethod
    def from_json(cls, data: Mapping[str, Any], stamp: Any, sensor_pose: JsonObject) -> Look:
        """Return what the server's service ``rtask/Segmentation/perceive`` answered."""
        height, table = data["table_height"], data["table"]
        return cls(
            stamp,
            sensor_pose,
            str(data["status"]),
            float("nan") if height is None else float(height),
            None if table is None else Board(table["pose"], _three(table["size"])),
            tuple(
                ViewedObject(
                    viewed["pose"], _three(viewed["size"]), viewed["cloud"], viewed["neighbours"]
                )
                for viewed in data["objects"]
            ),
            tuple(str(doubt) for doubt in data.get("doubts", ())),
        )


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


class SeeRun:
    """The answer to one goal: calls run in a thread, so that cancelling does not wait for them.

    :attr:`events` yields, in order, the feedback message of each object, then the :class:`Look`
    when all is done; an :class:`RtaskError` or None, when it was cancelled, ends it earlier.

    Parameters
    ----------
    goal
        Message of the goal.
    look
        Returns what the camera sees.
    client
        Of the server.
    make
        Makes empty messages.
    heard
        Called with the operation and the answer after each call.
    obstacles
        Returns what else stands around; None if nobody says. Where it raises, nothing is asked.
    """

    def __init__(
        self,
        goal: Any,
        look: Callable[[], Look],
        client: Caller,
        options: SeeOptions,
        make: Make,
        heard: Heard,
        obstacles: Callable[[Look], Obstacles | None] = lambda look: None,
    ) -> None:
        self.events: queue.Queue[Any] = queue.Queue()
        self.notes: list[str] = []
        self._obstacles = obstacles
        self._goal, self._look, self._client = goal, look, client
        self._options, self._make, self._heard = options, make, heard
        self._cancelled = threading.Event()

    def start(self) -> None:
        """Begin."""
        threading.Thread(target=self._work, daemon=True, name="rtask-see").start()

    def cancel(self) -> None:
        """End with None, whatever call is under way."""
        self._cancelled.set()
        self.events.put(None)

    def _work(self) -> None:
        try:
            look = self._look()
            around = self._obstacles(look) if look.objects else None
            self.notes = [] if around is None else around.notes
            for number, viewed in enumerate(look.objects, start=1):
                if self._cancelled.is_set():
                    return
                feedback = self._make("rtask_msgs/SeeFeedback")
                feedback.number, feedback.count = number, len(look.objects)
                feedback.object = self._ask(look, viewed, number, around)
                self.events.put(feedback)
            self.events.put(look)
        except RtaskError as error:
            self.events.put(error)
        finally:
            # Whatever ended this thread must not leave the goal without an end.
            self.events.put(RtaskError("the view could not be examined; see the log of the node"))

    def _ask(self, look: Look, viewed: ViewedObject, number: int, around: Obstacles | None) -> Any:
        """Return what the graph knows of one object; an error of the server is part of it."""
        make = self._make
        seen = make("rtask_msgs/SeenObject")
        seen.header.stamp, seen.header.frame_id = look.stamp, self._options.frame
        seen.label = number
        fill(seen.pose, viewed.pose, make)
        seen.size.x, seen.size.y, seen.size.z = viewed.size
        try:
            request = self._request(look, viewed, around)
            answer = self._client.call("recognise_for_grasp", **request)
        except RtaskError as error:
            seen.task_response, seen.error = "error", refusal(error)
            return seen
        self._heard("recognise_for_grasp", answer)
        seen.task_response, seen.task_id = answer["task_response"], answer["task_id"]
        seen.object, seen.name = answer["object"], answer["label"]
        seen.class_name, seen.class_iri = answer["class"], answer["class_iri"]
        seen.confidence = float(answer["confidence"])
        alike = _most_alike(answer)
        seen.view, seen.picture = alike.get("view", ""), alike.get("picture", "")
        seen.grasps = [fill(make("moveit_msgs/Grasp"), grasp, make) for grasp in answer["grasps"]]
        seen.grasps_left_out = answer.get("grasps_left_out", -1)  # older servers do not say
        return seen

    def _request(self, look: Look, viewed: ViewedObject, around: Obstacles | None) -> JsonObject:
        options, goal = self._options, self._goal
        table = options.table_height
        support = look.table_height if table is None else table
        neighbours = viewed.neighbours
        if around is not None:
            left = _MAX_POINTS - len(neighbours)
            neighbours = [*neighbours, *around.near(viewed.pose, viewed.size, support, left)]
        asked: JsonObject = {
            "gripper_id": goal.gripper_id or options.gripper_id,
            "data": viewed.data,
            "sensor_pose": look.sensor_pose,
            "frame_id": options.frame,
            "support_height": support,
            "stamp": stamp_json(look.stamp),
            "propose": bool(goal.propose),
            "neighbours": neighbours,
        }
        least = [*goal.min_confidence, options.min_confidence][0]
        optional = {
            "task": goal.task or None, "max_grasps": int(goal.max_grasps) or None,
            "min_confidence": least,
        }  # fmt: skip
        return {**asked, **{name: value for name, value in optional.items() if value is not None}}


def _most_alike(answer: JsonObject) -> JsonObject:
    """Return the match that the object was recognised by, or else the best; empty for none."""
    matches: list[JsonObject] = answer["recognition"]["matches"]
    same = [match for match in matches if match["object"] == answer["object"]]
    return next(iter(same or matches), {})
