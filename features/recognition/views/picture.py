"""Small picture of an object's view, kept beside its keypoints.

Keypoints say where two views agree. Whether the print between them agrees too, only pixels tell:
two products of one brand share an emblem, and differ beside it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["PICTURE_SIDE_PX", "ViewPicture", "take_picture"]

PICTURE_SIDE_PX = 320
"""Longer side of the largest picture; smaller views are kept as they are."""

_QUALITY = 92
_HEAD = struct.Struct("<fffI")
_MAX_PIXELS = 4 * PICTURE_SIDE_PX**2


@dataclass(frozen=True, eq=False)
class ViewPicture:
    """Pixels of one view inside the box of its mask.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
    mask : (h, w) bool
        Pixels of the object.
    scale
        Pixels of the picture per pixel of the image that it was taken from.
    left, top
        Corner of the box in that image, px.
    """

    rgb: UInt8Array
    mask: NDArray[np.bool_]
    scale: float
    left: float
    top: float

    @property
    def picture_from_image(self) -> NDArray[np.float64]:
        """Map (3, 3) of pixel centres of the image to those of the picture."""
        shift = 0.5 * self.scale - 0.5
        return np.array(
            [
                [self.scale, 0.0, shift - self.scale * self.left],
                [0.0, self.scale, shift - self.scale * self.top],
                [0.0, 0.0, 1.0],
            ]
        )

    @classmethod
    def from_bytes(cls, data: bytes | memoryview) -> ViewPicture:
        """Decode what :func:`take_picture` returned.

        Raises
        ------
        ValueError
            When the bytes are damaged.
        """
        try:
            scale, left, top, length = _HEAD.unpack_from(data)
        except struct.error as error:
            raise ValueError(f"these bytes are no picture of a view: {error}") from error
        raw = np.frombuffer(data, np.uint8, offset=_HEAD.size)
        image = _decoded(raw[:length], cv2.IMREAD_COLOR)
        mask = _decoded(raw[length:], cv2.IMREAD_GRAYSCALE)
        if image.shape[:2] != mask.shape or mask.size > _MAX_PIXELS:
            raise ValueError(f"a picture of {image.shape[:2]} px with a mask of {mask.shape} px")
        return cls(np.ascontiguousarray(image[..., ::-1]), mask > 127, scale, left, top)


def _decoded(data: UInt8Array, way: int) -> UInt8Array:
    image = cv2.imdecode(data, way) if len(data) else None
    if image is None:
        raise ValueError("the picture of a view cannot be decoded")
    return np.asarray(image, np.uint8)


def take_picture(rgb: UInt8Array, mask: NDArray[np.bool_]) -> bytes:
    """Return the encoded picture of the object under a mask.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
    mask : (h, w) bool
        Not empty.

    Returns
    -------
    bytes
        Scale and corner, the colours as JPEG, the mask as PNG.

    Examples
    --------
    >>> grey = np.full((40, 60, 3), 90, np.uint8)
    >>> mask = np.zeros((40, 60), bool); mask[10:30, 20:50] = True
    >>> picture = ViewPicture.from_bytes(take_picture(grey, mask))
    >>> picture.mask.shape, picture.left, picture.scale
    ((20, 30), 20.0, 1.0)
    """
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    inside = np.s_[top : top + height, left : left + width]
    crop, cover = rgb[inside], mask[inside].astype(np.uint8) * np.uint8(255)
    scale = min(1.0, PICTURE_SIDE_PX / max(width, height))
    if scale < 1.0:
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), np.uint8)
        cover = np.asarray(cv2.resize(cover, size, interpolation=cv2.INTER_AREA), np.uint8)
    jpeg = cv2.imencode(".jpg", crop[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    png = cv2.imencode(".png", np.where(cover > 127, 255, 0).astype(np.uint8))[1]
    return _HEAD.pack(scale, left, top, len(jpeg)) + jpeg.tobytes() + png.tobytes()
