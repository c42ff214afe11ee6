"""Sums over the windows of cells, of two pictures at once.

Only the windows around cells' centres are wanted, one pixel in sixty-four, and all values are
whole numbers: compiled, this takes a third of the time of box filters over whole pictures, and
gives the same means.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["WindowMeans", "window_means"]


class WindowMeans:
    """Means over the windows of cells (rows, columns), float32; beyond the cover all is 0.

    Attributes
    ----------
    share
        Of the window under the cover.
    first, second, first_square, second_square, product
        Of the grey values less 128, of their squares and of their product.
    first_rgb, second_rgb : (rows, columns, 3) float32
        Of the colours.
    """

    def __init__(self, means: NDArray[np.float32]) -> None:
        self.share, self.first, self.second = means[0], means[1], means[2]
        self.first_square, self.second_square, self.product = means[3], means[4], means[5]
        self.first_rgb, self.second_rgb = (
            np.ascontiguousarray(np.moveaxis(means[k : k + 3], 0, -1)) for k in (6, 9)
        )


def window_means(
    grey: tuple[UInt8Array, UInt8Array],
    rgb: tuple[UInt8Array, UInt8Array],
    cover: NDArray[np.bool_],
    centres: tuple[NDArray[np.intp], NDArray[np.intp]],
    side: int,
) -> WindowMeans:
    """Return the means of two pictures over square windows.

    Parameters
    ----------
    grey : (h, w) uint8 each
    rgb : (h, w, 3) uint8 each
    cover : (h, w) bool
        Pixels that count; the others are 0 and count in the size of the window.
    centres : (rows,), (columns,) intp
        Of the windows.
    side
        Of the windows, px, odd.
    """
    rows, columns = (np.ascontiguousarray(part.ravel()) for part in centres)
    return WindowMeans(_means(*grey, *rgb, cover, rows, columns, side // 2))


@nb.njit(cache=True, nogil=True)
def _means(
    first: UInt8Array,
    second: UInt8Array,
    first_rgb: UInt8Array,
    second_rgb: UInt8Array,
    cover: NDArray[np.bool_],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    reach: int,
) -> NDArray[np.float32]:
    height, width = cover.shape
    means = np.empty((12, len(rows), len(columns)), np.float32)
    scale = 1.0 / ((2 * reach + 1) * (2 * reach + 1))
    sums = np.empty((12, width), np.int32)
    for r in range(len(rows)):
        sums[:] = 0
        for y in range(max(rows[r] - reach, 0), min(rows[r] + reach + 1, height)):
            for x in range(width):
                if not cover[y, x]:
                    continue
                a, b = np.int32(first[y, x]) - 128, np.int32(second[y, x]) - 128
                sums[0, x] += 1
                sums[1, x] += a
                sums[2, x] += b
                sums[3, x] += a * a
                sums[4, x] += b * b
                sums[5, x] += a * b
                for k in range(3):
                    sums[6 + k, x] += first_rgb[y, x, k]
                    sums[9 + k, x] += second_rgb[y, x, k]
        for c in range(len(columns)):
            left, right = max(columns[c] - reach, 0), min(columns[c] + reach + 1, width)
            for k in range(12):
                total = 0
                for x in range(left, right):
                    total += sums[k, x]
                means[k, r, c] = np.float32(total * scale)
    return means
