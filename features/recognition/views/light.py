"""Colours of one thing in another light, as another hour or another camera shows them.

A histogram of colours is that of a thing in its light: at half the exposure, or under a warm lamp,
nearly all of it moves to other bins. So a query is compared as it is and as it would look brighter,
darker, warmer and cooler; each change has a cost, because a white cup is not a grey one in less
light. Channels are multiplied (von Kries 1902), red against blue, as daylight and lamps differ.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition.views.appearance import (
    COLOUR_SIZE,
    HUES,
    SATURATIONS,
    VALUES,
    colour_bins,
)
from features.recognition.views.picture import ViewPicture

__all__ = ["LIGHTS", "light_costs", "relit_colours", "spread"]

_GAINS = (-1.0, -0.5, 0.0, 0.5, 1.0)
_TINTS = (-0.2, 0.0, 0.2)
LIGHTS = np.array([(0.0, 0.0), *itertools.product(_GAINS, _TINTS)])
"""Brightness, and red over blue, of each light (L, 2), in powers of two. The first is the view as
it was described; the others are made of its picture, smoothed."""

_FACTORS = np.exp2(np.stack([LIGHTS.sum(axis=1), LIGHTS[:, 0], LIGHTS[:, 0] - LIGHTS[:, 1]], 1))
_MAX_PIXELS = 2500


def light_costs(per_gain: float, per_tint: float) -> NDArray[np.float32]:
    """Return what each of :data:`LIGHTS` takes off a similarity (L,), per power of two."""
    costs = np.abs(LIGHTS) @ np.array([per_gain, per_tint])
    return np.asarray(costs, np.float32)


def relit_colours(colour: NDArray[np.float32], picture: bytes) -> NDArray[np.float32]:
    """Return the colour histograms (L, 192) of a view in each of :data:`LIGHTS`.

    Parameters
    ----------
    colour : (192,) float32
        Of the view, as :func:`~features.recognition.views.appearance.colour_histogram` makes it.
    picture
        Of the view, as :func:`~features.recognition.views.picture.take_picture` encodes it; where
        it is empty, there is the first light alone, and the answer has one row.

    Examples
    --------
    >>> from features.recognition.views.appearance import colour_histogram
    >>> from features.recognition.views.picture import take_picture
    >>> everywhere = np.ones((40, 40), bool)
    >>> paint = np.array([[200, 80, 60]], np.uint8)
    >>> bright, dark = (np.broadcast_to(rgb, (40, 40, 3)).copy() for rgb in (paint, paint // 2))
    >>> stored, asked = (colour_histogram(rgb, everywhere) for rgb in (bright, dark))
    >>> lit = relit_colours(asked, take_picture(dark, everywhere))
    >>> float(asked @ stored), round(float((lit @ stored).max()), 2)
    (0.0, 1.0)
    """
    if not picture:
        return colour[None]
    seen = ViewPicture.from_bytes(picture)
    pixels = np.asarray(cv2.medianBlur(seen.rgb, 3))[seen.mask]
    if len(pixels) == 0:
        return colour[None]
    # Every so many pixels of all, the same in each call.
    chosen = np.linspace(0, len(pixels) - 1, min(len(pixels), _MAX_PIXELS)).astype(np.intp)
    lit = pixels[chosen].astype(np.float32) * _FACTORS[1:, None].astype(np.float32)
    bins = colour_bins(np.clip(lit, 0, 255).astype(np.uint8))
    bins += COLOUR_SIZE * np.arange(len(bins))[:, None]
    counts = np.bincount(bins.ravel(), minlength=len(bins) * COLOUR_SIZE)
    shares = np.sqrt(counts.reshape(len(bins), COLOUR_SIZE) / len(chosen))
    return np.concatenate([colour[None], shares.astype(np.float32)])


def spread(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return histograms (k, 192) of which each bin has lent some of its share to its neighbours.

    What a little noise moves across the border of a bin then still counts as nearly the same. Hue
    means nothing where saturation is low: there, all hues share alike.

    Examples
    --------
    >>> from features.recognition.views.appearance import colour_histogram
    >>> everywhere = np.ones((4, 4), bool)
    >>> low, high = (np.full((4, 4, 3), (v, 0, 0), np.uint8) for v in (84, 86))
    >>> near = np.stack([colour_histogram(rgb, everywhere) for rgb in (low, high)])
    >>> float(near[0] @ near[1]), round(float(spread(near)[0] @ spread(near)[1]), 2)
    (0.0, 0.76)
    """
    return np.sqrt(np.square(colours) @ _KERNEL)


def _kernel(lent: float) -> NDArray[np.float32]:
    """Return what each bin (192, 192) gives to each; rows sum to 1."""
    hue, saturation, value = np.unravel_index(np.arange(COLOUR_SIZE), (HUES, SATURATIONS, VALUES))
    step = np.abs(hue[:, None] - hue)
    step = np.minimum(step, HUES - step)
    given = np.where(step > 1, 0.0, np.where(step == 1, lent, 1.0))
    is_grey = (saturation[:, None] == 0) & (saturation == 0)
    given = np.where(is_grey, 1.0, given)
    for level in (saturation, value):
        apart = np.abs(level[:, None] - level)
        given = given * np.where(apart > 1, 0.0, np.where(apart == 1, lent, 1.0))
    kernel: NDArray[np.float32] = (given / given.sum(axis=1, keepdims=True)).astype(np.float32)
    return kernel


_KERNEL = _kernel(0.3)
