"""Global appearance of an object (colours, outline), for objects with little texture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.views.hog import HOG_SIZE

__all__ = [
    "APPEARANCE_SIZE",
    "COLOUR_SIZE",
    "HUES",
    "SATURATIONS",
    "VALUES",
    "appearance_vector",
    "colour_bins",
    "colour_histogram",
    "colour_of",
    "colours_of",
]

HUES, SATURATIONS, VALUES = 16, 4, 3
COLOUR_SIZE = HUES * SATURATIONS * VALUES
APPEARANCE_SIZE = COLOUR_SIZE + HOG_SIZE

_HALF = np.float32(np.sqrt(0.5))  # share of each in their joint similarity, under the root


def colour_histogram(rgb: UInt8Array, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the square root of the object's HSV histogram.

    The bins of low saturation take the pixels whose hue means nothing.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
    mask : (h, w) bool
        Not empty.

    Returns
    -------
    (192,) float32
        Unit length: the dot product of two is their Bhattacharyya similarity.

    Examples
    --------
    >>> red = np.full((4, 4, 3), (200, 0, 0), np.uint8)
    >>> everywhere = np.ones((4, 4), bool)
    >>> float(colour_histogram(red, everywhere) @ colour_histogram(red, everywhere))
    1.0
    """
    counts = np.bincount(colour_bins(rgb[mask][None]).ravel(), minlength=COLOUR_SIZE)
    share: NDArray[np.float32] = np.sqrt(counts / counts.sum()).astype(np.float32)
    return share


def colour_bins(rgb: UInt8Array) -> NDArray[np.intp]:
    """Return the bin (h, w) of the HSV histogram that each pixel (h, w, 3) counts in."""
    hsv = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)).astype(np.intp)
    hue = hsv[..., 0] * HUES // 180
    saturation, value = hsv[..., 1] * SATURATIONS // 256, hsv[..., 2] * VALUES // 256
    bins: NDArray[np.intp] = (hue * SATURATIONS + saturation) * VALUES + value
    return bins


def appearance_vector(colour: NDArray[np.float32], hog: NDArray[np.float32]) -> NDArray[np.float32]:
    """Join both so that one dot product is their mean similarity, 0 to 1."""
    return np.concatenate([colour, hog]).astype(np.float32) * _HALF


def colour_of(look: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the colour histogram (192,) in an appearance vector (768,)."""
    colour: NDArray[np.float32] = look[:COLOUR_SIZE] / _HALF
    return colour


def colours_of(looks: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the colour histograms (V, 192) in appearance vectors (V, 768)."""
    colours: NDArray[np.float32] = looks[:, :COLOUR_SIZE] / _HALF
    return colours
