"""What of MoveIt's planning scene an arm keeps clear of on its way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rtask.errors import RobotError
from rtask.interop.ros.convert import make_message, time_like
from rtask.interop.ros.scene.obstacles import SceneObstacles
from rtask.interop.ros.scene.shapes import Solid
from simulate.motion.collision import Obstacle, PointField
from simulate.robots.description import Floats

__all__ = ["obstacles_of", "scene_of"]

_ON_TABLE_M, _SAMPLES_M = 0.01, 0.01
_UPRIGHT = 0.99
_WAIT_S = 2.0


def scene_of(node: Any, base: str) -> SceneObstacles | None:
    """Return what stands around by the scene of a move_group; None where there is none.

    Parameters
    ----------
    node
        Of ROS 2, whose callbacks run in other threads.
    base
        Frame of the robot in which motions are planned.

    Raises
    ------
    RtaskError
        MoveIt does not answer, part of its scene cannot be read, or TF does not say where it is.
    """
    from rclpy.callback_groups import ReentrantCallbackGroup
    from tf2_msgs.msg import TFMessage

    from rtask.ros2.qos import events, latched
    from rtask.ros2.scene import SceneClient
    from rtask.ros2.transforms import TransformBuffer

    group, transforms = ReentrantCallbackGroup(), TransformBuffer()
    heard = [
        node.create_subscription(
            TFMessage, "/tf", transforms.take, events(100), callback_group=group
        ),
        node.create_subscription(
            TFMessage, "/tf_static", lambda message: transforms.take(message, is_static=True),
            latched(100), callback_group=group,
        ),
    ]  # fmt: skip
    client = SceneClient(node, group, ())
    try:
        client.client.wait_for_service(timeout_sec=_WAIT_S)
        now = divmod(node.get_clock().now().nanoseconds, 10**9)
        stamp = time_like(make_message("builtin_interfaces/Time"), *now)

        def lookup(frame: str) -> Floats:
            if frame.lstrip("/") == base:
                return np.eye(4)
            return np.array(transforms.lookup(base, frame, stamp, _WAIT_S).as_matrix())

        return client.source.obstacles(client.source.newest(), lookup, None)
    finally:
        node.destroy_client(client.client)
        for subscription in (*heard, client.subscription):
            node.destroy_subscription(subscription)


def obstacles_of(
    scene: SceneObstacles,
    table_height: float,
    goal: tuple[float, float, float],
    say: Callable[[str], None],
) -> list[Obstacle | PointField]:
    """Return what an arm can hit of a scene, and say what of it does not count.

    Parameters
    ----------
    table_height
        m, base frame; what is no higher than 1 cm over it is the table, which plans know.
    goal
        Position to be reached, m, base frame; what is there is what is reached for.

    Raises
    ------
    RobotError
        A shape that no plan keeps clear of: a plane that is not the floor or the table.
    """
    made: list[Obstacle | PointField] = []
    for note in scene.notes:
        say(f"MoveIt's planning scene: {note}")
    for name, solid, pose in scene.solids():
        local = np.linalg.inv(pose) @ np.array([*goal, 1.0])
        if solid.kind == "plane":
            _check_floor(name, solid, pose, table_height)
        elif _top(solid, pose) <= table_height + _ON_TABLE_M:
            continue
        elif solid.distance(local[None, :3])[0] < 0:
            say(f"MoveIt's planning scene: {name} is at the goal, and is what is reached for")
        else:
            made += _obstacles(name, solid, pose)
    return made


def _obstacles(name: str, solid: Solid, pose: Floats) -> Iterator[Obstacle | PointField]:
    turn, centre = pose[:3, :3], pose[:3, 3]
    if solid.kind == "mesh":
        middle, radius = solid.ball()
        points = solid.samples(middle - radius, middle + radius, _SAMPLES_M)
        try:
            yield PointField.of(name, points @ turn.T + centre)
        except ValueError as error:
            raise RobotError(f"{name} of MoveIt's planning scene: {error}") from error
    elif solid.kind == "sphere":
        yield Obstacle(name, centre, np.zeros(3), turn, radius=solid.size[0])
    elif solid.kind == "box":
        yield Obstacle(name, centre, np.array(solid.size) / 2, turn)
    else:  # a cylinder, or the one around a cone
        height, radius = solid.size
        half = np.array([radius, radius, height / 2])
        yield Obstacle(name, centre, half, turn, is_cylinder=True)


def _top(solid: Solid, pose: Floats) -> float:
    """Return the height of the highest point of a solid, m."""
    up = pose[2, :3]
    if solid.corners is not None:
        return float((solid.corners.reshape(-1, 3) @ up).max() + pose[2, 3])
    if solid.kind == "sphere":
        return float(pose[2, 3] + solid.size[0])
    if solid.kind == "box":
        return float(pose[2, 3] + np.abs(up) @ (np.array(solid.size) / 2))
    height, radius = solid.size
    return float(pose[2, 3] + abs(up[2]) * height / 2 + np.hypot(up[0], up[1]) * radius)


def _check_floor(name: str, solid: Solid, pose: Floats, table_height: float) -> None:
    normal = pose[:3, :3] @ np.array(solid.size[:3])
    height = pose[2, 3] - solid.size[3] * normal[2]
    if abs(normal[2]) < _UPRIGHT or height > table_height + _ON_TABLE_M:
        raise RobotError(
            f"{name} of MoveIt's planning scene is a plane, which plans cannot keep clear of"
        )
