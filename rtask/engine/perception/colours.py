"""Colours of an object as people name them, from one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from features.geometry import Frame

__all__ = ["COLOURS", "colour_names", "colours_of"]

COLOURS = (
    "black", "white", "grey", "red", "orange", "brown", "yellow", "green", "blue", "purple", "pink",
)  # fmt: skip
"""Names, as in the ontology after ``colour_``."""

_HUES = ((15, "red"), (42, "orange"), (70, "yellow"), (165, "green"), (255, "blue"),
         (295, "purple"), (340, "pink"), (361, "red"))  # fmt: skip
"""Largest hue of each name, degrees."""
MIN_SHARE = 0.2
"""Share of the picture from which a colour is one of the object's."""
MAX_COLOURS = 3
_DARK, _PALE, _LIGHT = 0.2, 0.18, 0.75


def colour_names(rgb: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return the number in :data:`COLOURS` of each pixel.

    Parameters
    ----------
    rgb : (n, 3) uint8

    Examples
    --------
    >>> pixels = np.array([[200, 20, 20], [240, 240, 240], [110, 60, 20]], np.uint8)
    >>> [COLOURS[k] for k in colour_names(pixels)]
    ['red', 'white', 'brown']
    """
    values = rgb.astype(np.float64) / 255
    value, least = values.max(axis=1), values.min(axis=1)
    chroma = value - least
    saturation = np.divide(chroma, value, out=np.zeros_like(value), where=value > 0)
    red, green, blue = values.T
    safe = np.where(chroma > 0, chroma, 1.0)
    sixth = np.select(
        [value == red, value == green],
        [((green - blue) / safe) % 6, (blue - red) / safe + 2],
        (red - green) / safe + 4,
    )
    hue = 60 * sixth
    number = {name: k for k, name in enumerate(COLOURS)}
    names = np.array([number[name] for _, name in _HUES])
    result = names[np.searchsorted([limit for limit, _ in _HUES], hue, side="right")]
    is_warm = (result == number["orange"]) | ((result == number["red"]) & (hue > 8) & (hue < 90))
    result = np.where(is_warm & (value < 0.6), number["brown"], result)
    is_pale_red = (result == number["red"]) & (saturation < 0.45) & (value > 0.7)
    result = np.where(is_pale_red, number["pink"], result)
    is_grey = saturation < _PALE
    result = np.where(is_grey, np.where(value > _LIGHT, number["white"], number["grey"]), result)
    return np.where(value < _DARK, number["black"], result)


def colours_of(frame: Frame) -> tuple[str, ...]:
    """Return the names of the colours that an object shows, the largest first; none without image.

    Each covers a fifth of it or more. They are those of the picture: a lamp's colour is not taken
    out.
    """
    if frame.rgb is None:
        return ()
    mask = frame.mask if frame.mask is not None else frame.depth_m > 0
    pixels = frame.rgb[mask] if mask.any() else frame.rgb.reshape(-1, 3)
    counts = np.bincount(colour_names(pixels), minlength=len(COLOURS))
    order = np.argsort(-counts, kind="stable")[:MAX_COLOURS]
    return tuple(COLOURS[k] for k in order if counts[k] >= MIN_SHARE * len(pixels))
