"""PNG and JPEG inside a container: headers are read before a decoder is trusted with the bytes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.container import CODEC_JPEG, CODEC_PNG, Section
from features.codec.image_header import image_size
from features.codec.limits import CloudFormatError, Limits

__all__ = ["decode_image", "jpeg", "png"]

_MAGIC = {CODEC_PNG: b"\x89PNG", CODEC_JPEG: b"\xff\xd8"}

_SMALL_PX = 100_000
_FAST = [
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_SUB,
]
_TIGHT = [cv2.IMWRITE_PNG_COMPRESSION, 6, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]


def png(image: NDArray[Any]) -> Section:
    """Return an image as a PNG section; crops are packed tightly, whole frames fast.

    Depth changes by runs of equal steps: run lengths of differences are a tenth smaller than zlib's
    level 3 makes it, in a third of the time.
    """
    return _section(CODEC_PNG, ".png", image, _TIGHT if image.size < _SMALL_PX else _FAST)


def jpeg(image: NDArray[np.uint8], quality: int) -> Section:
    """Return an RGB image as a JPEG section."""
    flipped = np.ascontiguousarray(image[..., ::-1])
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    return _section(CODEC_JPEG, ".jpg", flipped, options)


def _section(codec: int, suffix: str, image: NDArray[Any], options: list[int]) -> Section:
    done, stored = cv2.imencode(suffix, image, options) if image.size else (False, np.empty(0))
    if not done:
        raise ValueError(f"cannot encode an image of shape {image.shape}, {image.dtype}")
    return Section(codec, stored.tobytes(), image.nbytes)


def decode_image(
    section: Section, shape: tuple[int, int], name: str, limits: Limits
) -> NDArray[Any]:
    """Decode a section that must be an image of ``shape`` (h, w); colour comes back as RGB."""
    if section.codec not in (CODEC_PNG, CODEC_JPEG):
        raise CloudFormatError(f"{name}: unknown codec {section.codec}")
    if not section.stored.startswith(_MAGIC[section.codec]):
        raise CloudFormatError(f"{name}: the section is not what its codec says")
    width, height = image_size(section.stored)
    limits.check_image(width, height)
    if (height, width) != shape:
        raise CloudFormatError(
            f"{name}: the image is {width}x{height} px, the header says {shape[1]}x{shape[0]}"
        )
    try:
        image = cv2.imdecode(np.frombuffer(section.stored, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise CloudFormatError(f"{name}: the image does not decode ({error.err})") from None
    if image is None or image.shape[:2] != shape:
        raise CloudFormatError(f"{name}: the image does not decode")
    return image[..., ::-1].copy() if image.ndim == 3 else image
