"""Joins depth, colour and cameras of a recording as their messages come in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import Limits
from features.codec.ros import ColourScale, deep_colours, image_bytes, pcd_from_point_cloud
from features.codec.sniff import decode
from features.codec.types import Cloud
from features.geometry import Frame
from features.imaging.camera import (
    Lens,
    describes_rectified,
    lens_from_message,
    lens_of_size,
)
from features.imaging.doubts import (
    doubtful_frame,
    doubtful_rays,
    implausible_cloud,
    implausible_depth,
)
from features.imaging.mounting import Mounting
from features.imaging.photo import Photo, read_photo
from features.imaging.pictures import PAIRED_S, depth_of_message, view_of_images
from features.imaging.topics import Plan, is_rectified_topic, sensor_of

__all__ = ["Pairing"]

_TRANSPORTS = ("compressed", "compressedDepth", "theora", "ffmpeg")
_STORED_BYTES = 256 * 2**20
_MILLIMETRE = 0.001


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
    frame_id: str


@dataclass
class Pairing:
    """Depth that waits for its colour, and the cameras described so far.

    Parameters
    ----------
    plan
        What each topic is for.
    warn
        Called once for each topic that is left out, with the reason.
    mounting
        How the cameras stand to one another.
    units_m
        Metres of one step of depth, by sensor, where a recording says it.
    """

    plan: Plan
    warn: Callable[[str], None]
    mounting: Mounting = field(default_factory=Mounting)
    units_m: dict[str, float] = field(default_factory=dict)
    _cameras: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    _colours: dict[str, _Colour] = field(default_factory=dict)
    _depths: dict[str, _Depth] = field(default_factory=dict)
    _warned: set[tuple[str, str]] = field(default_factory=set)
    _looked_at: set[str] = field(default_factory=set)
    _scales: dict[str, ColourScale] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for topic, reason in self.plan.left_out.items():
            self._leave_out(topic, reason)
        for topic, doubt in self.plan.doubts.items():
            self._warn_once(topic, doubt)

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
        for topic in list(self._depths):
            yield from self._join(topic, self._colour_near(topic))

    def _take(
        self, topic: str, kind: str, message: Mapping[str, Any], time_s: float
    ) -> Iterator[Frame | Cloud | Photo]:
        if kind.endswith("CameraInfo"):
            self.add_camera(topic, message)
        elif kind.endswith("PointCloud2"):
            seen = decode(pcd_from_point_cloud(message), Limits(stored_bytes=_STORED_BYTES))
            if not isinstance(seen, Cloud):
                yield seen
                return
            doubt = implausible_cloud(seen.positions)
            if not doubt and self._is_first(topic):
                doubt = doubtful_frame(seen.positions, seen.frame_id)
            if doubt:
                self._warn_once(topic, doubt)
            yield replace(seen, stamp_s=_stamp_s(message, time_s))
        elif topic in self.plan.depth:
            depth_m = depth_of_message(
                message, is_depth_topic=True, say=lambda text: self._warn_once(topic, text, "marks")
            )
            if depth_m is None:
                what = message.get("encoding", message.get("format"))
                self._leave_out(topic, f"{what} on a topic of depth holds no depth")
            else:
                yield from self._take_depth(topic, message, depth_m, time_s)
        elif topic in self.plan.colour and topic not in self.plan.left_out:
            photo = read_photo(image_bytes(message, scale=self._scale_of(topic, message)))
            frame_id = str(message["header"]["frame_id"])
            yield from self._take_colour(_Colour(time_s, topic, photo, frame_id))

    def _take_depth(
        self, topic: str, message: Mapping[str, Any], depth_m: NDArray[np.float32], time_s: float
    ) -> Iterator[Frame]:
        if topic in self._depths:
            yield from self._join(topic, self._colour_near(topic))
        unit_m = self.units_m.get(sensor_of(topic), _MILLIMETRE)
        depth_m = np.asarray(depth_m * np.float32(unit_m / _MILLIMETRE))
        doubt = implausible_depth(depth_m)
        if doubt:
            self._warn_once(topic, doubt)
        frame_id, stamp_s = str(message["header"]["frame_id"]), _stamp_s(message, time_s)
        self._depths[topic] = _Depth(time_s, stamp_s, topic, depth_m, frame_id)
        colour = self._colour_near(topic)
        if colour is not None and time_s - colour.time_s < PAIRED_S / 4:
            yield from self._join(topic, colour)

    def _take_colour(self, colour: _Colour) -> Iterator[Frame | Photo]:
        is_alone = not self.plan.depth and not self.plan.has_clouds
        if is_alone:
            yield colour.photo
        waiting = [
            name for name in self._depths if colour.topic in self.plan.partners.get(name, ())
        ]
        before = {name: self._colour_near(name) for name in waiting}
        self._colours[colour.topic] = colour
        for name in waiting:
            depth, earlier = self._depths[name], before[name]
            is_before_nearer = (
                earlier is not None and depth.time_s - earlier.time_s < colour.time_s - depth.time_s
            )
            yield from self._join(name, earlier if is_before_nearer else colour)

    def _colour_near(self, depth_topic: str) -> _Colour | None:
        """Return the last picture of the camera of a topic of depth."""
        partners = self.plan.partners.get(depth_topic, ())
        seen = [self._colours[name] for name in partners if name in self._colours]
        return max(seen, key=lambda colour: colour.time_s, default=None)

    def _join(self, depth_topic: str, colour: _Colour | None) -> Iterator[Frame]:
        """Yield the depth that waits, with a colour image if it is near in time."""
        depth = self._depths.pop(depth_topic)
        if colour is not None and abs(colour.time_s - depth.time_s) > PAIRED_S:
            colour = None
        shape = depth.depth_m.shape
        lens = self._lens(depth_topic, shape)
        if lens is None and self.plan.depth[depth_topic].is_aligned:
            # Depth that was laid over colour is described by the camera of the colour.
            partners = self.plan.partners[depth_topic]
            lens = next(filter(None, (self._lens(name, shape) for name in partners)), None)
        if lens is None:
            across, down = shape[::-1]
            self._leave_out(depth_topic, f"no CameraInfo of {across}x{down} px beside it")
            return
        seen = None
        if colour is not None:
            try:
                seen = self._coloured(depth, lens, colour)
            except ValueError as error:
                self._leave_out(colour.topic, str(error))
        if seen is None:
            seen = view_of_images(depth.depth_m, lens, None)
        if self._is_first(depth_topic):
            doubt = doubtful_rays(seen.depth_m, seen.intrinsics)
            if doubt:
                self._warn_once(depth_topic, doubt, "rays")
        yield replace(seen, frame_id=depth.frame_id, stamp_s=depth.stamp_s)

    def _coloured(self, depth: _Depth, lens: Lens, colour: _Colour) -> Frame:
        rgb = colour.photo.rgb
        seen_by = self._lens(colour.topic, rgb.shape[:2])
        pose = None
        where, whence = colour.frame_id.lstrip("/"), depth.frame_id.lstrip("/")
        if where != whence and where and whence and not self.plan.depth[depth.topic].is_aligned:
            pose = self.mounting.pose(where, whence)
            if pose is None:
                self._warn_once(
                    colour.topic,
                    f"in the frame {where}, depth in {whence}, and no static transform joins them: "
                    "taken for seen from one place",
                )
        if seen_by is None and where != whence:
            self._warn_once(
                colour.topic, f"no CameraInfo beside it: taken for that of {depth.topic}"
            )
        return view_of_images(depth.depth_m, lens, rgb, seen_by, pose)

    def _lens(self, topic: str, shape: tuple[int, ...]) -> Lens | None:
        """Return the lens of an image (h, w) of a topic; None where none is described, or usable.

        A description of another size is brought to that of the image where their sides agree.
        """
        message = self._cameras.get(_space(topic))
        if message is None:
            return None
        is_rectified = is_rectified_topic(topic)
        if is_rectified and not describes_rectified(message):
            self._warn_once(_space(topic), "its CameraInfo has no P for rectified images: taken K")
        try:
            lens = lens_from_message(message, is_rectified)
            return lens_of_size(lens, message, (shape[0], shape[1]))
        except ValueError as error:
            self._warn_once(_space(topic), f"its CameraInfo is of no use: {error}")
            return None

    def _leave_out(self, topic: str, reason: str) -> None:
        self._warn_once(topic, f"left out: {reason}")

    def add_colours(self, topic: str, message: Mapping[str, Any]) -> None:
        """Take a picture for the scale of its topic's colours, before any is read."""
        largest = deep_colours(message)
        if largest:
            self._scales.setdefault(topic, ColourScale()).bits_for(largest)

    def _scale_of(self, topic: str, message: Mapping[str, Any]) -> ColourScale:
        """Return the scale of a topic's colours; where it is a guess, that is said."""
        scale = self._scales.setdefault(topic, ColourScale())
        before, largest = scale.bits, deep_colours(message)
        if largest:
            bits = scale.bits_for(largest)
            about = "of one of its pictures" if before and bits > before else "so far"
            self._warn_once(
                topic,
                f"colours in 16 bits, and no encoding says how many of them count: {bits} are "
                f"taken, the fewest of a sensor that hold the brightest {about}",
                f"bits {bits}",
            )
        return scale

    def _is_first(self, topic: str) -> bool:
        """Whether a topic is asked about for the first time: to fit planes to each view is slow."""
        is_first = topic not in self._looked_at
        self._looked_at.add(topic)
        return is_first

    def _warn_once(self, topic: str, reason: str, about: str = "") -> None:
        if (topic, about) not in self._warned:
            self._warned.add((topic, about))
            self.warn(f"{topic}: {reason}")


def _stamp_s(message: Mapping[str, Any], recorded_s: float) -> float:
    """Return when a message was measured: by its header, or as it was recorded if that is empty."""
    stamp = message["header"]["stamp"]
    return float(stamp.sec + stamp.nanosec * 1e-9) or recorded_s


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
