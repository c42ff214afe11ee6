"""The world of the graph as markers for rviz; knows neither rospy nor rclpy."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rtask.errors import RtaskError
from rtask.interop.ros.convert import Make, fill

__all__ = ["WORLD_TOPIC", "WorldDisplay", "world_markers"]

log = logging.getLogger(__name__)

WORLD_TOPIC = "rtask/world"
# Constants of visualization_msgs/Marker; messages made of definitions alone have none.
_ARROW, _CUBE, _SPHERE, _CYLINDER, _LINES, _TEXT = 0, 1, 2, 3, 5, 9
_DELETE_ALL = 3
_AXIS_M, _LINE_M, _TEXT_M, _DOT_M, _FLAT_M = 0.15, 0.006, 0.05, 0.05, 0.002
_AXES = ((1.0, 0.1, 0.1), (0.1, 0.8, 0.1), (0.2, 0.4, 1.0))
_PLACE, _CORNERS = (0.7, 0.6, 0.5), ((-1, -1), (1, -1), (1, 1), (-1, 1))
_THING, _ROBOT, _DOUBT, _WHITE = (0.2, 0.5, 1.0), (0.9, 0.6, 0.1), (1.0, 0.8, 0.2), (1.0,) * 3


def world_markers(scene: Mapping[str, Any], make: Make) -> Any:
    """Return a visualization_msgs/MarkerArray of what is where.

    Frames are axes, robots are arrows, tables and boxes are plates of their size, and things are
    boxes of theirs, the paler the less sure it is that they are still there, above a disc within
    which they then are with a chance of 90 %. The stamp is zero: rviz takes the latest transform
    of the root.

    Parameters
    ----------
    scene
        Answer of the operation ``show_world``.
    make
        Makes empty messages.
    """
    shown = make("visualization_msgs/MarkerArray")
    cleared = make("visualization_msgs/Marker")
    cleared.action, cleared.header.frame_id = _DELETE_ALL, scene["frame_id"]
    shown.markers = [cleared]
    beside: dict[str, int] = {}
    for number, node in enumerate(scene["nodes"]):
        if node.get("somewhere"):  # an older server does not say so
            above = beside.setdefault(repr(node["pose"]), 0)
            beside[repr(node["pose"])] += 1
            node = {**node, "above": above}
        for marker in _NODES.get(node["kind"], _unknown)(node, make):
            marker.header.frame_id, marker.id = scene["frame_id"], number
            shown.markers.append(marker)
    return shown


def _frame(node: Mapping[str, Any], make: Make) -> Iterator[Any]:
    axes = _marker(make, "frames", _LINES, _WHITE, 1.0, node["pose"])
    axes.scale.x = _LINE_M
    for axis, colour in zip("xyz", _AXES, strict=True):
        for reach in (0.0, _AXIS_M):
            point = make("geometry_msgs/Point")
            setattr(point, axis, reach)
            axes.points.append(point)
            axes.colors.append(_paint(make("std_msgs/ColorRGBA"), colour, 1.0))
    yield axes
    yield _label(make, "frame names", node, _TEXT_M)


def _robot(node: Mapping[str, Any], make: Make) -> Iterator[Any]:
    arrow = _marker(make, "robots", _ARROW, _ROBOT, 0.9, node["pose"])
    arrow.scale.x, arrow.scale.y, arrow.scale.z = 2 * _AXIS_M, _TEXT_M, _TEXT_M
    yield arrow
    yield _label(make, "robot names", node, 2 * _TEXT_M)


def _place(node: Mapping[str, Any], make: Make) -> Iterator[Any]:
    if not node["size"]:
        return
    length, width, rim = (float(side) for side in node["size"])
    plate = _marker(make, "places", _CUBE, _PLACE, 0.6, node["pose"])
    plate.scale.x, plate.scale.y, plate.scale.z = length, width, _FLAT_M
    yield plate
    if rim > 0:
        walls = _marker(make, "rims", _LINES, _PLACE, 1.0, node["pose"])
        walls.scale.x = _LINE_M
        corners = [(a * length / 2, b * width / 2) for a, b in _CORNERS]
        for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True):
            for ends in (((x, y, 0.0), (x, y, rim)), ((x, y, rim), (u, v, rim))):
                for end in ends:
                    point = make("geometry_msgs/Point")
                    point.x, point.y, point.z = end
                    walls.points.append(point)
        yield walls


def _unknown(_node: Mapping[str, Any], _make: Make) -> Iterator[Any]:
    """Draw nothing for a kind of a newer server."""
    return iter(())


def _somewhere(node: Mapping[str, Any], make: Make) -> Iterator[Any]:
    """Draw the place in which a thing is, and its name, above those of others in there."""
    if node["region"]:
        length, width, rim = (float(side) for side in node["region"])
        outline = _marker(make, "regions", _LINES, _DOUBT, 0.6, node["pose"])
        outline.scale.x = _LINE_M
        corners = [(a * length / 2, b * width / 2) for a, b in _CORNERS]
        for end in zip(corners, corners[1:] + corners[:1], strict=True):
            for x, y in end:
                point = make("geometry_msgs/Point")
                point.x, point.y, point.z = x, y, rim
                outline.points.append(point)
        yield outline
    up_m = _TEXT_M * (2 + 1.2 * node["above"])
    more = f": {node['somewhere']} {float(node['still_there']):.0%}"
    yield _label(make, "thing names", node, up_m, more)


def _thing(node: Mapping[str, Any], make: Make) -> Iterator[Any]:
    if node.get("somewhere"):
        yield from _somewhere(node, make)
        return
    size = node["size"] or [_DOT_M] * 3
    sure = min(max(float(node["still_there"]), 0.0), 1.0)
    kind = _CUBE if node["size"] else _SPHERE
    body = _marker(make, "things", kind, _THING, 0.2 + 0.7 * sure, node["pose"])
    body.scale.x, body.scale.y, body.scale.z = (max(float(side), _FLAT_M) for side in size)
    x, y, z = _up(node["pose"]["orientation"], body.scale.z / 2)
    body.pose.position.x += x
    body.pose.position.y += y
    body.pose.position.z += z
    yield body
    if node["radius90"] is not None:
        disc = _marker(make, "uncertainty", _CYLINDER, _DOUBT, 0.3, node["pose"])
        disc.scale.x = disc.scale.y = max(2.0 * float(node["radius90"]), _FLAT_M)
        disc.scale.z = _FLAT_M
        yield disc
    yield _label(make, "thing names", node, size[2] + _TEXT_M, f" {sure:.0%}")


_NODES: Mapping[str, Callable[[Mapping[str, Any], Make], Iterator[Any]]] = {
    "frame": _frame, "robot": _robot, "place": _place, "thing": _thing,
}  # fmt: skip


def _marker(
    make: Make, namespace: str, kind: int, colour: tuple[float, ...], alpha: float, pose: Any
) -> Any:
    marker = make("visualization_msgs/Marker")
    marker.ns, marker.type = namespace, kind
    marker.pose = fill(make("geometry_msgs/Pose"), pose, make)
    _paint(marker.color, colour, alpha)
    return marker


def _label(make: Make, namespace: str, node: Mapping[str, Any], up_m: float, more: str = "") -> Any:
    label = _marker(make, namespace, _TEXT, _WHITE, 1.0, node["pose"])
    label.pose.position.z += up_m
    label.scale.z, label.text = _TEXT_M, f"{node['label']}{more}"
    return label


def _paint(colour: Any, rgb: tuple[float, ...], alpha: float) -> Any:
    colour.r, colour.g, colour.b = rgb
    colour.a = alpha
    return colour


def _up(turn: Mapping[str, float], length_m: float) -> tuple[float, float, float]:
    """Return the z axis of a frame, given its quaternion, times a length."""
    x, y, z, w = (float(turn[name]) for name in "xyzw")
    return (
        2 * (x * z + w * y) * length_m,
        2 * (y * z - w * x) * length_m,
        (1 - 2 * (x * x + y * y)) * length_m,
    )


class WorldDisplay:
    """Keeps a latched topic of markers up to date while somebody listens.

    Parameters
    ----------
    ask
        Returns the answer of ``show_world``.
    publish
        Takes the markers.
    is_heard
        Whether anybody subscribes to the topic.
    """

    def __init__(
        self,
        ask: Callable[[], Mapping[str, Any]],
        publish: Callable[[Any], None],
        is_heard: Callable[[], bool],
        make: Make,
    ) -> None:
        self._ask, self._publish, self._is_heard, self._make = ask, publish, is_heard, make
        self._shown: object = None
        self._thread: threading.Thread | None = None

    def refresh(self) -> None:
        """Ask for the world in a thread of its own, and publish it if it has changed."""
        is_busy = self._thread is not None and self._thread.is_alive()
        if is_busy or not self._is_heard():
            return
        self._thread = threading.Thread(target=self._run, daemon=True, name="rtask-world")
        self._thread.start()

    def wait(self, timeout_s: float) -> None:
        """Wait for the end of what :meth:`refresh` began."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            scene = self._ask()
        except RtaskError as error:
            log.warning("%s: %s; what it shows stays as it was", WORLD_TOPIC, error)
            return
        # Certainty falls with each second; a percent of it is all that can be seen.
        shown = (scene["frame_id"], [_visible(node) for node in scene["nodes"]])
        if shown != self._shown:
            self._publish(world_markers(scene, self._make))
            self._shown = shown


def _visible(node: Mapping[str, Any]) -> tuple[Any, ...]:
    radius = node["radius90"]
    return (
        node["node"], node["label"], node["pose"], node["size"], round(node["still_there"], 2),
        None if radius is None else round(radius, 3),
    )  # fmt: skip
