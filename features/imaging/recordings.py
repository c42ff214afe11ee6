"""Recordings of ROS: bags of ROS 1 and ROS 2, and MCAP (extra ``recordings``; needs no ROS).

Depth is paired with the colour image nearest in time and with the CameraInfo beside its topic.
Depth and colour of one name space are taken for registered; transforms between cameras (tf) are not
followed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError, Limits
from features.codec.ros import image_bytes, pcd_from_point_cloud
from features.codec.sniff import decode
from features.codec.types import Cloud
from features.geometry import Frame
from features.imaging.camera import Lens, lens_from_message
from features.imaging.photo import Photo, read_photo
from features.imaging.pictures import PAIRED_S, depth_of_message, view_of_images

__all__ = ["first_view", "message_mapping", "views_of"]

_TYPES = tuple(
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo", "PointCloud2")
)

_DAMAGED = (ValueError, KeyError, IndexError, AssertionError, EOFError, MemoryError, struct.error)
"""Errors of the reader where bytes are none of a recording's."""


def first_view(path: Path, at_s: float = 0.0) -> Frame | Cloud | Photo:
    """Return the first view of a recording at or after a time.

    Depth with colour is preferred to a cloud, a cloud to a photograph.

    Parameters
    ----------
    path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a recording of ROS 2.
    at_s
        Time since the start of the recording, s.

    Raises
    ------
    CloudFormatError
        When it is no recording, or shows nothing from then on.
    """
    colour_only: Photo | None = None
    for seen in views_of(path, at_s):
        if not isinstance(seen, Photo):
            return seen
        colour_only = colour_only or seen
    if colour_only is None:
        raise CloudFormatError(f"no image and no cloud from {at_s:g} s on")
    return colour_only


def views_of(path: Path, from_s: float = 0.0) -> Iterator[Frame | Cloud | Photo]:
    """Yield the views of a recording in the order of their times; see :func:`first_view`.

    A colour image is a view of its own only where the recording holds no depth and no cloud.
    """
    from rosbags.highlevel import AnyReader, AnyReaderError

    try:
        with AnyReader([path]) as reader:
            wanted = [one for one in reader.connections if one.msgtype in _TYPES]
            pairing = _Pairing(has_space=_has_space([(c.topic, c.msgtype) for c in wanted]))
            start = reader.start_time + int(from_s * 1e9)
            for connection, time_ns, raw in reader.messages(connections=wanted):
                message = message_mapping(reader.deserialize(raw, connection.msgtype))
                seen = pairing.take(connection.topic, connection.msgtype, message, time_ns * 1e-9)
                if seen is not None and time_ns >= start:
                    yield seen
            rest = pairing.finish()
            if rest is not None:
                yield rest
    except (AnyReaderError, OSError) as error:
        raise CloudFormatError(f"no recording of ROS: {error}") from error
    except CloudFormatError:
        raise
    except _DAMAGED as error:
        raise CloudFormatError(f"no recording of ROS, or a damaged one: {error}") from error


def _has_space(topics: list[tuple[str, str]]) -> bool:
    """Tell whether any topic carries depth or clouds."""
    return any(
        kind.endswith("PointCloud2") or ("depth" in topic and not kind.endswith("CameraInfo"))
        for topic, kind in topics
    )


def message_mapping(message: Any) -> dict[str, Any]:
    """Return a message of :mod:`rosbags` as nested mappings, its bytes as they are."""
    told = dict(vars(message))
    if "header" in told:
        told["header"] = vars(told["header"])
    if "fields" in told:
        told["fields"] = [dict(vars(one)) for one in told["fields"]]
    return told


@dataclass
class _Pairing:
    """Joins depth, colour and cameras as messages come in.

    Parameters
    ----------
    has_space
        Whether depth or clouds are to be expected.
    """

    has_space: bool
    _lenses: dict[str, Lens] = field(default_factory=dict)
    _colour: tuple[float, str, Photo] | None = None
    _depth: tuple[float, str, NDArray[np.float32], str] | None = None

    def take(
        self, topic: str, kind: str, message: Mapping[str, Any], time_s: float
    ) -> Frame | Cloud | Photo | None:
        """Return the view that a message completes, if any."""
        if kind.endswith("CameraInfo"):
            try:
                self._lenses[_space(topic)] = lens_from_message(message)
            except ValueError as error:
                raise CloudFormatError(f"{topic}: {error}") from error
            return None
        if kind.endswith("PointCloud2"):
            seen = decode(pcd_from_point_cloud(message), Limits(stored_bytes=256 * 2**20))
            return replace(seen, stamp_s=time_s) if isinstance(seen, Cloud) else seen
        depth = depth_of_message(message, "depth" in topic.lower())
        if depth is not None:
            before = self.finish()
            self._depth = (time_s, topic, depth, str(message["header"]["frame_id"]))
            is_near = self._colour is not None and time_s - self._colour[0] < PAIRED_S / 4
            return before if before is not None or not is_near else self.finish()
        photo = read_photo(image_bytes(message))
        seen_before, waiting = self._colour, self._depth
        self._colour = (time_s, topic, photo)
        if not self.has_space:
            return photo
        if waiting is None:
            return None
        is_older = seen_before is not None and waiting[0] - seen_before[0] < time_s - waiting[0]
        return self.finish(seen_before if is_older else self._colour)

    def finish(self, colour: tuple[float, str, Photo] | None = None) -> Frame | None:
        """Return the depth that waits, with the colour that is near in time."""
        if self._depth is None:
            return None
        time_s, topic, depth, frame_id = self._depth
        self._depth = None
        lens = self._lenses.get(_space(topic))
        if lens is None or depth.shape != (lens.intrinsics.height, lens.intrinsics.width):
            raise CloudFormatError(f"{topic}: no CameraInfo of {depth.shape[::-1]} px beside it")
        colour = colour or self._colour
        if colour is None or abs(colour[0] - time_s) > PAIRED_S:
            seen = view_of_images(depth, lens, None)
        else:
            seen_by = self._lenses.get(_space(colour[1]), lens)
            try:
                seen = view_of_images(depth, lens, colour[2].rgb, seen_by)
            except ValueError as error:
                raise CloudFormatError(f"{colour[1]}: {error}") from error
        return replace(seen, frame_id=frame_id, stamp_s=time_s)


def _space(topic: str) -> str:
    """Return the name space of a topic, in which its CameraInfo lies.

    >>> _space("/camera/depth/image_raw"), _space("/camera/color/image_raw/compressed")
    ('/camera/depth', '/camera/color')
    """
    parts = topic.rstrip("/").split("/")
    if parts[-1] in ("compressed", "compressedDepth"):
        parts = parts[:-1]
    return "/".join(parts[:-1])
