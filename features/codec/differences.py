"""Sums that undo the differences of a packed cloud, in one pass over its bytes."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["add_up_colours", "add_up_positions", "warm_up"]


@numba.njit(cache=True, nogil=True)
def add_up_positions(
    planes: UInt8Array, step_m: float, origin: NDArray[np.float64], positions: NDArray[np.float32]
) -> float:
    """Fill in positions from the differences of lattice points; return the largest coordinate.

    Parameters
    ----------
    planes : (3, width, n)
        Of each axis, the bytes of the zigzag differences by significance.
    step_m
        Edge of a lattice cell.
    origin : (3,), m
        Of the cell (0, 0, 0).
    positions : (n, 3), m
        Filled in.
    """
    most = 0.0
    width = planes.shape[1]
    for axis in range(3):
        cell = np.int64(0)
        for i in range(planes.shape[2]):
            zigzag = np.uint64(0)
            for k in range(width):
                zigzag |= np.uint64(planes[axis, k, i]) << np.uint64(8 * k)
            cell += np.int64(zigzag >> np.uint64(1)) ^ -np.int64(zigzag & np.uint64(1))
            place = cell * step_m + origin[axis]
            most = max(most, abs(place))
            positions[i, axis] = place
    return most


@numba.njit(cache=True, nogil=True)
def add_up_colours(planes: UInt8Array, colours: UInt8Array) -> None:
    """Fill in colours (n, 3) from the differences (3, n) of each channel, modulo 256."""
    red = green = blue = np.uint8(0)
    for i in range(planes.shape[1]):
        red = np.uint8(red + planes[0, i])
        green = np.uint8(green + planes[1, i])
        blue = np.uint8(blue + planes[2, i])
        colours[i, 0], colours[i, 1], colours[i, 2] = red, green, blue


def warm_up() -> None:
    """Compile ahead of the first cloud."""
    add_up_positions(np.zeros((3, 2, 1), np.uint8), 1.0, np.zeros(3), np.zeros((1, 3), np.float32))
    add_up_colours(np.zeros((3, 1), np.uint8), np.zeros((1, 3), np.uint8))
