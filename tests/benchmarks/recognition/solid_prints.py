"""Prints on generated things: patches of colour that fill space, seen where a surface cuts them.

Real packages and mugs carry print, by which colours and keypoints tell apart what shape cannot.
A pattern that fills the object's box needs no texture coordinates, so that any mesh can carry it.
"""

from __future__ import annotations

from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["Print"]

_PATCH_M = 0.015
_INKS = 6
_MARGIN_M = 0.02


class Print:
    """Print of one thing.

    Parameters
    ----------
    vertices : (n, 3) float, m, mesh frame
        Of the thing; its box is filled.
    name
        Of the thing; equal names give equal prints.
    """

    def __init__(self, vertices: NDArray[np.float64], name: str) -> None:
        rng = np.random.default_rng(crc32(name.encode()))
        low, high = vertices.min(axis=0) - _MARGIN_M, vertices.max(axis=0) + _MARGIN_M
        counts = np.ceil((high - low) / _PATCH_M).astype(int)
        cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
        self._patches = cKDTree(low + (cells + rng.random(cells.shape)) * _PATCH_M)
        self._inks = rng.integers(25, 256, (_INKS, 3))[rng.integers(_INKS, size=len(cells))]

    def at(self, places: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return the colours (n, 3) RGB of places (n, 3), m, mesh frame."""
        _, nearest = self._patches.query(places)
        return self._inks[nearest].astype(np.uint8)
