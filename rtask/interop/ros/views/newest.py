"""The newest view of a robot's camera: a cloud, or depth with a colour image beside it.

The same for ROS 1 and ROS 2, and without the libraries of perception: the package for ROS 2 has a
copy of this file and none of them.
"""

from __future__ import annotations

import re
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.convert import time_of

__all__ = ["NewestView", "Sight"]

View = TypeVar("View")
_MAX_IMAGES = 8
_PAIRED_S = 0.1
"""Longest time between depth and the colour that belongs to it, s."""
_ALIGNED = re.compile(r"aligned_depth|depth_registered|depth_to_(rgb|colou?r)", re.I)
"""As in recordings: depth that was laid over colour, whatever frame its driver writes."""


@dataclass(frozen=True)
class Sight(Generic[View]):
    """A view that came in and was not decoded yet.

    Parameters
    ----------
    header
        The ``std_msgs/Header`` of its cloud or depth image.
    read
        Decodes it; may raise :class:`~rtask.errors.DataError`.
    """

    header: Any
    read: Callable[[], View]


class NewestView(ABC, Generic[View]):
    """Keeps the newest messages of the topics ``points``, ``depth``, ``image``, ``camera_info``.

    Depth is registered, and described by the camera info. It is joined with the colour image
    nearest in time, at most 0.1 s away, and of its frame: the picture of a camera at the wrist is
    never laid over the depth of one in the head. Who subscribes passes each message on by
    `take_cloud`, `take_info`, `take_depth` or `take_colour`, from any thread.
    """

    def __init__(self) -> None:
        self._arrival = threading.Condition()
        self._cloud: Any = None
        self._info: Any = None
        self._depths: deque[Any] = deque(maxlen=_MAX_IMAGES)
        self._colours: deque[Any] = deque(maxlen=_MAX_IMAGES)

    @abstractmethod
    def topic(self, name: str) -> str:
        """Return the full name of a topic, after remapping."""

    @abstractmethod
    def is_published(self, name: str) -> bool:
        """Whether anybody publishes a topic."""

    @abstractmethod
    def remapping(self) -> str:
        """Return how to remap the topics, for an error: the names and an example."""

    @abstractmethod
    def read_cloud(self, cloud: Any) -> View:
        """Return the view of a cloud."""

    @abstractmethod
    def read_images(self, depth: Any, colour: Any, info: Any) -> View:
        """Return the view of a depth image and the colour image that belongs to it."""

    def take_cloud(self, message: Any) -> None:
        """Keep a ``sensor_msgs/PointCloud2``."""
        with self._arrival:
            self._cloud = message
            self._arrival.notify_all()

    def take_info(self, message: Any) -> None:
        """Keep a ``sensor_msgs/CameraInfo``."""
        with self._arrival:
            self._info = message
            self._arrival.notify_all()

    def take_depth(self, message: Any) -> None:
        """Keep a depth image, raw or compressed."""
        with self._arrival:
            self._depths.append(message)
            self._arrival.notify_all()

    def take_colour(self, message: Any) -> None:
        """Keep a colour image, raw or compressed."""
        with self._arrival:
            self._colours.append(message)
            self._arrival.notify_all()

    def forget(self) -> None:
        """Forget what was seen, such as before the time jumped back."""
        with self._arrival:
            self._cloud = None
            self._depths.clear()
            self._colours.clear()

    def wait(self, wait_s: float, since: Any) -> Sight[View]:
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
        with self._arrival:
            if not self._arrival.wait_for(lambda: self._newest(first) is not None, wait_s):
                raise RemoteUnavailableError(self._reason(wait_s, first))
            seen = self._newest(first)
            assert seen is not None
            return seen

    def _newest(self, since: tuple[int, int]) -> Sight[View] | None:
        sights = [sight for sight in (self._cloud_sight(), self._pair_sight()) if sight is not None]
        fresh = [sight for sight in sights if time_of(sight.header.stamp) >= since]
        return max(fresh, key=lambda sight: time_of(sight.header.stamp), default=None)

    def _cloud_sight(self) -> Sight[View] | None:
        cloud = self._cloud
        return None if cloud is None else Sight(cloud.header, lambda: self.read_cloud(cloud))

    def _pair_sight(self) -> Sight[View] | None:
        """Return the newest depth that has a colour image near it in time."""
        info = self._info
        if info is None:
            return None
        for depth in reversed(self._depths):
            apart = [
                (_apart_s(image, depth), k)
                for k, image in enumerate(self._colours)
                if self._is_of_its_camera(image, depth)
            ]
            if apart and min(apart)[0] <= _PAIRED_S:
                return self._joined(depth, self._colours[min(apart)[1]], info)
        return None

    def _is_of_its_camera(self, colour: Any, depth: Any) -> bool:
        """Whether colour may be laid over depth; a frame that is not said excludes nothing."""
        where, whence = _frame_of(colour), _frame_of(depth)
        same = not where or not whence or where == whence
        return same or _ALIGNED.search(self.topic("depth")) is not None

    def _joined(self, depth: Any, colour: Any, info: Any) -> Sight[View]:
        return Sight(depth.header, lambda: self.read_images(depth, colour, info))

    def _reason(self, wait_s: float, since: tuple[int, int]) -> str:
        """Say why no view came."""
        reason = f"no cloud since {_seconds(since):.3f} s came on {self.topic('points')} within "
        reason += f"{wait_s:g} s: "
        if self._cloud is not None:
            reason += f"the newest is of {_time_s(self._cloud):.3f} s"
        elif self.is_published("points"):
            reason += "its publisher is silent"
        else:
            reason += "nobody publishes it"
        if not self._depths and not self.is_published("depth"):
            return f"{reason}; {self.remapping()}"
        messages = {
            "depth": self._depths,
            "image": self._colours,
            "camera_info": [] if self._info is None else [self._info],
        }
        lacking = [self.topic(name) for name, received in messages.items() if not received]
        if lacking:
            return f"{reason}; of depth and colour, nothing came on {', '.join(lacking)}"
        if not self._is_of_its_camera(self._colours[-1], self._depths[-1]):
            return (
                f"{reason}; depth on {self.topic('depth')} is in the frame "
                f"{_frame_of(self._depths[-1])}, and the image on {self.topic('image')} in "
                f"{_frame_of(self._colours[-1])}: give the depth that the driver registered to "
                "that image, or the image of that camera"
            )
        return (
            f"{reason}; the newest depth on {self.topic('depth')} is of "
            f"{_time_s(self._depths[-1]):.3f} s, the newest image on {self.topic('image')} of "
            f"{_time_s(self._colours[-1]):.3f} s; they belong together when at most "
            f"{_PAIRED_S:g} s lie between them"
        )


def _frame_of(message: Any) -> str:
    """Return the frame without the slash that ROS 1 once wrote before it."""
    return str(message.header.frame_id).lstrip("/")


def _time_s(message: Any) -> float:
    return _seconds(time_of(message.header.stamp))


def _seconds(time: tuple[int, int]) -> float:
    return time[0] + time[1] / 1e9


def _apart_s(image: Any, other: Any) -> float:
    (a, b), (c, d) = time_of(image.header.stamp), time_of(other.header.stamp)
    return abs((a - c) + (b - d) / 1e9)
