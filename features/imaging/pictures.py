"""Depth and colour images of a camera as one view, from the messages of ROS.

Depth and colour are taken for registered, or for seen from one place, unless it is said how the
cameras stand to one another.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.compressed_depth import decode_compressed_depth, is_compressed_depth
from features.codec.ros import DEPTH_ENCODINGS, image_bytes, pixels_of_image, raw_data
from features.geometry import (
    Float64Array,
    FloatArray,
    Frame,
    UInt8Array,
    depth_of_steps,
    finite_depth,
)
from features.imaging.camera import Lens, align_colour, undistorted

__all__ = [
    "PAIRED_S",
    "depth_of_message",
    "doubtful_frame",
    "implausible_cloud",
    "implausible_depth",
    "implausible_object",
    "view_of_images",
]

PAIRED_S = 0.1
"""Longest time between depth and the colour that belongs to it, s."""

_NEAREST_M, _FARTHEST_M = 0.1, 6.0
"""Median depth of what a camera at a table may see."""
_WIDEST_M = 10.0
"""Median distance from their middle of the points that it may see."""
_BEHIND = 0.01
"""Share of points behind a camera that errors of measurement do not explain."""
_UPRIGHT_FRAMES = ("base_footprint", "base_link", "base", "odom", "map", "world")
_LARGEST_OBJECT_M = 3.0
"""Median distance of an object's points from their middle; a box of millimetres has some 50."""


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


def implausible_cloud(positions: NDArray[np.float32]) -> str:
    """Return why the unit of points (n, 3), m, is doubtful; empty if it is plausible.

    What a robot sees of a table lies together, wherever the origin is.

    Examples
    --------
    >>> implausible_cloud(np.array([[0, 0, 700], [90, 0, 730], [-80, 10, 690]], np.float32))
    'half of the points lie 81.2 m apart from their middle: are they in another unit?'
    """
    return _apart(positions, _WIDEST_M)


def doubtful_frame(positions: NDArray[np.float32], frame_id: str) -> str:
    """Return why points (n, 3), m, may not be in a camera's frame; empty if they may be.

    A camera has x to the right, y down and z forward (REP 103) and sees nothing behind itself; the
    frames of a robot and of maps have z up (REP 105).

    Examples
    --------
    >>> ahead = np.array([[0.1, 0.2, 0.7]], np.float32)
    >>> doubtful_frame(ahead, "camera_depth_optical_frame")
    ''
    >>> doubtful_frame(ahead, "nao1/base_link")
    'in the frame nao1/base_link, which has z up: it is read as that of a camera, z forward'
    """
    behind = float((positions[:, 2] < 0).mean()) if len(positions) else 0.0
    if behind > _BEHIND:
        return f"{behind:.0%} of the points lie behind the camera: is z forward in their frame?"
    if frame_id.rpartition("/")[2] in _UPRIGHT_FRAMES:
        return f"in the frame {frame_id}, which has z up: it is read as that of a camera, z forward"
    return ""


def implausible_object(positions: FloatArray) -> str:
    """Return why the unit of the points (n, 3), m, of one object is doubtful; empty if plausible.

    Examples
    --------
    >>> implausible_object(np.array([[0, 0, 700], [9, 0, 730], [-8, 10, 690]], np.float32))
    'half of the points lie 16.2 m apart from their middle: are they in another unit?'
    """
    return _apart(positions, _LARGEST_OBJECT_M)


def _apart(positions: FloatArray, most_m: float) -> str:
    if not len(positions):
        return ""
    off = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    apart = float(np.median(off))
    if apart <= most_m:
        return ""
    return (
        f"half of the points lie {apart:.3g} m apart from their middle: are they in another unit?"
    )


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
        return depth_of_steps(pixels)
    is_grey = message["encoding"] == "mono16" and is_depth_topic
    if not is_grey and message["encoding"] not in DEPTH_ENCODINGS:
        return None
    values = pixels_of_image(message)
    if values.dtype == np.float32:
        return finite_depth(values)
    return depth_of_steps(values)


def view_of_images(
    depth_m: NDArray[np.float32],
    depth_lens: Lens,
    rgb: UInt8Array | None,
    colour_lens: Lens | None = None,
    colour_from_depth: Float64Array | None = None,
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
    colour_from_depth : (4, 4), m, or None
        Pose of the depth camera in the frame of the colour camera; None = one place.

    Raises
    ------
    ValueError
        An image has another size than its camera, or colour and depth show different parts.
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
    if colour_lens is None and rgb.shape[:2] != size:
        if colour_from_depth is not None:
            raise ValueError("colour from another place needs a camera of its own")
        return align_colour(straight, depth_lens.intrinsics, rgb)
    seen_by = colour_lens or depth_lens
    across, down = seen_by.intrinsics.width, seen_by.intrinsics.height
    if rgb.shape[:2] != (down, across):
        raise ValueError(
            f"colour of {rgb.shape[1]}x{rgb.shape[0]} px is not from the camera of "
            f"{across}x{down} px"
        )
    flat, _ = undistorted(seen_by, rgb)
    assert flat is not None
    return align_colour(
        straight, depth_lens.intrinsics, flat, seen_by.intrinsics, colour_from_depth
    )
