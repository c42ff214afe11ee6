"""Depth and colour images of a camera as one view, from the messages of ROS.

Depth and colour are taken for registered, or for seen from one place: transforms between two
cameras are not followed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.compressed_depth import decode_compressed_depth, is_compressed_depth
from features.codec.ros import image_bytes, pixels_of_image, raw_data
from features.geometry import Frame, UInt8Array, finite_depth
from features.imaging.camera import Lens, align_colour, undistorted

__all__ = [
    "PAIRED_S",
    "depth_of_message",
    "implausible_depth",
    "is_infrared_topic",
    "is_rectified_topic",
    "view_of_images",
]

PAIRED_S = 0.1
"""Longest time between depth and the colour that belongs to it, s."""

_DEPTH = ("16UC1", "32FC1")
_INFRARED = re.compile(r"(^|[/_])(ir|infra\d*|infrared\d*|infrared_\d+|thermal|lwir)([/_]|$)", re.I)
_NEAREST_M, _FARTHEST_M = 0.05, 10.0
"""Median depth of what a camera at a table may see."""


def is_infrared_topic(topic: str) -> bool:
    """Whether the name of a topic says that its images are infrared or thermal.

    Examples
    --------
    >>> is_infrared_topic("/camera/infra1/image_rect_raw"), is_infrared_topic("/camera/first/image")
    (True, False)
    """
    return _INFRARED.search(topic) is not None


def is_rectified_topic(topic: str) -> bool:
    """Whether images of a topic were rectified before they were published (``image_proc``).

    Examples
    --------
    >>> is_rectified_topic("/camera/rgb/image_rect_color/compressed")
    True
    """
    return any(part.startswith("image_rect") for part in topic.split("/"))


def implausible_depth(depth_m: NDArray[np.float32]) -> str:
    """Return why the unit of a depth image is doubtful; empty if it is plausible.

    Examples
    --------
    >>> implausible_depth(np.full((2, 2), 700.0, np.float32))
    'half of the depth lies beyond 700 m: is it in another unit?'
    """
    measured = depth_m[depth_m > 0]
    if not len(measured):
        return ""
    middle = float(np.median(measured))
    if middle > _FARTHEST_M:
        return f"half of the depth lies beyond {middle:.3g} m: is it in another unit?"
    if middle < _NEAREST_M:
        return f"half of the depth lies within {middle:.3g} m: is it in another unit?"
    return ""


def depth_of_message(
    message: Mapping[str, Any], is_depth_topic: bool
) -> NDArray[np.float32] | None:
    """Return the depth (h, w), m, of an Image or CompressedImage; None if it is no depth image.

    Parameters
    ----------
    is_depth_topic
        Whether the name of the topic says that it carries depth. ``mono16`` and compressed images
        may as well be infrared or thermal: they are depth only where the topic says so.

    Raises
    ------
    CloudFormatError
        The parts of the message do not fit together.
    """
    if "encoding" not in message:
        if is_compressed_depth(message):
            return decode_compressed_depth(str(message["format"]), raw_data(message))
        if not is_depth_topic:
            return None
        stored = np.frombuffer(image_bytes(message), np.uint8)
        pixels = cv2.imdecode(stored, cv2.IMREAD_UNCHANGED)
        if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
            return None
        return np.asarray(pixels * 0.001, dtype=np.float32)
    is_grey = message["encoding"] == "mono16" and is_depth_topic
    if not is_grey and message["encoding"] not in _DEPTH:
        return None
    values = pixels_of_image(message)
    if values.dtype == np.float32:
        return finite_depth(values)
    return np.asarray(values * 0.001, dtype=np.float32)


def view_of_images(
    depth_m: NDArray[np.float32],
    depth_lens: Lens,
    rgb: UInt8Array | None,
    colour_lens: Lens | None = None,
) -> Frame:
    """Return depth with colour at each of its pixels, in the pinhole of the depth camera.

    Parameters
    ----------
    depth_m : (h, w) float32, m
        0 = missing.
    depth_lens
        Of ``depth_m``.
    rgb : (k, l, 3) uint8 or None
    colour_lens
        Of ``rgb``; None = that of depth, at the size of ``rgb``.

    Raises
    ------
    ValueError
        The depth has another size than its camera, or colour and depth show different parts.
    """
    size = (depth_lens.intrinsics.height, depth_lens.intrinsics.width)
    if depth_m.shape != size:
        raise ValueError(
            f"depth of {depth_m.shape[1]}x{depth_m.shape[0]} px is not from the camera of "
            f"{size[1]}x{size[0]} px"
        )
    _, straight = undistorted(depth_lens, None, depth_m)
    assert straight is not None
    if rgb is None:
        return Frame(straight, depth_lens.intrinsics)
    seen_by = colour_lens or depth_lens
    if rgb.shape[:2] != (seen_by.intrinsics.height, seen_by.intrinsics.width):
        return align_colour(straight, depth_lens.intrinsics, rgb)
    flat, _ = undistorted(seen_by, rgb)
    assert flat is not None
    return align_colour(straight, depth_lens.intrinsics, flat, seen_by.intrinsics)
