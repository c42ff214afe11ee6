"""The newest view of a robot's camera in ROS 2: a cloud, or depth with a colour image beside it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.convert import JsonObject, mapping_of, time_of
from rtask.ros2.clouds import cloud_json
from rtask.ros2.qos import latched, sensor_data

__all__ = ["CameraTopics", "Sight"]

_MAX_IMAGES = 8
_PAIRED_S = 0.1
"""Longest time between depth and the colour that belongs to it, s."""


@dataclass(frozen=True)
class Sight:
    """A view that came in.

    Parameters
    ----------
    header
        The ``std_msgs/Header`` of its cloud or depth image.
    request
        Returns its part of a request to ``rtask/Segmentation/perceive``.
    """

    header: Any
    request: Callable[[], JsonObject]


class CameraTopics:
    """Newest messages of ``~/points``, or of ``~/depth``, ``~/image`` and ``~/camera_info``.

    Depth is registered, and described by the camera info; ``~/depth_compressed`` and
    ``~/image_compressed`` are the same as ``sensor_msgs/CompressedImage``.
    """

    def __init__(self, node: Any, group: Any) -> None:
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

        self._node = node
        self._arrived = threading.Condition()
        self._cloud: Any = None
        self._info: Any = None
        self._depths: deque[Any] = deque(maxlen=_MAX_IMAGES)
        self._colours: deque[Any] = deque(maxlen=_MAX_IMAGES)
        subscribe = node.create_subscription
        qos = sensor_data()
        self.subscriptions = [
            subscribe(PointCloud2, "~/points", self._take_cloud, qos, callback_group=group),
            subscribe(CameraInfo, "~/camera_info", self._take_info, qos, callback_group=group),
            # One that was published once, before this node: such publishers are transient local.
            subscribe(
                CameraInfo, "~/camera_info", self._take_info, latched(), callback_group=group
            ),
        ]
        for name, kind, images in (
            ("~/depth", Image, self._depths),
            ("~/depth_compressed", CompressedImage, self._depths),
            ("~/image", Image, self._colours),
            ("~/image_compressed", CompressedImage, self._colours),
        ):
            taken = self._taker(images)
            self.subscriptions.append(subscribe(kind, name, taken, qos, callback_group=group))

    def forget(self) -> None:
        """Forget what was seen, such as before the time jumped back."""
        with self._arrived:
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
        first = time_of(since)
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._newest(first) is not None, wait_s):
                raise RemoteUnavailableError(self._reason(wait_s, first))
            seen = self._newest(first)
            assert seen is not None
            return seen

    def _take_cloud(self, message: Any) -> None:
        with self._arrived:
            self._cloud = message
            self._arrived.notify_all()

    def _take_info(self, message: Any) -> None:
        with self._arrived:
            self._info = message
            self._arrived.notify_all()

    def _taker(self, images: deque[Any]) -> Callable[[Any], None]:
        def take(message: Any) -> None:
            with self._arrived:
                images.append(message)
                self._arrived.notify_all()

        return take

    def _newest(self, since: tuple[int, int]) -> Sight | None:
        sights = [sight for sight in (self._cloud_sight(), self._pair_sight()) if sight is not None]
        fresh = [sight for sight in sights if time_of(sight.header.stamp) >= since]
        return max(fresh, key=lambda sight: time_of(sight.header.stamp), default=None)

    def _cloud_sight(self) -> Sight | None:
        cloud = self._cloud
        return None if cloud is None else Sight(cloud.header, lambda: {"cloud": cloud_json(cloud)})

    def _pair_sight(self) -> Sight | None:
        """Return the newest depth that has a colour image near it in time."""
        info = self._info
        if info is None:
            return None
        for depth in reversed(self._depths):
            apart = [(_apart_s(image, depth), k) for k, image in enumerate(self._colours)]
            if apart and min(apart)[0] <= _PAIRED_S:
                return Sight(depth.header, self._joined(depth, self._colours[min(apart)[1]], info))
        return None

    def _joined(self, depth: Any, colour: Any, info: Any) -> Callable[[], JsonObject]:
        name = "~/depth" if hasattr(depth, "encoding") else "~/depth_compressed"
        parts = self._node.resolve_topic_name(name).split("/")
        is_rectified = any(part.startswith("image_rect") for part in parts)
        return lambda: {
            "depth": mapping_of(depth),
            "image": mapping_of(colour),
            "camera_info": mapping_of(info),
            "is_rectified": is_rectified,
        }

    def _reason(self, wait_s: float, since: tuple[int, int]) -> str:
        """Say why no view came."""
        full = self._node.resolve_topic_name
        points = full("~/points")
        reason = f"no cloud since {since[0] + since[1] / 1e9:.3f} s came on {points} within "
        reason += f"{wait_s:g} s: "
        if self._cloud is not None:
            reason += f"the newest is of {_seconds(self._cloud):.3f} s"
        elif self._node.count_publishers(points):
            reason += "its publisher is silent"
        else:
            reason += "nobody publishes it"
        images = {
            "~/depth": self._depths,
            "~/image": self._colours,
            "~/camera_info": [] if self._info is None else [self._info],
        }
        if not self._depths and not self._node.count_publishers(full("~/depth")):
            return (
                f"{reason}; remap ~/points to the topic of your camera, "
                "-r '~/points:=/camera/depth_registered/points', or ~/depth, ~/image and "
                "~/camera_info"
            )
        lacking = [full(name) for name, messages in images.items() if not messages]
        if lacking:
            return f"{reason}; of depth and colour, nothing came on {', '.join(lacking)}"
        return (
            f"{reason}; the newest depth on {full('~/depth')} is of "
            f"{_seconds(self._depths[-1]):.3f} s, the newest image on {full('~/image')} of "
            f"{_seconds(self._colours[-1]):.3f} s; they belong together when at most "
            f"{_PAIRED_S:g} s lie between them"
        )


def _seconds(message: Any) -> float:
    secs, nsecs = time_of(message.header.stamp)
    return secs + nsecs / 1e9


def _apart_s(image: Any, other: Any) -> float:
    (a, b), (c, d) = time_of(image.header.stamp), time_of(other.header.stamp)
    return abs((a - c) + (b - d) / 1e9)
