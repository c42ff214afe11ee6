"""Photographs: decode PNG and JPEG of any size within bounded time and memory."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from features.codec.image import image_size
from features.codec.limits import CloudFormatError
from features.geometry import UInt8Array

__all__ = ["MAX_PX", "MAX_SIDE_PX", "Photo", "read_photo"]

MAX_PX = 100_000_000
"""Largest photograph that is read, px."""
MAX_SIDE_PX = 16_384
"""Longest side of a photograph that is read, px."""

_ENOUGH_PX = 6_000_000
_REDUCED = {
    1: cv2.IMREAD_COLOR_RGB,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    8: cv2.IMREAD_REDUCED_COLOR_8,
}


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded photograph.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
        Turned upright as its EXIF data say.
    full_size
        Width and height before it was reduced, px.
    """

    rgb: UInt8Array
    full_size: tuple[int, int]

    @property
    def scale(self) -> float:
        """Pixels of ``rgb`` for each pixel of the photograph, at most 1."""
        return float(self.rgb.shape[1] / self.full_size[0])


def read_photo(data: bytes, max_px: int = _ENOUGH_PX) -> Photo:
    """Decode a PNG or JPEG; a large one at a half, a quarter or an eighth of its resolution.

    The decoder of JPEG leaves out what is not wanted, so that a photograph of 50 megapixels costs
    no more time and memory than one of 6.

    Parameters
    ----------
    max_px
        Larger photographs are reduced, at most eight times a side.

    Raises
    ------
    CloudFormatError
        When the bytes are neither, are damaged, or declare more than :data:`MAX_PX`.
    """
    width, height = image_size(data)
    if width < 1 or height < 1:
        raise CloudFormatError(f"the image has no pixels: {width}x{height}")
    if width * height > MAX_PX or max(width, height) > MAX_SIDE_PX:
        raise CloudFormatError(
            f"image of {width}x{height} px; at most {MAX_SIDE_PX} px a side and {MAX_PX} px in all "
            "are accepted"
        )
    by = next((by for by in _REDUCED if width * height <= max_px * by * by), 8)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _REDUCED[by])
    except cv2.error as error:
        raise CloudFormatError(f"the image does not decode ({error.err})") from None
    if image is None:
        raise CloudFormatError("the image does not decode")
    if by > 1:
        image = image[..., ::-1]
    is_turned = (image.shape[1] > image.shape[0]) != (width > height)
    full_size = (height, width) if is_turned else (width, height)
    return Photo(np.ascontiguousarray(image, dtype=np.uint8), full_size)
