"""Depth and colour images of a camera as one view, from the messages of ROS.

Depth and colour are taken for registered, or for seen from one place, unless it is said how the
cameras stand to one another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.compressed_depth import decode_compressed_depth, is_compressed_depth
from features.codec.ros import DEPTH_ENCODINGS, image_bytes, pixels_of_image, raw_data
from features.depth import depth_of_metres, depth_of_steps
from features.geometry import (
    Float64Array,
    Frame,
    UInt8Array,
)
from features.imaging.camera import Lens, align_colour, undistorted

__all__ = [
    "PAIRED_S",
    "depth_of_message",
    "view_of_images",
]

PAIRED_S = 0.1
"""Longest time between depth and the colour that belongs to it, s."""


def depth_of_message(
    message: Mapping[str, Any], is_depth_topic: bool, say: Callable[[str], None] | None = None
) -> NDArray[np.float32] | None:
    """Return the depth (h, w), m, of an Image or CompressedImage; None if it is no depth image.

    Parameters
    ----------
    is_depth_topic
        Whether the name of the topic says that it carries depth. ``mono16`` and compressed images
        may as well be infrared or thermal: they are depth only where the topic says so.
    say
        Called with a sentence for numbers that are taken for not measured.

    Raises
    ------
    CloudFormatError
        The parts of the message do not fit together.
    """
    if "encoding" not in message:
        if is_compressed_depth(message):
            return decode_compressed_depth(str(message["format"]), raw_data(message), say=say)
        if not is_depth_topic:
            return None
        stored = np.frombuffer(image_bytes(message), np.uint8)
        pixels = cv2.imdecode(stored, cv2.IMREAD_UNCHANGED)
        if pixels is None or pixels.ndim != 2:
            return None
        if pixels.dtype == np.float32:  # a TIFF of metres
            return depth_of_metres(np.asarray(pixels, np.float32), say)
        return depth_of_steps(pixels, say=say) if pixels.dtype == np.uint16 else None
    is_grey = message["encoding"] == "mono16" and is_depth_topic
    if not is_grey and message["encoding"] not in DEPTH_ENCODINGS:
        return None
    values = pixels_of_image(message)
    if values.dtype == np.float32:
        return depth_of_metres(values, say)
    return depth_of_steps(values, say=say)


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
