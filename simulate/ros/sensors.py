"""Publishers of a simulated robot: joints, TF, camera and clock, as of real drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from features.geometry import Frame
from rtask.interop.ros.clouds import cloud_message
from simulate.motion.collision import link_poses
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.robot_body import RobotBody

__all__ = ["Rates", "Sensors"]

_JPEG_QUALITY = 90


@dataclass(frozen=True)
class Rates:
    """Messages per second of the robot's time."""

    joints_hz: float = 20.0
    frames_hz: float = 5.0


class Sensors:
    """Publishers of one simulated robot; all are called from the thread of the physics.

    Topics are relative, so that a namespace tells robots apart; ``/joint_states``, ``/tf`` and
    ``/clock`` are absolute, as on real robots. Clouds and images are rendered only while somebody
    subscribes.

    Parameters
    ----------
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
        self, robot: RobotBody, rates: Rates, is_clock: bool = False, prefix: str = ""
    ) -> None:
        import rospy
        import tf2_msgs.msg
        import tf2_ros
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, CompressedImage, JointState, PointCloud2

        self._robot, self._rates, self._prefix = robot, rates, prefix
        self._camera = Camera(robot.world.client)
        self._noise, self._rng = SensorNoise(), np.random.default_rng(0)
        self._next_joints = self._next_frame = 0.0
        camera = "camera/rgb"
        self._clock = rospy.Publisher("/clock", Clock, queue_size=1) if is_clock else None
        self._joints = rospy.Publisher("/joint_states", JointState, queue_size=1)
        self._tf = rospy.Publisher("/tf", tf2_msgs.msg.TFMessage, queue_size=10)
        self._cloud = rospy.Publisher("camera/depth_registered/points", PointCloud2, queue_size=1)
        self._image = rospy.Publisher(
            f"{camera}/image_raw/compressed", CompressedImage, queue_size=1
        )
        self._info = rospy.Publisher(f"{camera}/camera_info", CameraInfo, queue_size=1, latch=True)
        self._info.publish(self._camera_info())
        self._fixed = tf2_ros.StaticTransformBroadcaster()
        self._fixed.sendTransform(self._fixed_transforms())

    def now(self) -> Any:
        """Return the time with which to stamp: simulated if the clock is published."""
        import rospy

        if self._clock is None:
            return rospy.Time.now()
        return rospy.Time.from_sec(self._robot.world.time)

    def tick(self) -> None:
        """Publish what is due at the robot's present time."""
        time, stamp = self._robot.world.time, self.now()
        if self._clock is not None:
            self._clock.publish(stamp)
        if time >= self._next_joints:
            self._next_joints = time + 1 / self._rates.joints_hz
            self._publish_joints(stamp)
        if time >= self._next_frame:
            self._next_frame = time + 1 / self._rates.frames_hz
            if self._cloud.get_num_connections() or self._image.get_num_connections():
                self._publish_joints(stamp)  # where the camera is at the time of the frame
                self._publish_frame(stamp)

    def _publish_joints(self, stamp: Any) -> None:
        import tf2_msgs.msg
        from sensor_msgs.msg import JointState

        values = self._robot.joint_values()
        state = JointState(name=list(values), position=list(values.values()))
        state.header.stamp = stamp
        self._joints.publish(state)
        moving = [
            self._transform(joint.parent, child, parent_from_child, stamp)
            for joint in self._robot.description.moving_joints()
            for child, parent_from_child in link_poses(joint.parent, [joint], values).items()
        ]
        self._tf.publish(tf2_msgs.msg.TFMessage(moving))

    def _publish_frame(self, stamp: Any) -> None:
        frame = self._frame()
        assert frame.rgb is not None
        header = self._header(stamp)
        if self._cloud.get_num_connections():
            points = frame.points()
            self._cloud.publish(cloud_message(points, frame.rgb, header))
        if self._image.get_num_connections():
            from sensor_msgs.msg import CompressedImage

            flags = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
            done, data = cv2.imencode(".jpg", frame.rgb[..., ::-1], flags)
            assert done
            self._image.publish(
                CompressedImage(header, "rgb8; jpeg compressed bgr8", data.tobytes())
            )

    def _frame(self) -> Frame:
        world_from_camera = self._robot.world_from_base @ self._robot.base_from_camera()
        frame, _ = self._camera.capture(world_from_camera, Lighting())
        return self._noise.apply(frame, self._rng)

    def _header(self, stamp: Any) -> Any:
        from std_msgs.msg import Header

        return Header(0, stamp, f"{self._prefix}{self._optical()}")

    def _optical(self) -> str:
        return next(iter(self._robot.description.cameras.values())).frame_id

    def _camera_info(self) -> Any:
        from sensor_msgs.msg import CameraInfo

        lens = self._camera.intrinsics
        fx, fy, cx, cy = lens.fx, lens.fy, lens.cx, lens.cy
        info = CameraInfo(height=lens.height, width=lens.width, distortion_model="plumb_bob")
        info.header = self._header(self.now())
        info.D = [0.0] * 5
        info.K = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
        info.R = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        info.P = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        return info

    def _fixed_transforms(self) -> list[Any]:
        robot, stamp = self._robot.description, self.now()
        fixed = [(robot.base_frame, robot.root, robot.base_from_root.matrix)]
        fixed += [
            (joint.parent, joint.child, joint.pose.matrix)
            for joint in robot.joints
            if joint.kind == "fixed"
        ]
        fixed += [(parent, name, pose.matrix) for name, (parent, pose) in robot.frames.items()]
        return [self._transform(parent, child, matrix, stamp) for parent, child, matrix in fixed]

    def _transform(self, parent: str, child: str, matrix: Any, stamp: Any) -> Any:
        from geometry_msgs.msg import TransformStamped

        from grasp.messages import pose_message
        from rtask.interop.ros.convert import fill
        from rtask.interop.ros.package import make_message

        made = TransformStamped(child_frame_id=f"{self._prefix}{child}")
        made.header.stamp, made.header.frame_id = stamp, f"{self._prefix}{parent}"
        pose = pose_message(matrix)
        fill(made.transform.translation, pose["position"], make_message)
        fill(made.transform.rotation, pose["orientation"], make_message)
        return made
