"""Colours of two pictures of one print, but for the way in which a camera renders them.

A phone shows a print more or less saturated than a scanner or another phone does, by up to a half,
and turns its hues by some degrees. All cells follow one such map. Those of a sibling that differs
in colour do not: no camera turns red into green.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RenderingParams", "rendered_gap"]


@dataclass(frozen=True)
class RenderingParams:
    """Bounds of what is taken for the rendering of a camera.

    Parameters
    ----------
    min_cells
        Fewer cells of the same print determine no map.
    min_saturation, max_saturation
        Of the first picture over the second.
    max_turn_rad, max_shift
        Of the hue, and of all colours, Lab units.
    rounds, noise
        Of the robust fit; smaller distances, Lab units, weigh alike.
    prior
        Share of the cells that count as if the colours were rendered alike, with a spread of
        ``prior_spread`` Lab units: print without colours says nothing of saturation.
    """

    min_cells: int = 12
    min_saturation: float = 0.6
    max_saturation: float = 1.6
    max_turn_rad: float = 0.14
    max_shift: float = 8.0
    rounds: int = 8
    noise: float = 2.0
    prior: float = 0.2
    prior_spread: float = 5.0


def rendered_gap(
    here: NDArray[np.float32],
    there: NDArray[np.float32],
    agreeing: NDArray[np.bool_],
    params: RenderingParams | None = None,
) -> NDArray[np.float32] | None:
    """Return the distance of colours after the rendering was taken out, Lab units.

    Parameters
    ----------
    here, there : (rows, columns, 2) float32
        a and b of Lab.
    agreeing : (rows, columns) bool
        Cells whose grey values agree; most of them must be of one print.

    Returns
    -------
    (rows, columns) float32 or None
        None where too few cells agree.

    Examples
    --------
    >>> there = np.random.default_rng(0).normal(0, 30, (8, 8, 2)).astype(np.float32)
    >>> every = np.ones((8, 8), bool)
    >>> bool(rendered_gap(1.4 * there + 3, there, every).max() < 2)
    True
    >>> bool(np.median(rendered_gap(-there, there, every)) > 15)
    True
    """
    params = params or RenderingParams()
    if np.count_nonzero(agreeing) < params.min_cells:
        return None
    first, second = (_chroma(colours).astype(np.complex128) for colours in (here, there))
    factor, shift = _map(first[agreeing], second[agreeing], params)
    gap: NDArray[np.float32] = np.abs(first - factor * second - shift).astype(np.float32)
    return gap


def _chroma(colours: NDArray[np.float32]) -> NDArray[np.complexfloating]:
    """Return colours as complex numbers: to scale and to turn them is to multiply."""
    chroma: NDArray[np.complexfloating] = colours[..., 0] + 1j * colours[..., 1]
    return chroma


def _map(
    first: NDArray[np.complex128], second: NDArray[np.complex128], params: RenderingParams
) -> tuple[complex, complex]:
    """Return factor and shift by least absolute distances, within their bounds."""
    weight = np.ones(len(first))
    factor, shift = 1 + 0j, 0j
    for _ in range(params.rounds):
        total = weight.sum()
        mean, other = (complex((weight * c).sum() / total) for c in (first, second))
        prior = params.prior * params.prior_spread**2 * total
        product = (weight * np.conj(second - other) * (first - mean)).sum() + prior
        fitted = complex(product / ((weight * np.abs(second - other) ** 2).sum() + prior))
        size = np.clip(abs(fitted), params.min_saturation, params.max_saturation)
        turn = np.clip(np.angle(fitted), -params.max_turn_rad, params.max_turn_rad)
        factor = complex(size * np.exp(1j * turn))
        left, bound = mean - factor * other, params.max_shift
        shift = complex(np.clip(left.real, -bound, bound), np.clip(left.imag, -bound, bound))
        distance = np.abs(first - factor * second - shift)
        weight = 1 / np.maximum(distance, params.noise)
    return factor, shift
