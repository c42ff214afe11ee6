"""The camera of a robot in ROS 1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from features.geometry import Frame
from features.imaging.topics import is_rectified_topic
from rtask.interop.ros.clouds import frame_of, frame_of_images
from rtask.interop.ros.convert import raw_mapping
from rtask.interop.ros.views.newest import NewestView

__all__ = ["CameraTopics"]

_QUEUE = {"queue_size": 1, "buff_size": 2**24, "tcp_nodelay": True}


class CameraTopics(NewestView[Frame]):
    """Subscribes to ``~points``, ``~depth``, ``~image`` and ``~camera_info``.

    Images are ``sensor_msgs/Image`` or ``CompressedImage``.
    """

    def __init__(self) -> None:
        import rospy
        from sensor_msgs.msg import CameraInfo, PointCloud2

        super().__init__()
        # Raw and compressed images come under one name: their connection says which they are.
        self._topics = {
            "points": rospy.Subscriber("~points", PointCloud2, self.take_cloud, **_QUEUE),
            "depth": rospy.Subscriber(
                "~depth", rospy.AnyMsg, _image_taker(self.take_depth), **_QUEUE
            ),
            "image": rospy.Subscriber(
                "~image", rospy.AnyMsg, _image_taker(self.take_colour), **_QUEUE
            ),
            "camera_info": rospy.Subscriber("~camera_info", CameraInfo, self.take_info),
        }

    def topic(self, name: str) -> str:
        """Return the full name of a topic, after remapping."""
        return str(self._topics[name].resolved_name)

    def is_published(self, name: str) -> bool:
        """Whether anybody publishes a topic."""
        return bool(self._topics[name].get_num_connections())

    def remapping(self) -> str:
        """Return how to remap the topics."""
        return (
            "remap ~points to the topic of your camera, "
            "~points:=/camera/depth_registered/points, or ~depth, ~image and ~camera_info"
        )

    def read_cloud(self, cloud: Any) -> Frame:
        """Return the view of a cloud."""
        return frame_of(cloud)

    def read_images(self, depth: Any, colour: Any, info: Any) -> Frame:
        """Return the view of a depth image and the colour image that belongs to it."""
        is_rectified = is_rectified_topic(self.topic("depth"))
        return frame_of_images(
            raw_mapping(depth), raw_mapping(colour), raw_mapping(info), is_rectified,
            is_registered=True,
        )  # fmt: skip


def _image_taker(take: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return a callback that decodes images, raw or compressed, and leaves out the rest."""

    def take_image(message: Any) -> None:
        import rospy
        from sensor_msgs import msg

        kind = message._connection_header["type"]
        if kind not in ("sensor_msgs/Image", "sensor_msgs/CompressedImage"):
            topic = message._connection_header.get("topic", "the image's topic")
            rospy.logwarn_throttle(60, f"{topic}: {kind} is no image; it is ignored")
            return
        take(getattr(msg, kind.partition("/")[2])().deserialize(message._buff))

    return take_image
