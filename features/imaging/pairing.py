"""Joins depth, colour and cameras of a recording as their messages come in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import Limits
from features.codec.ros import image_bytes, pcd_from_point_cloud
from features.codec.sniff import decode
from features.codec.types import Cloud
from features.geometry import Frame
from features.imaging.camera import Lens, lens_from_message
from features.imaging.photo import Photo, read_photo
from features.imaging.pictures import (
    PAIRED_S,
    depth_of_message,
    implausible_depth,
    is_infrared_topic,
    is_rectified_topic,
    view_of_images,
)

__all__ = ["Pairing", "has_space", "sensor_of"]

_TRANSPORTS = ("compressed", "compressedDepth", "theora", "ffmpeg")
_STORED_BYTES = 256 * 2**20
_MILLIMETRE = 0.001


def has_space(topics: list[tuple[str, str]]) -> bool:
    """Return whether any topic carries depth or clouds, from names and types."""
    return any(
        kind.endswith("PointCloud2")
        or ("depth" in topic.lower() and not kind.endswith("CameraInfo"))
        for topic, kind in topics
    )


class _Depth(NamedTuple):
    time_s: float
    stamp_s: float
    topic: str
    depth_m: NDArray[np.float32]
    frame_id: str


class _Colour(NamedTuple):
    time_s: float
    topic: str
    photo: Photo


@dataclass
class Pairing:
    """Depth that waits for its colour, and the cameras described so far.

    Parameters
    ----------
    has_space
        Whether depth or clouds are to be expected.
    warn
        Called once for each topic that is left out, with the reason.
    units_m
        Metres of one step of depth, by sensor, where a recording says it.
    """

    has_space: bool
    warn: Callable[[str], None]
    units_m: dict[str, float] = field(default_factory=dict)
    _cameras: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    _colour: _Colour | None = None
    _depth: _Depth | None = None
    _warned: set[str] = field(default_factory=set)

    def add_camera(self, topic: str, message: Mapping[str, Any]) -> None:
        """Take the description of a camera, ``sensor_msgs/CameraInfo``, from its topic."""
        self._cameras[_space(topic)] = message

    def take(
        self, topic: str, kind: str, message: Mapping[str, Any], time_s: float
    ) -> Iterator[Frame | Cloud | Photo]:
        """Yield the views that a message completes; a message that does not read gives none."""
        try:
            yield from self._take(topic, kind, message, time_s)
        except ValueError as error:
            self._leave_out(topic, str(error))

    def finish(self) -> Iterator[Frame]:
        """Yield the depth that still waits, with the colour that is near in time."""
        if self._depth is not None:
            yield from self._join(self._colour)

    def _take(
        self, topic: str, kind: str, message: Mapping[str, Any], time_s: float
    ) -> Iterator[Frame | Cloud | Photo]:
        if kind.endswith("CameraInfo"):
            self.add_camera(topic, message)
            return
        if kind.endswith("PointCloud2"):
            seen = decode(pcd_from_point_cloud(message), Limits(stored_bytes=_STORED_BYTES))
            stamp_s = _stamp_s(message, time_s)
            yield replace(seen, stamp_s=stamp_s) if isinstance(seen, Cloud) else seen
            return
        says_depth = "depth" in topic.lower()
        if not says_depth and is_infrared_topic(topic):
            self._leave_out(topic, "infrared, which is neither depth nor colour")
            return
        depth_m = depth_of_message(message, says_depth)
        if depth_m is not None and (says_depth or not self.has_space):
            yield from self._take_depth(topic, message, depth_m, time_s)
        elif depth_m is not None or message.get("encoding") == "mono16":
            what = message.get("encoding", message.get("format"))
            self._leave_out(topic, f"{what} on a topic that does not say that it carries depth")
        else:
            yield from self._take_colour(_Colour(time_s, topic, read_photo(image_bytes(message))))

    def _take_depth(
        self, topic: str, message: Mapping[str, Any], depth_m: NDArray[np.float32], time_s: float
    ) -> Iterator[Frame]:
        yield from self.finish()
        unit_m = self.units_m.get(sensor_of(topic), _MILLIMETRE)
        depth_m = np.asarray(depth_m * np.float32(unit_m / _MILLIMETRE))
        doubt = implausible_depth(depth_m)
        if doubt:
            self._warn_once(topic, doubt)
        frame_id, stamp_s = str(message["header"]["frame_id"]), _stamp_s(message, time_s)
        self._depth = _Depth(time_s, stamp_s, topic, depth_m, frame_id)
        if self._colour is not None and time_s - self._colour.time_s < PAIRED_S / 4:
            yield from self._join(self._colour)

    def _take_colour(self, colour: _Colour) -> Iterator[Frame | Photo]:
        before, waiting = self._colour, self._depth
        self._colour = colour
        if not self.has_space and waiting is None:
            yield colour.photo
        if waiting is not None:
            is_before_nearer = (
                before is not None
                and waiting.time_s - before.time_s < colour.time_s - waiting.time_s
            )
            yield from self._join(before if is_before_nearer else colour)

    def _join(self, colour: _Colour | None) -> Iterator[Frame]:
        """Yield the depth that waits, with a colour image if it is near in time."""
        assert self._depth is not None
        time_s, stamp_s, topic, depth_m, frame_id = self._depth
        self._depth = None
        lens = self._lens(topic)
        if lens is None or depth_m.shape != (lens.intrinsics.height, lens.intrinsics.width):
            across, down = depth_m.shape[::-1]
            self._leave_out(topic, f"no CameraInfo of {across}x{down} px beside it")
            return
        rgb = seen_by = None
        if colour is not None and abs(colour.time_s - time_s) <= PAIRED_S:
            rgb, seen_by = colour.photo.rgb, self._lens(colour.topic) or lens
        try:
            seen = view_of_images(depth_m, lens, rgb, seen_by)
        except ValueError as error:
            assert colour is not None
            self._leave_out(colour.topic, str(error))
            seen = view_of_images(depth_m, lens, None)
        yield replace(seen, frame_id=frame_id, stamp_s=stamp_s)

    def _lens(self, topic: str) -> Lens | None:
        """Return the lens of an image's topic; None where none is described, or not usably."""
        message = self._cameras.get(_space(topic))
        if message is None:
            return None
        try:
            return lens_from_message(message, is_rectified_topic(topic))
        except ValueError as error:
            self._warn_once(_space(topic), f"its CameraInfo is of no use: {error}")
            return None

    def _leave_out(self, topic: str, reason: str) -> None:
        self._warn_once(topic, f"left out: {reason}")

    def _warn_once(self, topic: str, reason: str) -> None:
        if topic not in self._warned:
            self._warned.add(topic)
            self.warn(f"{topic}: {reason}")


def _stamp_s(message: Mapping[str, Any], recorded_s: float) -> float:
    """Return when a message was measured: by its header, or as it was recorded if that is empty."""
    stamp = message["header"]["stamp"]
    return float(stamp.sec + stamp.nanosec * 1e-9) or recorded_s


def sensor_of(topic: str) -> str:
    """Return the sensor of a topic of RealSense's own recordings; empty for other topics.

    Examples
    --------
    >>> sensor_of("/device_0/sensor_0/option/Depth_Units/value")
    '/device_0/sensor_0'
    """
    parts = topic.split("/")
    is_sensor = len(parts) > 3 and parts[1].startswith("device_") and parts[2].startswith("sensor_")
    return "/".join(parts[:3]) if is_sensor else ""


def _space(topic: str) -> str:
    """Return the name space of a topic, in which its CameraInfo lies.

    >>> _space("/camera/depth/image_raw"), _space("/camera/color/image_raw/compressed")
    ('/camera/depth', '/camera/color')
    >>> _space("/device_0/sensor_0/Depth_0/image/data")  # as RealSense's SDK records
    '/device_0/sensor_0/Depth_0'
    >>> _space("/device_0/sensor_0/Depth_0/info/camera_info")
    '/device_0/sensor_0/Depth_0'
    """
    parts = topic.rstrip("/").split("/")
    if parts[-1] in _TRANSPORTS:
        parts = parts[:-1]
    if sensor_of(topic) and parts[-2:] in (["image", "data"], ["info", "camera_info"]):
        parts = parts[:-1]
    return "/".join(parts[:-1])
