"""Outlines of objects in an image, before a plain background (Kehoe 2014, 3.7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray

__all__ = ["rings_from_image"]

_MIN_HOLE = 1e-3
"""Of an object: smaller ones are glare."""
_MIN_PART = 0.05
"""Of the largest object: smaller ones are dirt."""
_FINER = 3


def rings_from_image(data: bytes | NDArray[np.uint8]) -> list[FloatArray]:
    """Return the contours of an object before a plain background, pixels, y upwards.

    Kehoe 2014, 3.7: the part is imaged on a board and contoured. The object is what differs from
    the border of the image; its outline comes first, then the holes through which the background
    is seen, then the outlines of further objects that are not much smaller. Where an outline comes
    back over its own pixels, along a line or a neck of one pixel's width, it is traced on a grid
    three times finer, two thirds of a pixel further out.

    Parameters
    ----------
    data
        An encoded image, or pixels (h, w) or (h, w, 3) uint8.
    """
    import cv2

    if isinstance(data, bytes):
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
        if decoded is None:
            raise ValueError("no image that can be decoded")
        pixels = np.asarray(decoded)
    else:
        pixels = np.asarray(data)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.ndim != 3 or min(pixels.shape[:2]) < 8:
        raise ValueError(f"an image of at least 8 x 8 pixels is needed, got {pixels.shape}")
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    difference = np.abs(pixels.astype(np.int16) - np.median(border, axis=0)).max(axis=2)
    _, mask = cv2.threshold(
        difference.astype(np.uint8), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU
    )
    if difference.max() < 16:
        raise ValueError("nothing stands out from the image's border")
    mask = np.pad(np.asarray(mask, np.uint8), 1)
    rings = _traced(mask)
    if any(len(np.unique(ring, axis=0)) < len(ring) for ring in rings):
        # Widened by a third of a pixel, so that pixels which meet at a corner are joined as well.
        fine = np.kron(mask, np.ones((_FINER, _FINER), np.uint8))
        fine = np.asarray(cv2.dilate(fine, np.ones((3, 3), np.uint8)), np.uint8)
        rings = [(ring - _FINER // 2) / _FINER for ring in _traced(fine)]
    return [np.asarray((ring - 1.0) * (1.0, -1.0)) for ring in rings]


def _traced(mask: NDArray[np.uint8]) -> list[NDArray[Any]]:
    """Return the largest object's outline (n, 2), px, its holes, and what is not much smaller."""
    import cv2

    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outer = max((k for k in range(len(contours)) if tree[0][k][3] < 0),
                key=lambda k: cv2.contourArea(contours[k]))  # fmt: skip
    area = cv2.contourArea(contours[outer])
    if len(contours[outer]) < 8:
        raise ValueError("nothing large enough stands out from the image's border")
    inner = [k for k in range(len(contours)) if tree[0][k][3] == outer
             and cv2.contourArea(contours[k]) >= _MIN_HOLE * area]  # fmt: skip
    beside = [k for k in range(len(contours)) if tree[0][k][3] < 0 and k != outer
              and cv2.contourArea(contours[k]) >= _MIN_PART * area]  # fmt: skip
    return [contours[k][:, 0, :].astype(np.float64) for k in (outer, *inner, *beside)]
