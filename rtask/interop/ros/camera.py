"""The newest view of a robot's camera: a cloud, or depth with a colour image beside it."""

from __future__ import annotations

import functools
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from features.geometry import Frame
from features.imaging.pictures import PAIRED_S, is_rectified_topic
from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.clouds import frame_of, frame_of_images
from rtask.interop.ros.convert import raw_mapping

__all__ = ["CameraTopics", "Sight"]

_MAX_IMAGES = 8
_QUEUE = {"queue_size": 1, "buff_size": 2**24, "tcp_nodelay": True}


@dataclass(frozen=True)
class Sight:
    """A view that came in and was not decoded yet.

    Parameters
    ----------
    header
        The ``std_msgs/Header`` of its cloud or depth image.
    read
        Returns the view, or raises :class:`~rtask.errors.DataError`.
    """

    header: Any
    read: Callable[[], Frame]


class CameraTopics:
    """Keeps the newest messages of ``~points``, ``~depth``, ``~image`` and ``~camera_info``.

    Depth is a registered ``sensor_msgs/Image`` or ``CompressedImage`` of the camera that
    ``~camera_info`` describes. It is joined with the colour image nearest in time, at most 0.1 s
    away.
    """

    def __init__(self) -> None:
        import rospy
        from sensor_msgs.msg import CameraInfo, PointCloud2

        self._came = threading.Condition()
        self._cloud: Any = None
        self._depths: deque[Any] = deque(maxlen=_MAX_IMAGES)
        self._colours: deque[Any] = deque(maxlen=_MAX_IMAGES)
        self._info: Any = None
        self._points_topic = rospy.Subscriber("~points", PointCloud2, self._take_cloud, **_QUEUE)
        # Raw and compressed images come under one name: their connection says which they are.
        self._depth_topic = rospy.Subscriber(
            "~depth",
            rospy.AnyMsg,
            lambda message: self._take_image(message, self._depths),
            **_QUEUE,
        )
        self._image_topic = rospy.Subscriber(
            "~image",
            rospy.AnyMsg,
            lambda message: self._take_image(message, self._colours),
            **_QUEUE,
        )
        self._info_topic = rospy.Subscriber("~camera_info", CameraInfo, self._take_info)

    def _take_cloud(self, message: Any) -> None:
        with self._came:
            self._cloud = message
            self._came.notify_all()

    def _take_info(self, message: Any) -> None:
        with self._came:
            self._info = message
            self._came.notify_all()

    def _take_image(self, message: Any, images: deque[Any]) -> None:
        import rospy
        from sensor_msgs import msg

        kind = message._connection_header["type"]
        if kind not in ("sensor_msgs/Image", "sensor_msgs/CompressedImage"):
            topic = message._connection_header.get("topic", "the image's topic")
            rospy.logwarn_throttle(60, f"{topic}: {kind} is no image; it is ignored")
            return
        image = getattr(msg, kind.partition("/")[2])().deserialize(message._buff)
        with self._came:
            images.append(image)
            self._came.notify_all()

    def forget(self) -> None:
        """Forget what was seen, such as before the time jumped back."""
        with self._came:
            self._cloud = None
            self._depths.clear()
            self._colours.clear()

    def wait(self, wait_s: float, since: Any) -> Sight:
        """Return the newest view.

        Parameters
        ----------
        wait_s
            Longest wait, s of the wall clock.
        since
            Time of ROS; an older view is not taken.

        Raises
        ------
        RemoteUnavailableError
            None came within that time.
        """
        with self._came:
            if not self._came.wait_for(lambda: self._newest(since) is not None, wait_s):
                raise RemoteUnavailableError(self._reason(wait_s, since))
            seen = self._newest(since)
            assert seen is not None
            return seen

    def _newest(self, since: Any) -> Sight | None:
        sights = [sight for sight in (self._cloud_sight(), self._pair_sight()) if sight is not None]
        fresh = [sight for sight in sights if sight.header.stamp >= since]
        return max(fresh, key=lambda sight: sight.header.stamp, default=None)

    def _cloud_sight(self) -> Sight | None:
        cloud = self._cloud
        return None if cloud is None else Sight(cloud.header, lambda: frame_of(cloud))

    def _pair_sight(self) -> Sight | None:
        """Return the newest depth that has a colour image near it in time."""
        info = self._info
        if info is None:
            return None
        for depth in reversed(self._depths):
            apart = [(_apart_s(image, depth), k) for k, image in enumerate(self._colours)]
            if apart and min(apart)[0] <= PAIRED_S:
                colour = self._colours[min(apart)[1]]
                is_rectified = is_rectified_topic(self._depth_topic.resolved_name)
                read = functools.partial(_joined, depth, colour, info, is_rectified)
                return Sight(depth.header, read)
        return None

    def _reason(self, wait_s: float, since: Any) -> str:
        """Say why no view came."""
        points = self._points_topic
        reason = f"no cloud since {since.to_sec():.3f} s came on {points.resolved_name} within "
        reason += f"{wait_s:g} s: "
        if self._cloud is not None:
            reason += f"the newest is of {self._cloud.header.stamp.to_sec():.3f} s"
        elif points.get_num_connections():
            reason += "its publisher is silent"
        else:
            reason += "nobody publishes it"
        depth = self._depth_topic
        if not self._depths and not depth.get_num_connections():
            return (
                f"{reason}; remap ~points to the topic of your camera, "
                "~points:=/camera/depth_registered/points, or ~depth, ~image and ~camera_info"
            )
        lacking = [
            topic.resolved_name
            for topic, images in (
                (depth, self._depths),
                (self._image_topic, self._colours),
                (self._info_topic, [] if self._info is None else [self._info]),
            )
            if not images
        ]
        if lacking:
            return f"{reason}; of depth and colour, nothing came on {', '.join(lacking)}"
        stamp = self._depths[-1].header.stamp.to_sec()
        return (
            f"{reason}; the newest depth on {depth.resolved_name} is of {stamp:.3f} s, the newest "
            f"image on {self._image_topic.resolved_name} of "
            f"{self._colours[-1].header.stamp.to_sec():.3f} s; they belong together when at most "
            f"{PAIRED_S:g} s lie between them"
        )


def _apart_s(image: Any, other: Any) -> float:
    return abs(float((image.header.stamp - other.header.stamp).to_sec()))


def _joined(depth: Any, colour: Any, info: Any, is_rectified: bool = False) -> Frame:
    return frame_of_images(raw_mapping(depth), raw_mapping(colour), raw_mapping(info), is_rectified)
