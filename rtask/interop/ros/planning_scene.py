"""Planning scene of MoveIt from a view: the table and each object as a box.

An arm that MoveIt moves then stays clear of them. Objects are called by their IRI in the graph, so
that a program which asked about one knows its name in the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from features.geometry import FloatArray
from rtask.interop.ros.package import make_message

__all__ = ["TABLE", "SceneTopic", "scene_id"]

TABLE = "rtask/table"
_THICK_M = 0.02
_BOX = 1
_ADD, _REMOVE = 0, 1


def scene_id(object_iri: str, number: int, taken: Sequence[str]) -> str:
    """Return the name of an object of a view in the scene.

    Parameters
    ----------
    object_iri
        Empty for an unknown object.
    number
        Of the object in the view.
    taken
        Names of other objects of the view: two cans of one kind are one object of the graph.

    Examples
    --------
    >>> scene_id("", 2, [])
    'rtask/unknown-2'
    >>> scene_id("https://example.org/can", 3, ["https://example.org/can"])
    'https://example.org/can#3'
    """
    name = object_iri or f"rtask/unknown-{number}"
    return f"{name}#{number}" if name in taken else name


class SceneTopic:
    """Latched topic ``rtask/planning_scene``: each view as a change of MoveIt's scene.

    What the view before showed and this one does not is removed; nothing else of the scene is
    touched. MoveIt listens to ``planning_scene``.
    """

    def __init__(self, frame: str) -> None:
        import rospy

        self._frame = frame
        self._shown: tuple[str, ...] = ()
        kind = type(make_message("moveit_msgs/PlanningScene"))
        self._topic = rospy.Publisher("rtask/planning_scene", kind, queue_size=1, latch=True)

    def publish(
        self, header: Any, table: FloatArray, height: float, objects: Sequence[tuple[str, Any]]
    ) -> None:
        """Show a view.

        Parameters
        ----------
        header
            Time of the view.
        table : (k, 2) float, m
            Corners of the visible table; empty without one.
        height
            Of the table, m.
        objects
            Name in the scene and ``rtask_msgs/SeenObject`` of each.
        """
        scene = make_message("moveit_msgs/PlanningScene")
        scene.is_diff = scene.robot_state.is_diff = True
        shown = [_collision_box(name, box.pose, _sides(box.size), box) for name, box in objects]
        if len(table) >= 3 and np.isfinite(height):
            shown.append(_collision_box(TABLE, *_table(table, height)))
        names = tuple(box.id for box in shown)
        gone = [_named(name, _REMOVE) for name in self._shown if name not in names]
        for box in (*shown, *gone):
            box.header.stamp, box.header.frame_id = header.stamp, self._frame
        scene.world.collision_objects = [*gone, *shown]
        scene.object_colors = list(_colours(names))
        self._shown = names
        self._topic.publish(scene)


def _named(name: str, operation: int) -> Any:
    collision_object = make_message("moveit_msgs/CollisionObject")
    collision_object.id, collision_object.operation = name, operation
    return collision_object


def _collision_box(name: str, pose: Any, sides: tuple[float, ...], seen: Any = None) -> Any:
    """Return a box (m) as moveit_msgs/CollisionObject."""
    collision = _named(name, _ADD)
    if seen is not None:
        collision.type.key, collision.type.db = seen.class_iri, "rtask"
    box = make_message("shape_msgs/SolidPrimitive")
    box.type, box.dimensions = _BOX, list(sides)
    collision.primitives = [box]
    inner = make_message("geometry_msgs/Pose")
    inner.orientation.w = 1.0
    if hasattr(collision, "pose"):
        collision.pose, collision.primitive_poses = pose, [inner]
    else:  # before MoveIt of ROS Noetic
        collision.primitive_poses = [pose]
    return collision


def _sides(size: Any) -> tuple[float, float, float]:
    return size.x, size.y, size.z


def _table(corners: FloatArray, height: float) -> tuple[Any, tuple[float, float, float]]:
    """Return pose and sides of the smallest board below the visible table."""
    (x, y), (length, width), degrees = cv2.minAreaRect(np.asarray(corners, dtype=np.float32))
    pose = make_message("geometry_msgs/Pose")
    pose.position.x, pose.position.y, pose.position.z = float(x), float(y), height - _THICK_M / 2
    half = np.deg2rad(degrees) / 2
    pose.orientation.z, pose.orientation.w = float(np.sin(half)), float(np.cos(half))
    return pose, (float(length), float(width), _THICK_M)


def _colours(names: Sequence[str]) -> Iterator[Any]:
    for name in names:
        colour = make_message("moveit_msgs/ObjectColor")
        colour.id = name
        colour.color.r, colour.color.g, colour.color.b = (
            (0.6, 0.5, 0.4) if name == TABLE else (0.2, 0.5, 1)
        )
        colour.color.a = 0.7
        yield colour
