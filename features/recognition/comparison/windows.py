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

__all__ = ["WindowMeans", "flow_targets", "window_means"]


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
    first, second = (image.reshape(len(image), -1) for image in rgb)
    under = cover.view(np.uint8)
    return WindowMeans(_means(*grey, first, second, under, rows, columns, side // 2))


@nb.njit(cache=True, nogil=True)
def flow_targets(flow: NDArray[np.float32], most: np.float32) -> NDArray[np.float32]:
    """Return x and y (2, h, w), px, of the places that a flow (h, w, 2) leads to.

    It is bounded on each axis.
    """
    height, width, _ = flow.shape
    places = np.empty((2, height, width), np.float32)
    for y in range(height):
        for x in range(width):
            places[0, y, x] = np.float32(x) + min(max(flow[y, x, 0], -most), most)
            places[1, y, x] = np.float32(y) + min(max(flow[y, x, 1], -most), most)
    return places


@nb.njit(cache=True, nogil=True)
def _means(
    first: UInt8Array,
    second: UInt8Array,
    first_rgb: UInt8Array,
    second_rgb: UInt8Array,
    cover: UInt8Array,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    reach: int,
) -> NDArray[np.float32]:
    """Return the twelve means (12, rows, columns), of colours (h, 3 w).

    Loops over whole rows without branches become vector instructions.
    """
    height, width = cover.shape
    means = np.empty((12, len(rows), len(columns)), np.float32)
    scale = 1.0 / ((2 * reach + 1) * (2 * reach + 1))
    sums, colours = np.empty((6, width), np.int32), np.empty((2, 3 * width), np.int32)
    under = np.empty(3 * width, np.int32)
    for r in range(len(rows)):
        sums[:] = 0
        colours[:] = 0
        for y in range(max(rows[r] - reach, 0), min(rows[r] + reach + 1, height)):
            for x in range(width):
                weight = np.int32(cover[y, x])
                a = weight * (np.int32(first[y, x]) - np.int32(128))
                b = weight * (np.int32(second[y, x]) - np.int32(128))
                sums[0, x] += weight
                sums[1, x] += a
                sums[2, x] += b
                sums[3, x] += a * a
                sums[4, x] += b * b
                sums[5, x] += a * b
            for x in range(width):
                under[3 * x] = under[3 * x + 1] = under[3 * x + 2] = cover[y, x]
            for x in range(3 * width):
                colours[0, x] += under[x] * np.int32(first_rgb[y, x])
                colours[1, x] += under[x] * np.int32(second_rgb[y, x])
        for c in range(len(columns)):
            left, right = max(columns[c] - reach, 0), min(columns[c] + reach + 1, width)
            for k in range(6):
                total = 0
                for x in range(left, right):
                    total += sums[k, x]
                means[k, r, c] = np.float32(total * scale)
            for k in range(6):
                total = 0
                for x in range(3 * left + k % 3, 3 * right, 3):
                    total += colours[k // 3, x]
                means[6 + k, r, c] = np.float32(total * scale)
    return means
