"""What a picture cannot show: too little light, or no colours."""

from __future__ import annotations

import numpy as np

from features.geometry import UInt8Array

__all__ = ["has_colours", "lacking"]

_DARK = 80
"""Brightest channel of all pixels but one in a hundred: less leaves few steps to compare."""
_GREY = 4
"""Largest difference between the channels of a pixel that JPEG makes of a grey picture."""
_SAMPLED = 100
"""Rows or columns that are looked at: a comparison asks this of every stored picture."""


def has_colours(rgb: UInt8Array) -> bool:
    """Return whether a picture (h, w, 3) shows colours; that of a monochrome camera does not.

    Examples
    --------
    >>> grey = np.full((8, 8, 3), 90, np.uint8)
    >>> has_colours(grey), has_colours(grey + np.array([20, 0, 0], np.uint8))
    (False, True)
    """
    sample = _sampled(rgb)
    spread = sample.max(axis=2) - sample.min(axis=2)
    return bool(np.count_nonzero(spread > _GREY) > 0.01 * spread.size)


def lacking(rgb: UInt8Array) -> tuple[str, ...]:
    """Return in words what a picture (h, w, 3) lacks of what recognition compares.

    Examples
    --------
    >>> lacking(np.full((8, 8, 3), 20, np.uint8))
    ('the picture is dark', 'the picture has no colours')
    """
    is_dark = float(np.quantile(_sampled(rgb).max(axis=2), 0.99)) < _DARK
    faults = (is_dark, "the picture is dark"), (not has_colours(rgb), "the picture has no colours")
    return tuple(words for is_so, words in faults if is_so)


def _sampled(rgb: UInt8Array) -> UInt8Array:
    step = max(max(rgb.shape) // _SAMPLED, 1)
    return rgb[::step, ::step]
