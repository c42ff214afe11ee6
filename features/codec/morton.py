"""Cells in the order of the Morton curve: neighbours in space stay neighbours in the list."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["MORTON_BITS", "cells_from_morton", "morton_code"]

MORTON_BITS = 21
"""Bits of each coordinate in a 64-bit code."""


def morton_code(cells: NDArray[np.integer]) -> NDArray[np.uint64]:
    """Return the codes (n,) of cells (n, 3) in 0..2^21 - 1; x has the lowest bit.

    >>> morton_code(np.array([[1, 0, 0], [0, 1, 0], [3, 0, 1]])).tolist()
    [1, 2, 13]
    """
    wide = np.asarray(cells).astype(np.uint64)
    code = np.zeros(len(wide), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            taken = (wide[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= taken << np.uint64(3 * bit + axis)
    return code


def cells_from_morton(code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the cells (n, 3) of codes (n,).

    >>> cells_from_morton(np.array([13], np.uint64)).tolist()
    [[3, 0, 1]]
    """
    cells = np.zeros((len(code), 3), np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            taken = (code >> np.uint64(3 * bit + axis)) & np.uint64(1)
            cells[:, axis] |= (taken << np.uint64(bit)).astype(np.int64)
    return cells
