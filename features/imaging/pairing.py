"""Joins depth, colour and cameras of a recording as their messages come in."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import Limits
from features.codec.ros import ColourScale, deep_colours, image_bytes, pcd_from_point_cloud
from features.codec.sniff import decode
from features.codec.types import Cloud
from features.geometry import Float64Array, Frame
from features.imaging.camera import (
    Lens,
    baseline_m,
    describes_rectified,
    doubtful_size,
    has_same_rays,
    lens_from_message,
    lens_of_size,
)
from features.imaging.described import CameraDescriptions, name_space, stamp_of
from features.imaging.doubts import (
    doubtful_bytes,
    doubtful_camera,
    doubtful_distortion,
    doubtful_inverse,
    doubtful_rays,
    doubtful_steps,
    implausible_cloud,
    implausible_depth,
)
from features.imaging.mounting import Mounting
from features.imaging.photo import Photo, read_photo
from features.imaging.pictures import PAIRED_S, depth_of_message, view_of_images
from features.imaging.placed import in_camera_frame
from features.imaging.topics import Plan, is_rectified_topic, sensor_of

__all__ = ["Pairing"]

_STORED_BYTES = 256 * 2**20
_MILLIMETRE = 0.001
_AT_ONCE_S = 0.002
"""Colour so near in time needs no look at the next one."""
_MOST_WAITING, _LONGEST_WAIT_S = 8, 0.5
_MOST_COLOURS = 16
_ONE_CLOCK_S = 1.0
"""Stamps of two topics are of one clock if both were recorded about as long after them."""


class _Image(NamedTuple):
    """What all images have: times, topic, frame, and how many cameras were described by then."""

    recorded_s: float
    stamp_s: float
    topic: str
    frame_id: str
    described: int


class _Depth(NamedTuple):
    of: _Image
    depth_m: NDArray[np.float32]


class _Colour(NamedTuple):
    of: _Image
    photo: Photo


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
    lags_s
        How long after the stamps of its headers a topic was recorded, s; only of topics whose
        stamps tell time.
    frames
        Frames of a topic's first images.
    from_s
        Views that were recorded before are not wanted, s.
    """

    plan: Plan
    warn: Callable[[str], None]
    mounting: Mounting = field(default_factory=Mounting)
    units_m: dict[str, float] = field(default_factory=dict)
    lags_s: dict[str, float] = field(default_factory=dict)
    frames: dict[str, set[str]] = field(default_factory=dict)
    from_s: float = 0.0
    cameras: CameraDescriptions = field(default_factory=CameraDescriptions)
    _colours: dict[str, deque[_Colour]] = field(default_factory=dict)
    _depths: dict[str, deque[_Depth]] = field(default_factory=dict)
    _warned: set[tuple[str, str]] = field(default_factory=set)
    _looked_at: set[str] = field(default_factory=set)
    _scales: dict[str, ColourScale] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for topic, reason in self.plan.left_out.items():
            self._leave_out(topic, reason)
        for topic, doubt in self.plan.doubts.items():
            self._warn_once(topic, doubt)

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
            yield from self._settle(topic, is_last=True)

    def _take(
        self, topic: str, kind: str, message: Mapping[str, Any], time_s: float
    ) -> Iterator[Frame | Cloud | Photo]:
        if kind.endswith("CameraInfo"):
            self.cameras.add(topic, message)
        elif kind.endswith("PointCloud2"):
            if time_s >= self.from_s:
                yield self._cloud(topic, message, time_s)
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
            yield from self._take_colour(_Colour(self._image(topic, message, time_s), photo))

    def _image(self, topic: str, message: Mapping[str, Any], recorded_s: float) -> _Image:
        frame_id = str(message["header"]["frame_id"])
        return _Image(recorded_s, stamp_of(message), topic, frame_id, self.cameras.count)

    def _cloud(self, topic: str, message: Mapping[str, Any], recorded_s: float) -> Frame | Cloud:
        seen = decode(pcd_from_point_cloud(message), Limits(stored_bytes=_STORED_BYTES))
        if not isinstance(seen, Cloud):
            return seen
        doubt = implausible_cloud(seen.positions)
        if not doubt:
            # Each is brought to the frame of its camera, as clouds of files are.
            seen, doubt = in_camera_frame(seen)
        if doubt:
            self._warn_once(topic, doubt)
        return replace(seen, stamp_s=stamp_of(message) or recorded_s)

    def _take_depth(
        self, topic: str, message: Mapping[str, Any], depth_m: NDArray[np.float32], time_s: float
    ) -> Iterator[Frame]:
        unit_m = self.units_m.get(sensor_of(topic), _MILLIMETRE)
        if topic not in self._looked_at:
            self._say_steps(topic, message, depth_m, is_usual=unit_m == _MILLIMETRE)
        depth_m = np.asarray(depth_m * np.float32(unit_m / _MILLIMETRE))
        doubt = implausible_depth(depth_m)
        if doubt:
            self._warn_once(topic, doubt)
        seen = _Depth(self._image(topic, message, time_s), depth_m)
        self._depths.setdefault(topic, deque()).append(seen)
        yield from self._settle(topic)

    def _say_steps(
        self, topic: str, message: Mapping[str, Any], depth_m: NDArray[np.float32], is_usual: bool
    ) -> None:
        """Say what of whole numbers is doubtful: the order of their bytes, or their unit."""
        doubt = doubtful_bytes(message)
        is_whole = not str(message.get("encoding", message.get("format"))).startswith(("32", "64"))
        if not doubt and is_whole and is_usual:
            doubt = doubtful_steps(np.rint(depth_m / _MILLIMETRE).astype(np.int64))
        if doubt:
            self._warn_once(topic, doubt, "steps")

    def _take_colour(self, colour: _Colour) -> Iterator[Frame | Photo]:
        topic = colour.of.topic
        if not self.plan.depth and not self.plan.has_clouds:
            if colour.of.recorded_s >= self.from_s:
                yield colour.photo
            return
        self._colours.setdefault(topic, deque(maxlen=_MOST_COLOURS)).append(colour)
        for name in list(self._depths):
            if topic in self.plan.partners.get(name, ()):
                yield from self._settle(name)

    def _settle(self, topic: str, is_last: bool = False) -> Iterator[Frame]:
        """Yield the depth of a topic whose colour is known, the oldest first.

        Messages are recorded as they arrive, and a compressed picture arrives later than the depth
        of the same moment: the nearest is known once a later picture has come.
        """
        waiting = self._depths[topic]
        while waiting:
            depth = waiting[0]
            partners = self.plan.partners.get(topic, ())
            colours = [colour for name in partners for colour in self._colours.get(name, ())]
            # Of two cameras that share their topics, each has the pictures of its own frame.
            if any(depth.of.frame_id in self.frames.get(name, ()) for name in partners):
                colours = [each for each in colours if each.of.frame_id == depth.of.frame_id]
            apart = [(self._apart_s(depth, colour), colour) for colour in colours]
            off, colour = min(apart, key=lambda pair: abs(pair[0]), default=(0.0, None))
            is_decided = any(pair[0] >= 0 for pair in apart) or (
                colour is not None and abs(off) <= _AT_ONCE_S
            )
            waited_s = waiting[-1].of.recorded_s - depth.of.recorded_s
            has_waited = len(waiting) > _MOST_WAITING or waited_s > _LONGEST_WAIT_S
            is_alone = not partners and len(waiting) > 1
            if not (is_decided or has_waited or is_alone or is_last):
                return
            waiting.popleft()
            if depth.of.recorded_s >= self.from_s:
                yield from self._join(depth, colour if abs(off) <= PAIRED_S else None)

    def _apart_s(self, depth: _Depth, colour: _Colour) -> float:
        """Return how much later than depth a picture was taken, s."""
        lags = [self.lags_s.get(each.of.topic) for each in (depth, colour)]
        recorded = colour.of.recorded_s - depth.of.recorded_s
        if lags[0] is None or lags[1] is None:
            return recorded
        if abs(lags[0] - lags[1]) > _ONE_CLOCK_S:
            self._warn_once(
                colour.of.topic,
                f"its stamps are of another clock than those of {depth.of.topic}: paired by when "
                "they were recorded",
                "clock",
            )
            return recorded
        return colour.of.stamp_s - depth.of.stamp_s

    def _join(self, depth: _Depth, colour: _Colour | None) -> Iterator[Frame]:
        """Yield depth, with the colour that belongs to it if there is one."""
        topic, shape = depth.of.topic, depth.depth_m.shape
        lens = self._lens(depth.of, shape)
        if lens is None and self.plan.depth[topic].is_aligned:
            # Depth that was laid over colour is described by the camera of the colour.
            partners = self.plan.partners[topic]
            images = [depth.of._replace(topic=name, frame_id="") for name in partners]
            lens = next(filter(None, (self._lens(image, shape) for image in images)), None)
        if lens is None:
            across, down = shape[::-1]
            self._leave_out(topic, f"no CameraInfo of {across}x{down} px beside it")
            return
        seen = None
        if colour is not None:
            try:
                seen = self._coloured(depth, lens, colour)
            except ValueError as error:
                self._leave_out(colour.of.topic, str(error))
        if seen is None:
            seen = view_of_images(depth.depth_m, lens, None)
        if self._is_first(topic):
            doubt = doubtful_distortion(depth.depth_m, seen.depth_m)
            doubt = doubt or doubtful_inverse(depth.depth_m)
            doubt = doubt or doubtful_rays(seen.depth_m, seen.intrinsics)
            if doubt:
                self._warn_once(topic, doubt, "rays")
        stamp_s = depth.of.stamp_s or depth.of.recorded_s
        yield replace(seen, frame_id=depth.of.frame_id, stamp_s=stamp_s)

    def _coloured(self, depth: _Depth, lens: Lens, colour: _Colour) -> Frame:
        rgb = colour.photo.rgb
        seen_by = self._lens(colour.of, rgb.shape[:2])
        pose = None
        if not self.plan.depth[depth.of.topic].is_aligned:
            pose = self._colour_from_depth(depth, lens, colour, seen_by)
        if seen_by is None and colour.of.frame_id.lstrip("/") != depth.of.frame_id.lstrip("/"):
            self._warn_once(
                colour.of.topic, f"no CameraInfo beside it: taken for that of {depth.of.topic}"
            )
        return view_of_images(depth.depth_m, lens, rgb, seen_by, pose)

    def _colour_from_depth(
        self, depth: _Depth, lens: Lens, colour: _Colour, seen_by: Lens | None
    ) -> Float64Array | None:
        """Return the pose of the camera of depth in that of colour; None = one place.

        Transforms between their frames say it; RealSense's SDK records one for each stream; and
        rectified cameras in one frame are told apart by the baseline in P.
        """
        topics = colour.of.topic, depth.of.topic
        where, whence = colour.of.frame_id.lstrip("/"), depth.of.frame_id.lstrip("/")
        if where != whence and where and whence:
            pose = self.mounting.pose(where, whence)
            between = f"in the frame {where}, depth in {whence}, and no static transform joins them"
        elif all(map(sensor_of, topics)):
            pose = self.mounting.pose(*map(name_space, topics))
            between = f"nothing says where it is beside {name_space(topics[1])}"
        else:
            pose = self._rectified_baseline(depth, colour)
            if pose is not None or seen_by is None or has_same_rays(lens, seen_by):
                return pose
            between = f"of another camera than {topics[1]}, and no frame tells them apart"
        if pose is None:
            self._warn_once(topics[0], f"{between}: taken for seen from one place", "place")
        return pose

    def _rectified_baseline(self, depth: _Depth, colour: _Colour) -> Float64Array | None:
        """Return the pose that the baselines in P say; None where they say no difference."""
        baselines = np.zeros((2, 2))
        for row, image in enumerate((colour.of, depth.of)):
            described = self._described(image)
            if described is not None and is_rectified_topic(image.topic):
                baselines[row] = baseline_m(described)
        apart = baselines[0] - baselines[1]
        if not apart.any():
            return None
        pose = np.eye(4)
        pose[:2, 3] = apart
        return pose

    def _described(self, image: _Image) -> Mapping[str, Any] | None:
        """Return the CameraInfo of an image; None where none lies beside it."""
        described, doubt = self.cameras.find(
            image.topic, image.frame_id, image.stamp_s, image.described
        )
        of_depth = self.plan.depth.get(image.topic)
        if doubt and not (of_depth is not None and of_depth.is_aligned):
            self._warn_once(image.topic, doubt, "frame")
        return None if described is None else described.message

    def _lens(self, image: _Image, shape: tuple[int, ...]) -> Lens | None:
        """Return the lens of an image (h, w) of a topic; None where none is described, or usable.

        A description of another size is brought to that of the image where their sides agree.
        """
        message = self._described(image)
        if message is None:
            return None
        space = name_space(image.topic)
        is_rectified = is_rectified_topic(image.topic)
        if is_rectified and not describes_rectified(message):
            self._warn_once(space, "its CameraInfo has no P for rectified images: taken K")
        try:
            lens = lens_from_message(message, is_rectified)
            fitting = lens_of_size(lens, message, (shape[0], shape[1]))
        except ValueError as error:
            self._warn_once(space, f"its CameraInfo is of no use: {error}")
            return None
        doubt = doubtful_camera(lens.intrinsics)
        if doubt:
            self._warn_once(space, doubt, "camera")
        doubt = doubtful_size(lens, message, shape)
        if doubt:
            self._warn_once(image.topic, doubt, "size")
        aside = baseline_m(message) if is_rectified and image.topic in self.plan.depth else (0, 0)
        if any(aside):
            self._warn_once(
                image.topic,
                f"by its P it is {np.hypot(*aside):.3g} m beside its frame {image.frame_id}: "
                "places in other frames are off by that",
                "beside",
            )
        return fitting

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
