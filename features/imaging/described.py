"""Cameras as a recording describes them: which ``sensor_msgs/CameraInfo`` belongs to an image."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from features.imaging.topics import sensor_of

__all__ = ["CameraDescriptions", "Described", "name_space", "stamp_of"]

_TRANSPORTS = ("compressed", "compressedDepth", "theora", "ffmpeg")
_MAX_OF_FRAME = 32
"""Of one frame: more than the images that wait for their colour."""


@dataclass(frozen=True, eq=False)
class Described:
    """A description of a camera.

    Parameters
    ----------
    message
        The ``sensor_msgs/CameraInfo``.
    frame
        Of its header; empty = not said.
    stamp_s
        Of its header, s; 0 = not said.
    order
        Number of descriptions that were read before it.
    """

    message: Mapping[str, Any]
    frame: str
    stamp_s: float
    order: int


@dataclass
class CameraDescriptions:
    """Descriptions of cameras by name space and frame, with the time from which they hold.

    Two cameras may share a topic, and one may zoom or change its mode: the last description that
    came would then be that of another image.

    Examples
    --------
    >>> cameras = CameraDescriptions()
    >>> for frame, width in (("left", 640), ("right", 848)):
    ...     cameras.add("/eyes/camera_info", {"width": width, "header": {"frame_id": frame}})
    >>> [cameras.find("/eyes/image_raw", frame)[0].message["width"] for frame in ("left", "right")]
    [640, 848]
    """

    count: int = 0
    _by_frame: dict[str, dict[str, deque[Described]]] = field(default_factory=dict)

    def add(self, topic: str, message: Mapping[str, Any]) -> None:
        """Take a ``sensor_msgs/CameraInfo`` of a topic."""
        header = message.get("header") or {}
        frame = str(header.get("frame_id", "")).lstrip("/")
        self.count += 1
        described = Described(message, frame, stamp_of(message), self.count)
        of_space = self._by_frame.setdefault(name_space(topic), {})
        of_space.setdefault(frame, deque(maxlen=_MAX_OF_FRAME)).append(described)

    def find(
        self, topic: str, frame: str = "", stamp_s: float = 0.0, order: int | None = None
    ) -> tuple[Described | None, str]:
        """Return the description of an image, and what is doubtful about it.

        Parameters
        ----------
        topic, frame, stamp_s
            Of the image; empty and 0 = not said.
        order
            :attr:`count` when the image was read; None = now.

        Returns
        -------
        Of descriptions in the frame of the image that with its time; else the last one before it,
        or the first one of all. Where none is in its frame, one of the others is taken, and the
        sentence says so.
        """
        of_space = self._by_frame.get(name_space(topic), {})
        doubt, frame = "", frame.lstrip("/")
        candidates = list(of_space.get(frame, ()))
        if not candidates:
            candidates = sorted(
                (each for few in of_space.values() for each in few), key=attrgetter("order")
            )
            frames = sorted(name for name in of_space if name)
            if frame and frames:
                doubt = (
                    f"its images are in the frame {frame}, its CameraInfo in {', '.join(frames)}"
                )
        if not candidates:
            return None, ""
        at_once = [each for each in candidates if stamp_s and each.stamp_s == stamp_s]
        before = [each for each in at_once or candidates if order is None or each.order <= order]
        return (before[-1] if before else (at_once or candidates)[0]), doubt


def stamp_of(message: Mapping[str, Any]) -> float:
    """Return the time of a message's header, s; 0 where it says none."""
    stamp = (message.get("header") or {}).get("stamp")
    return 0.0 if stamp is None else float(stamp.sec + stamp.nanosec * 1e-9)


def name_space(topic: str) -> str:
    """Return the name space of a topic, in which its CameraInfo lies.

    Examples
    --------
    >>> name_space("/camera/depth/image_raw"), name_space("/camera/color/image_raw/compressed")
    ('/camera/depth', '/camera/color')
    >>> name_space("/device_0/sensor_0/Depth_0/image/data")  # as RealSense's SDK records
    '/device_0/sensor_0/Depth_0'
    >>> name_space("/device_0/sensor_0/Depth_0/info/camera_info")
    '/device_0/sensor_0/Depth_0'
    """
    parts = topic.rstrip("/").split("/")
    if parts[-1] in _TRANSPORTS:
        parts = parts[:-1]
    if sensor_of(topic) and (
        parts[-2:] in (["image", "data"], ["info", "camera_info"]) or parts[-2] == "tf"
    ):
        parts = parts[:-1]
    return "/".join(parts[:-1])
