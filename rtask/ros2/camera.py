"""The camera of a robot in ROS 2."""

from __future__ import annotations

import re
from typing import Any

from rtask.interop.ros.convert import JsonObject, mapping_of
from rtask.interop.ros.views.newest import NewestView
from rtask.ros2.clouds import cloud_json
from rtask.ros2.qos import latched, sensor_data

__all__ = ["CameraTopics", "is_rectified"]

_RECTIFIED = re.compile(r"(^|/)image_rect|(^|[/_])rect(ified)?(/|$)", re.I)


class CameraTopics(NewestView[JsonObject]):
    """Subscribes to ``~/points``, or ``~/depth``, ``~/image`` and ``~/camera_info``.

    ``~/depth_compressed`` and ``~/image_compressed`` are the same as
    ``sensor_msgs/CompressedImage``. A view is read as its part of a request to
    ``rtask/Segmentation/perceive``.

    Parameters
    ----------
    is_reliable
        Hear clouds and images reliably: none of a publisher that is reliable as well gets lost,
        and others are not heard.
    """

    def __init__(self, node: Any, group: Any, is_reliable: bool = False) -> None:
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

        super().__init__()
        self._node = node
        views = sensor_data(is_reliable=is_reliable)
        self.subscriptions = [
            node.create_subscription(kind, f"~/{name}", take, qos, callback_group=group)
            for name, kind, take, qos in (
                ("points", PointCloud2, self.take_cloud, views),
                ("camera_info", CameraInfo, self.take_info, sensor_data()),
                # One that was published once, before this node: its publisher is transient local.
                ("camera_info", CameraInfo, self.take_info, latched()),
                ("depth", Image, self.take_depth, views),
                ("depth_compressed", CompressedImage, self.take_depth, views),
                ("image", Image, self.take_colour, views),
                ("image_compressed", CompressedImage, self.take_colour, views),
            )
        ]

    def topic(self, name: str) -> str:
        """Return the full name of a topic, after remapping."""
        return str(self._node.resolve_topic_name(f"~/{name}"))

    def is_published(self, name: str) -> bool:
        """Whether anybody publishes a topic."""
        return bool(self._node.count_publishers(self.topic(name)))

    def remapping(self) -> str:
        """Return how to remap the topics."""
        return (
            "remap ~/points to the topic of your camera, "
            "-r '~/points:=/camera/depth_registered/points', or ~/depth, ~/image and ~/camera_info"
        )

    def read_cloud(self, cloud: Any) -> JsonObject:
        """Return the request's part of a cloud."""
        return {"cloud": cloud_json(cloud)}

    def read_images(self, depth: Any, colour: Any, info: Any) -> JsonObject:
        """Return the request's part of a depth image and the colour image that belongs to it."""
        name = "depth" if hasattr(depth, "encoding") else "depth_compressed"
        return {
            "depth": mapping_of(depth),
            "image": mapping_of(colour),
            "camera_info": mapping_of(info),
            "is_rectified": is_rectified(self.topic(name)),
        }


def is_rectified(topic: str) -> bool:
    """Whether images of a topic were rectified before they were published.

    The rule is that of :mod:`features.imaging.topics`, which a node need not have installed.
    """
    return _RECTIFIED.search(topic) is not None
