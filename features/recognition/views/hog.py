"""Histograms of oriented gradients (Dalal and Triggs 2005; Gatto 2016, 2.7)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["HOG_SIZE", "hog_descriptor", "hog_of_crop"]

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


def hog_descriptor(grey: UInt8Array) -> NDArray[np.float32]:
    """Return the standard layout of Dalal and Triggs 2005 for one detection window.

    Blocks of 2 x 2 cells of 8 px, stride one cell, 9 unsigned orientations, votes shared linearly
    between neighbouring orientations and cells, each block normalised by L2-Hys with clip 0.2.

    Parameters
    ----------
    grey : (h, w) uint8
        Multiples of 8 px; 128 x 64 gives the well-known 3,780 numbers.

    Returns
    -------
    ((h / 8 - 1) * (w / 8 - 1) * 36,) float32

    Examples
    --------
    >>> hog_descriptor(np.zeros((128, 64), np.uint8)).shape
    (3780,)
    """
    height, width = grey.shape
    if height % CELL_PX or width % CELL_PX or min(height, width) < 2 * CELL_PX:
        raise ValueError(f"the window must be a multiple of 8 px, at least 16, got {grey.shape}")
    magnitude, orientation = _gradients(grey.astype(np.float32))
    rows, columns = height // CELL_PX, width // CELL_PX
    cells = np.zeros((rows + 2, columns + 2, BINS))
    v, u = np.mgrid[0:height, 0:width]
    for row, row_share in _linear_shares((v + 0.5) / CELL_PX + 0.5):
        for column, column_share in _linear_shares((u + 0.5) / CELL_PX + 0.5):
            for bin_, bin_share in _linear_shares(orientation * BINS - 0.5):
                votes = magnitude * row_share * column_share * bin_share
                np.add.at(cells, (row, column, bin_ % BINS), votes)
    cells = cells[1:-1, 1:-1]
    blocks = np.concatenate(
        [cells[i : rows - 1 + i, j : columns - 1 + j] for i in (0, 1) for j in (0, 1)], axis=-1
    )
    blocks = _unit(np.minimum(_unit(blocks), 0.2))
    return blocks.ravel().astype(np.float32)


def _gradients(grey: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return magnitude and unsigned orientation in [0, 1) half turns."""
    gx = np.asarray(cv2.Sobel(grey, cv2.CV_32F, 1, 0))
    gy = np.asarray(cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    orientation = np.mod(np.arctan2(gy, gx) / np.pi, 1.0).astype(np.float32)
    return np.hypot(gx, gy).astype(np.float32), orientation


def _linear_shares(
    position: NDArray[np.floating],
) -> list[tuple[NDArray[np.intp], NDArray[np.floating]]]:
    """Return the two neighbouring whole positions and the share of a vote that each gets."""
    low = np.floor(position).astype(np.intp)
    high_share = position - low
    return [(low, 1 - high_share), (low + 1, high_share)]


def _unit(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    norms: NDArray[np.float64] = np.linalg.norm(blocks, axis=-1, keepdims=True)
    return blocks / np.sqrt(norms**2 + 1e-6)
