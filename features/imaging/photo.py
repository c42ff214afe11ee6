"""Photographs: decode pictures of any size within bounded time and memory."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.image_header import (
    bits_of,
    has_alpha,
    image_size,
    is_deep_grey,
    is_half_floats,
    more_pictures,
    orientation_of,
    transparent_grey,
)
from features.codec.limits import CloudFormatError
from features.geometry import UInt8Array

__all__ = ["MAX_PX", "MAX_SIDE_PX", "Photo", "read_photo"]

MAX_PX = 100_000_000
"""Largest photograph that is read, px."""
MAX_SIDE_PX = 16_384
"""Longest side of a photograph that is read, px."""

_ENOUGH_PX = 6_000_000
_MAX_ALPHA_PX = 25_000_000
"""Such pictures are decoded at their full size, with four channels."""
_MOSTLY_OPAQUE = 127
_TURNS = {3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}
_MIRRORED = (2, 4, 5, 7)
"""Orientations of EXIF: quarter turns to the left and, before them, a flip left to right."""
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
    opaque : (h, w) bool or None
        Pixels that are not transparent; what lies under the others was cut away and is black. None
        = all.
    doubt
        What of the file was not read, in a sentence; empty where all of it was.
    """

    rgb: UInt8Array
    full_size: tuple[int, int]
    opaque: NDArray[np.bool_] | None = None
    doubt: str = ""

    @property
    def scale(self) -> float:
        """Pixels of ``rgb`` for each pixel of the photograph, at most 1."""
        return float(self.rgb.shape[1] / self.full_size[0])


def read_photo(data: bytes, max_px: int = _ENOUGH_PX) -> Photo:
    """Decode a PNG, JPEG, WebP, BMP or TIFF; a large one at a half, quarter or eighth of its size.

    The decoder of JPEG leaves out what is not wanted, so that a photograph of 50 megapixels costs
    no more time and memory than one of 6.

    Parameters
    ----------
    max_px
        Larger photographs are reduced, at most eight times a side.

    Raises
    ------
    CloudFormatError
        When the bytes are none of these, are damaged, or declare more than :data:`MAX_PX`; when
        they are grey with 16 bits, which is depth or infrared, also where that is repeated as red,
        green and blue; or transparent altogether.
    """
    photo = replace(_read(data, max_px), doubt=more_pictures(data))
    # Depth of a metre in steps of 1 mm would be a black photograph.
    if bits_of(data) == 16 and (photo.rgb == photo.rgb[..., :1]).all():
        raise CloudFormatError(
            "16 bits, and red, green and blue are the same: depth or infrared saved as colours; a "
            "photograph has 8 bits a channel"
        )
    return photo


def _read(data: bytes, max_px: int) -> Photo:
    """Decode a picture of at most so many pixels; see :func:`read_photo`."""
    width, height = image_size(data)
    if width < 1 or height < 1:
        raise CloudFormatError(f"the image has no pixels: {width}x{height}")
    if width * height > MAX_PX or max(width, height) > MAX_SIDE_PX:
        raise CloudFormatError(
            f"image of {width}x{height} px; at most {MAX_SIDE_PX} px a side and {MAX_PX} px in all "
            "are accepted"
        )
    if is_deep_grey(data):
        raise CloudFormatError(
            "grey of 16 bits, which is depth or infrared: a photograph has 8 bits a channel"
        )
    if is_half_floats(data):
        raise CloudFormatError("a TIFF of 16-bit numbers with decimals; save it with 8 bits")
    if has_alpha(data):
        cut_out = _read_with_alpha(data, width * height, max_px)
        if cut_out is not None:
            return cut_out
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


def _read_with_alpha(data: bytes, size_px: int, max_px: int) -> Photo | None:
    """Decode a picture with transparent pixels; None if it proves to have none."""
    if size_px > _MAX_ALPHA_PX:
        raise CloudFormatError(
            f"image of {size_px} px with transparency; at most {_MAX_ALPHA_PX} px are accepted"
        )
    image = _with_four_channels(data)
    if image is None:
        if data[:2] in (b"II", b"MM"):  # OpenCV drops the alpha of a grey TIFF
            raise CloudFormatError("a grey TIFF with transparency: save it as PNG")
        return None
    opaque = image[..., 3] > _MOSTLY_OPAQUE
    if not opaque.any() and not data.startswith(b"BM"):  # a bitmap may leave its alpha unused
        raise CloudFormatError("every pixel of the image is transparent")
    if opaque.all() or not opaque.any():
        return None
    full_size = (image.shape[1], image.shape[0])
    rgb = np.where(opaque[..., None], image[..., 2::-1], 0).astype(np.uint8)
    by = next((by for by in _REDUCED if size_px <= max_px * by * by), 8)
    if by > 1:
        smaller = (-(-full_size[0] // by), -(-full_size[1] // by))
        rgb = np.asarray(cv2.resize(rgb, smaller, interpolation=cv2.INTER_AREA), np.uint8)
        mask = cv2.resize(opaque.astype(np.uint8), smaller, interpolation=cv2.INTER_NEAREST)
        opaque = np.asarray(mask > 0)
    return Photo(np.ascontiguousarray(rgb), full_size, opaque)


def _with_four_channels(data: bytes) -> UInt8Array | None:
    """Decode BGR and alpha, upright; None if there is no alpha."""
    try:
        image, kinds, parts = cv2.imdecodeWithMetadata(
            np.frombuffer(data, np.uint8), flags=cv2.IMREAD_UNCHANGED
        )
    except cv2.error as error:
        raise CloudFormatError(f"the image does not decode ({error.err})") from None
    if image is None:
        raise CloudFormatError("the image does not decode")
    key = transparent_grey(data)
    if key is not None and image.ndim == 2:  # of colours, OpenCV makes alpha itself
        image = np.dstack([image, image, image, np.where(image == key, 0, 255).astype(np.uint8)])
    if image.ndim != 3 or image.shape[2] != 4:
        return None
    if image.dtype == np.uint16:
        image = (np.asarray(image, np.uint16) >> 8).astype(np.uint8)
    exif = (
        np.asarray(part).tobytes()
        for kind, part in zip(kinds, parts, strict=False)
        if kind == cv2.IMAGE_METADATA_EXIF
    )
    orientation = orientation_of(next(exif, b""))
    if orientation in _MIRRORED:
        image = image[:, ::-1]
    turned = np.rot90(image, _TURNS.get(orientation, 0))
    return np.ascontiguousarray(turned, dtype=np.uint8)
