"""Histograms of oriented gradients (Dalal and Triggs 2005; Gatto 2016, 2.7)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["HOG_SIZE", "hog_of_crop"]

BINS = 9
CELL_PX = 8
SIDE_PX = 64
OUTSIDE = 128
HOG_SIZE = (SIDE_PX // CELL_PX) ** 2 * BINS


def hog_of_crop(grey: UInt8Array, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Describe the shape of an object and of its print, whatever its size in the image.

    The mask's box, grey outside the mask, is padded to a square and resized to 64 x 64 px; each
    cell of 8 x 8 px gives a histogram of 9 unsigned orientations.

    Parameters
    ----------
    grey : (h, w) uint8
    mask : (h, w) bool
        Not empty.

    Returns
    -------
    (576,) float32
        Unit length (all 0 for a flat crop): the dot product of two is their similarity.
    """
    rows, columns = np.nonzero(mask)
    box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    inside = np.where(mask[box], grey[box], OUTSIDE).astype(np.uint8)
    height, width = inside.shape
    side = max(height, width)
    square = np.full((side, side), OUTSIDE, np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = inside
    small = cv2.resize(square, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)

    magnitude, orientation = _gradients(np.asarray(small, dtype=np.float32))
    bins = np.minimum((orientation * BINS).astype(np.intp), BINS - 1)
    cells = SIDE_PX // CELL_PX
    v, u = np.mgrid[0:SIDE_PX, 0:SIDE_PX] // CELL_PX
    histogram = np.bincount(
        ((v * cells + u) * BINS + bins).ravel(), magnitude.ravel(), cells * cells * BINS
    )
    rooted = np.sqrt(histogram / max(histogram.sum(), 1e-9))
    unit: NDArray[np.float32] = (rooted / max(float(np.linalg.norm(rooted)), 1e-9)).astype(
        np.float32
    )
    return unit


def _gradients(grey: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return magnitude and unsigned orientation in [0, 1) half turns."""
    gx = np.asarray(cv2.Sobel(grey, cv2.CV_32F, 1, 0))
    gy = np.asarray(cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    orientation = np.mod(np.arctan2(gy, gx) / np.pi, 1.0).astype(np.float32)
    return np.hypot(gx, gy).astype(np.float32), orientation
