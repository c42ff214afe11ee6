"""One frame of the simulated robot before its table, as messages and as a recording."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from features.perception import perceive
from rtask.interop.ros.robot.body import body_of_json, body_pixels
from rtask.interop.ros.robot.model import RobotModel
from simulate.act.commands import lay_objects
from simulate.grasping.executor import Workcell
from simulate.motion.collision import link_poses
from simulate.robots.urdf_reader import read_urdf
from simulate.ros.rclpy_front import RclpyFront
from simulate.ros.sensors import Rates, Sensors
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from tests.rtask.ros2.standin import World

OBJECTS, SHOWS_PX = 4, 150
TOPICS = {
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "robot_description": "std_msgs/msg/String",
    "CameraDepth3_frame/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "CameraDepth3_frame/depth/image_raw": "sensor_msgs/msg/Image",
    "CameraDepth3_frame/rgb/image_raw": "sensor_msgs/msg/Image",
}
LIVE = dict(
    zip(
        TOPICS,
        ("/tf_static", "/tf", "robot_description", "~/camera_info", "~/depth", "~/image"),
        strict=True,
    )
)
Messages = list[tuple[str, Any]]


@dataclass(frozen=True)
class Taken:
    """A frame.

    Parameters
    ----------
    messages
        Of its topics, in their order.
    in_view
        How many of the objects that lie there show in it.
    direct
        How many are perceived in a frame of the same moment, without ROS.
    """

    messages: Messages
    in_view: int
    direct: int


def take_frame(world: World, assets: Path, seed: int) -> Taken:
    """Return one frame of the Nao that looks at its table."""
    node = sys.modules["rclpy.lifecycle"].LifecycleNode("body")
    with Workcell("nao", preset="fast") as cell:
        before = cell.world.client.getNumBodies()
        lay_objects(cell, OBJECTS, seed, assets)
        bodies = range(before, cell.world.client.getNumBodies())
        cell.robot.look("right")
        cell.world.step(0.5)
        sensors = Sensors(RclpyFront(node), cell.robot, Rates(), is_clock=True)
        for topic in TOPICS:
            world.publishers[topic].listeners = 1
        sensors.tick()
        messages = [(topic, world.publishers[topic].messages.get_nowait()) for topic in TOPICS]
        numbers, count = _direct(cell, dict(messages)["robot_description"].data, assets)
        shown = sum(int((numbers == body).sum()) >= SHOWS_PX for body in bodies)
    return Taken(messages, shown, count)


def _direct(cell: Workcell, urdf: str, folder: Path) -> tuple[Any, int]:
    """Return the body behind each pixel, and how many objects are perceived without ROS."""
    robot, base_from_camera = cell.robot, cell.robot.base_from_camera()
    camera = Camera(robot.world.client)
    frame, numbers = camera.capture(robot.world_from_base @ base_from_camera, Lighting())
    frame = SensorNoise().apply(frame, np.random.default_rng(0))
    file = folder / "model.urdf"
    file.write_text(urdf, "utf-8")
    read = read_urdf(file, strict=False)
    moved = link_poses(read.root, read.joints, robot.joint_values())
    base = robot.description.base_from_root.matrix
    poses = {read.root: base, **{name: base @ pose for name, pose in moved.items()}}
    shapes, unplaced = RobotModel(urdf).placed(poses.__getitem__, "base_footprint")
    assert not unplaced
    body = body_pixels(frame.points(), base_from_camera, body_of_json(shapes))
    return numbers, len(perceive(frame, base_from_camera, body=body).objects)


def write_recording(folder: Path, messages: Messages, world: World) -> Path:
    """Write messages as MCAP and return the folder."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number, (topic, message) in enumerate(messages):
            name = topic if topic.startswith("/") else f"/{topic}"
            made = writer.add_connection(name, TOPICS[topic], typestore=world.types.store)
            writer.write(made, 10**9 + number, world.types.encode(message, TOPICS[topic]))
    return folder
