"""Messages that show rviz and MoveIt what was seen; knows neither rospy nor rclpy.

An arm that MoveIt moves then stays clear of the table and its objects. Objects are called by their
IRI in the graph, so that a program which asked about one knows its name in the scene.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rtask.interop.ros.convert import Make, fill
from rtask.interop.ros.looking import Look
from rtask.interop.ros.scene.matrix import CollisionMatrix
from rtask.interop.ros.scene.obstacles import OURS

__all__ = ["TABLE", "SceneChanges", "markers", "scene_id"]

TABLE = "rtask/table"
_BOX = 1
_ADD, _REMOVE = 0, 1
_COLOURS = {
    "grasp": (0.1, 0.8, 0.2), "candidate": (0.2, 0.5, 1.0), "no_grasp": (1.0, 0.7, 0.1),
}  # fmt: skip
_GREY = (0.6, 0.6, 0.6)


def markers(result: Any, frame: str, make: Make) -> Any:
    """Return a visualization_msgs/MarkerArray with a box and a name for each object."""
    shown = make("visualization_msgs/MarkerArray")
    shown.markers = [
        _marker("DELETEALL", result.header, frame, make),
        *_boxes(result.objects, frame, make),
    ]
    return shown


def _boxes(objects: Iterable[Any], frame: str, make: Make) -> Iterator[Any]:
    for k, seen in enumerate(objects):
        box = _marker("CUBE", seen.header, frame, make)
        box.ns, box.id, box.pose, box.scale = "objects", k, seen.pose, seen.size
        box.color.r, box.color.g, box.color.b = _COLOURS.get(seen.task_response, _GREY)
        box.color.a = 0.5
        yield box
        name = _marker("TEXT_VIEW_FACING", seen.header, frame, make)
        name.ns, name.id = "names", k
        name.pose.position.x, name.pose.position.y = seen.pose.position.x, seen.pose.position.y
        name.pose.position.z = seen.pose.position.z + seen.size.z / 2 + 0.03
        name.pose.orientation.w = 1.0
        name.scale.z, name.color.a = 0.03, 1.0
        name.color.r = name.color.g = name.color.b = 1.0
        name.text = f"{seen.name or '?'} {seen.confidence:.2f}"
        yield name


def _marker(kind: str, header: Any, frame: str, make: Make) -> Any:
    marker = make("visualization_msgs/Marker")
    names = type(marker)
    marker.action = names.DELETEALL if kind == "DELETEALL" else names.ADD
    marker.header.stamp, marker.header.frame_id = header.stamp, frame
    marker.type = getattr(names, kind) if kind != "DELETEALL" else 0
    return marker


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


class SceneChanges:
    """Each view as a change of MoveIt's scene, moveit_msgs/PlanningScene.

    What the view before showed and this one does not is removed; nothing else of the scene is
    touched.

    Parameters
    ----------
    hand_links
        Links of the hand, as MoveIt names them. With them, and where the scene's own matrix of
        allowed collisions is known, the change carries that matrix: objects may touch the table
        they stand on, and the hand what it is going to grasp.
    """

    def __init__(self, frame: str, make: Make, hand_links: Sequence[str] = ()) -> None:
        self._frame, self._make, self._hand = frame, make, tuple(hand_links)
        self._shown: tuple[str, ...] = ()
        self._pairs: list[tuple[str, str]] = []

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of what the last view put into the scene."""
        return self._shown

    def change(
        self,
        look: Look,
        objects: Sequence[Any],
        matrix: CollisionMatrix | None = None,
        target: int | None = None,
    ) -> Any:
        """Return the change that shows a view.

        The grasps of each object are told that they may touch it and the table.

        Parameters
        ----------
        objects
            ``rtask_msgs/SeenObject`` of each object.
        matrix
            Of the scene. MoveIt replaces the whole of it by that of a change, so that without it
            the change has none.
        target
            Place among the objects of the one to be grasped; by default the only one with grasps.
        """
        make, names = self._make, list[str]()
        former = self._shown
        scene = make("moveit_msgs/PlanningScene")
        scene.is_diff = scene.robot_state.is_diff = True
        shown = []
        for seen in objects:
            names.append(scene_id(seen.object, seen.label, names))
            size = (seen.size.x, seen.size.y, seen.size.z)
            shown.append(self._box(names[-1], seen.pose, size))
            shown[-1].type.key, shown[-1].type.db = seen.class_iri, OURS
        if look.table is not None:
            pose = fill(make("geometry_msgs/Pose"), look.table.pose, make)
            shown.append(self._box(TABLE, pose, look.table.size))
            shown[-1].type.db = OURS
        supports = [TABLE] if look.table is not None else []
        for name, seen in zip(names, objects, strict=True):
            for grasp in seen.grasps:
                grasp.allowed_touch_objects = [name, *supports]
        ids = tuple(box.id for box in shown)
        gone = [self._named(name, _REMOVE) for name in self._shown if name not in ids]
        for box in (*shown, *gone):
            box.header.stamp, box.header.frame_id = look.stamp, self._frame
        scene.world.collision_objects = [*gone, *shown]
        scene.object_colors = list(self._colours(ids))
        self._shown = ids
        if matrix is not None and self._hand:
            graspable = [place for place, seen in enumerate(objects) if seen.grasps]
            if target is None and len(graspable) == 1:
                target = graspable[0]
            pairs = [(name, support) for name in names for support in supports]
            if target is not None:
                pairs += [(link, names[target]) for link in self._hand]
            changed = matrix.with_pairs(pairs, self._pairs, set(former) - set(ids))
            scene.allowed_collision_matrix, self._pairs = changed.message(make), pairs
        return scene

    def _named(self, name: str, operation: int) -> Any:
        made = self._make("moveit_msgs/CollisionObject")
        # rosidl carries a byte as bytes, genpy as a number.
        is_bytes = isinstance(made.operation, bytes)
        made.id, made.operation = name, bytes([operation]) if is_bytes else operation
        return made

    def _box(self, name: str, pose: Any, sides: tuple[float, ...]) -> Any:
        """Return a box (m) as moveit_msgs/CollisionObject."""
        collision = self._named(name, _ADD)
        box = self._make("shape_msgs/SolidPrimitive")
        box.type, box.dimensions = _BOX, list(sides)
        collision.primitives = [box]
        inner = self._make("geometry_msgs/Pose")
        inner.orientation.w = 1.0
        if hasattr(collision, "pose"):
            collision.pose, collision.primitive_poses = pose, [inner]
        else:  # before MoveIt of ROS Noetic
            collision.primitive_poses = [pose]
        return collision

    def _colours(self, names: Sequence[str]) -> Iterator[Any]:
        for name in names:
            colour = self._make("moveit_msgs/ObjectColor")
            colour.id = name
            colour.color.r, colour.color.g, colour.color.b = (
                (0.6, 0.5, 0.4) if name == TABLE else (0.2, 0.5, 1.0)
            )
            colour.color.a = 0.7
            yield colour
