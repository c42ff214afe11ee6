"""Publishers of a simulated robot: joints, TF, camera and clock, as of real drivers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from grasp.messages import pose_message
from rtask.interop.ros.clouds import cloud_message
from rtask.interop.ros.convert import bytes_like, fill, make_message
from simulate.motion.collision import link_poses
from simulate.robots.description import Inertial, Joint, Link, Pose, RobotDescription, Shape
from simulate.robots.urdf import urdf_text
from simulate.ros.front import Front
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.robot_body import RobotBody

__all__ = ["Rates", "Sensors"]

_JPEG_QUALITY = 90
_BIN = Inertial(0.2, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))


@dataclass(frozen=True)
class Rates:
    """Messages per second of the robot's time."""

    joints_hz: float = 20.0
    frames_hz: float = 5.0


class Sensors:
    """Publishers of one simulated robot; all are called from the thread of the physics.

    Topics are relative, so that a namespace tells robots apart; ``/joint_states``, ``/tf`` and
    ``/clock`` are absolute, as on real robots. Clouds and images are rendered only while somebody
    subscribes. The frames have the names of drivers of Xtion and Kinect, and those that the
    simulated sensor has in Gatto 2016, 1.5: ``CameraDepth3_frame/rgb/image_raw`` and so on.

    Parameters
    ----------
    front
        ROS.
    robot
        The body.
    rates
        How often.
    is_clock
        Publish simulated time on ``/clock``, and stamp with it.
    prefix
        Before the names of all frames, ``nao1/``; empty for one robot.
    """

    def __init__(
        self,
        front: Front,
        robot: RobotBody,
        rates: Rates,
        is_clock: bool = False,
        prefix: str = "",
    ) -> None:
        self._front = front
        self._robot, self._rates, self._prefix = robot, rates, prefix
        self._camera = Camera(robot.world.client)
        self._noise, self._rng = SensorNoise(), np.random.default_rng(0)
        self._next_joints = self._next_frame = 0.0
        self._joints_stamp: Any = None
        camera, gazebo = "camera/rgb", f"{next(iter(robot.description.cameras))}_frame"
        self._clock = front.publisher("/clock", "rosgraph_msgs/Clock") if is_clock else None
        self._joints = front.publisher("/joint_states", "sensor_msgs/JointState")
        self._tf = front.publisher("/tf", "tf2_msgs/TFMessage")
        self._clouds = [
            front.publisher(name, "sensor_msgs/PointCloud2")
            for name in ("camera/depth_registered/points", f"{gazebo}/depth/points")
        ]
        self._image = front.publisher(
            f"{camera}/image_raw/compressed", "sensor_msgs/CompressedImage"
        )
        self._colour = front.publisher(f"{gazebo}/rgb/image_raw", "sensor_msgs/Image")
        self._depth = front.publisher(f"{gazebo}/depth/image_raw", "sensor_msgs/Image")
        self._infos = [
            front.publisher(f"{space}/camera_info", "sensor_msgs/CameraInfo", is_latched=True)
            for space in (camera, f"{gazebo}/rgb", f"{gazebo}/depth")
        ]
        for info in self._infos:
            info.publish(self._camera_info())
        self._fixed = front.publisher("/tf_static", "tf2_msgs/TFMessage", is_latched=True)
        self._fixed.publish(_transforms(self._fixed_transforms()))
        front.describe(urdf_text(self._with_bins(), frames=True))

    def now(self) -> Any:
        """Return the time with which to stamp: simulated if the clock is published."""
        return self._front.stamp(None if self._clock is None else self._robot.world.time)

    def tick(self) -> None:
        """Publish what is due at the robot's present time."""
        time, stamp = self._robot.world.time, self.now()
        if self._clock is not None:
            clock = make_message("rosgraph_msgs/Clock")
            clock.clock = stamp
            self._clock.publish(clock)
        if time >= self._next_joints:
            self._next_joints = time + 1 / self._rates.joints_hz
            self._publish_joints(stamp)
        if time >= self._next_frame:
            self._next_frame = time + 1 / self._rates.frames_hz
            frames = (*self._clouds, self._image, self._colour, self._depth)
            if any(topic.is_heard() for topic in frames):
                self._publish_joints(stamp)  # where the camera is at the time of the frame
                self._publish_frame(stamp)

    def _publish_joints(self, stamp: Any) -> None:
        # Listeners of TF warn of each transform that repeats a stamp.
        if stamp == self._joints_stamp:
            return
        self._joints_stamp = stamp
        values = self._robot.joint_values()
        state = make_message("sensor_msgs/JointState")
        state.name, state.position = list(values), [float(value) for value in values.values()]
        state.header.stamp = stamp
        self._joints.publish(state)
        moving = [
            self._transform(joint.parent, child, parent_from_child, stamp)
            for joint in self._robot.description.moving_joints()
            for child, parent_from_child in link_poses(joint.parent, [joint], values).items()
        ]
        self._tf.publish(_transforms(moving))

    def _publish_frame(self, stamp: Any) -> None:
        frame = self._frame()
        assert frame.rgb is not None
        header = self._header(stamp)
        clouds = [topic for topic in self._clouds if topic.is_heard()]
        if clouds:
            message = cloud_message(frame.points(), frame.rgb, header)
            for topic in clouds:
                topic.publish(message)
        if self._image.is_heard():
            flags = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
            done, data = cv2.imencode(".jpg", frame.rgb[..., ::-1], flags)
            assert done
            image = make_message("sensor_msgs/CompressedImage")
            image.header, image.format = header, "rgb8; jpeg compressed bgr8"
            image.data = bytes_like(image.data, data.tobytes())
            self._image.publish(image)
        if self._colour.is_heard():
            self._colour.publish(_image_message(frame.rgb, "rgb8", header))
        if self._depth.is_heard():
            depth = frame.depth_m.astype("<f4")
            self._depth.publish(_image_message(depth, "32FC1", header))

    def _frame(self) -> Frame:
        world_from_camera = self._robot.world_from_base @ self._robot.base_from_camera()
        frame, _ = self._camera.capture(world_from_camera, Lighting())
        return self._noise.apply(frame, self._rng)

    def _header(self, stamp: Any) -> Any:
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = stamp, f"{self._prefix}{self._optical()}"
        return header

    def _optical(self) -> str:
        return next(iter(self._robot.description.cameras.values())).frame_id

    def _camera_info(self) -> Any:
        lens = self._camera.intrinsics
        fx, fy, cx, cy = lens.fx, lens.fy, lens.cx, lens.cy
        info = make_message("sensor_msgs/CameraInfo")
        info.header, info.height, info.width = self._header(self.now()), lens.height, lens.width
        info.distortion_model = "plumb_bob"
        matrices = {
            "d": [0.0] * 5,
            "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
        for name, values in matrices.items():  # in capitals in ROS 1
            setattr(info, name if hasattr(info, name) else name.upper(), values)
        return info

    def _with_bins(self) -> RobotDescription:
        """Return the model of the robot with its own bins, which stand where it does."""
        robot = self._robot.description
        world_from_root = self._robot.world_from_base @ robot.base_from_root.matrix
        root_from_world = np.asarray(np.linalg.inv(world_from_root), np.float64)
        links, joints = list(robot.links), list(robot.joints)
        for box in self._robot.world.place_boxes.values():
            name = f"{box.side}_bin"
            shapes = [Shape("box", size, Pose(centre)) for centre, size in box.walls()]
            links.append(Link(name, _BIN, tuple(shapes)))
            joints.append(
                Joint(f"{name}_fixed", robot.root, name, Pose.of(root_from_world), kind="fixed")
            )
        return replace(robot, links=tuple(links), joints=tuple(joints))

    def _fixed_transforms(self) -> list[Any]:
        robot, stamp = self._with_bins(), self.now()
        fixed = [(robot.base_frame, robot.root, robot.base_from_root.matrix)]
        fixed += [
            (joint.parent, joint.child, joint.pose.matrix)
            for joint in robot.joints
            if joint.kind == "fixed"
        ]
        fixed += [(parent, name, pose.matrix) for name, (parent, pose) in robot.frames.items()]
        return [self._transform(parent, child, matrix, stamp) for parent, child, matrix in fixed]

    def _transform(self, parent: str, child: str, matrix: Any, stamp: Any) -> Any:
        made = make_message("geometry_msgs/TransformStamped")
        made.child_frame_id = f"{self._prefix}{child}"
        made.header.stamp, made.header.frame_id = stamp, f"{self._prefix}{parent}"
        pose = pose_message(matrix)
        fill(made.transform.translation, pose["position"], make_message)
        fill(made.transform.rotation, pose["orientation"], make_message)
        return made


def _image_message(pixels: NDArray[Any], encoding: str, header: Any) -> Any:
    """Return a sensor_msgs/Image of pixels (h, w) or (h, w, 3)."""
    rows = np.ascontiguousarray(pixels)
    image = make_message("sensor_msgs/Image")
    image.header, image.encoding = header, encoding
    image.height, image.width = rows.shape[:2]
    image.step, image.data = rows.strides[0], bytes_like(image.data, rows.tobytes())
    return image


def _transforms(made: list[Any]) -> Any:
    message = make_message("tf2_msgs/TFMessage")
    message.transforms = made
    return message
