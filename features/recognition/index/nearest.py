"""Nearest descriptors of one view in another, in whole numbers, on the thread that asks.

A BLAS shares a product of a few hundred rows out among all cores and lets each wait for the others
in a loop: on cores that are busy with other queries that costs more than the product itself.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = [
    "FAR",
    "inner_products",
    "nearest_both_ways",
    "nearest_rows",
    "squared_distances",
]

FAR = 2**31 - 1
"""Squared distance of a neighbour that does not exist."""

_LENGTH = 128
"""Numbers of a descriptor: as a constant, it lets the compiler unroll the innermost loop."""


def inner_products(rows: NDArray[Any], others: NDArray[Any]) -> NDArray[np.int32]:
    """Return the inner product of every row with every other, exact.

    Parameters
    ----------
    rows : (n, 128) whole numbers of 16 bits
    others : (m, 128) whole numbers of 16 bits
        No product of two rows may exceed 2**31.

    Returns
    -------
    (n, m) int32

    Examples
    --------
    >>> inner_products(np.full((1, 128), 200, np.uint8), np.full((2, 128), -511)).tolist()
    [[-13081600, -13081600]]
    """
    products: NDArray[np.int32] = _products(_whole(rows), _whole(others))
    return products


def _whole(rows: NDArray[Any]) -> NDArray[np.int16]:
    """Return rows (n, 128) as the compiled loops take them."""
    return np.array(rows, np.int16, order="C")


def _squared_lengths(rows: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the inner product (n,) int32 of each row (n, 128) with itself."""
    whole = rows.astype(np.int32)
    lengths: NDArray[np.int32] = np.einsum("ij,ij->i", whole, whole)
    return lengths


@nb.njit(cache=True, nogil=True, inline="always")
def _products_of_row(
    rows: NDArray[np.int16], i: int, others: NDArray[np.int16], products: NDArray[np.int32]
) -> None:
    """Write the inner products (m,) of row ``i`` with all others (m, 128)."""
    for j in range(len(others)):
        # 16-bit numbers that are multiplied and added in pairs are one vector instruction.
        total = np.int32(0)
        for k in range(_LENGTH):
            total += np.int32(rows[i, k]) * np.int32(others[j, k])
        products[j] = total


@nb.njit(cache=True, nogil=True)
def _products(rows: NDArray[np.int16], others: NDArray[np.int16]) -> NDArray[np.int32]:
    products = np.empty((len(rows), len(others)), np.int32)
    for i in range(len(rows)):
        _products_of_row(rows, i, others, products[i])
    return products


def squared_distances(query: UInt8Array, stored: UInt8Array) -> NDArray[np.int32]:
    """Return all squared distances (n, N), exact."""
    distances = inner_products(query, stored)
    distances *= -2
    distances += _squared_lengths(stored)[None, :]
    distances += _squared_lengths(query)[:, None]
    return distances


def nearest_both_ways(
    query: UInt8Array, stored: UInt8Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32], NDArray[np.float32]]:
    """Return the nearest neighbours of two sets in each other, of equal ones the first.

    Parameters
    ----------
    query : (n, 128) uint8
    stored : (N, 128) uint8
        At least two.

    Returns
    -------
    best : (n,) intp
    best_back : (N,) intp
    nearest, second : (n,) float32
        Squared distances of each query descriptor to the two that are nearest to it.

    Examples
    --------
    >>> stored = np.array([[0] * 128, [9] * 128, [10] * 128], np.uint8)
    >>> [numbers.tolist() for numbers in nearest_both_ways(stored[2:], stored)]
    [[2], [0, 0, 0], [0.0], [128.0]]
    """
    return _nearest_both_ways(
        *(_whole(query), _whole(stored), _squared_lengths(query), _squared_lengths(stored))
    )


@nb.njit(cache=True, nogil=True)
def _nearest_both_ways(
    query: NDArray[np.int16],
    stored: NDArray[np.int16],
    lengths: NDArray[np.int32],
    stored_lengths: NDArray[np.int32],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32], NDArray[np.float32]]:
    """Return the same from whole numbers and their squared lengths.

    Loops without branches become vector instructions.
    """
    n, m = len(query), len(stored)
    best, nearest, second = np.empty(n, np.intp), np.empty(n, np.float32), np.empty(n, np.float32)
    back, nearest_back = np.zeros(m, np.int32), np.full(m, FAR, np.int32)
    distances = np.empty(m, np.int32)
    for i in range(n):
        _products_of_row(query, i, stored, distances)
        length, least = lengths[i], np.int32(FAR)
        for j in range(m):
            distance = length + stored_lengths[j] - 2 * distances[j]
            distances[j] = distance
            is_nearer = distance < nearest_back[j]
            nearest_back[j] = distance if is_nearer else nearest_back[j]
            back[j] = i if is_nearer else back[j]
            least = min(least, distance)
        first = 0
        while distances[first] != least:
            first += 1
        distances[first] = FAR
        best[i], nearest[i], second[i] = first, least, distances.min()
    return best, back.astype(np.intp), nearest, second


def nearest_rows(
    query: UInt8Array, stored: UInt8Array
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Return the stored descriptor that is nearest to each of a query, of equal ones the first.

    Parameters
    ----------
    query : (n, 128) uint8
    stored : (N, 128) uint8
        At least one.

    Returns
    -------
    (n,) intp, (n,) int32
        Rows and squared distances.

    Examples
    --------
    >>> stored = np.array([[0] * 128, [9] * 128, [9] * 128], np.uint8)
    >>> [numbers.tolist() for numbers in nearest_rows(stored[:1] + 8, stored)]
    [[1], [128]]
    """
    row, nearest = _nearest_rows(_whole(query), _whole(stored), _squared_lengths(stored))
    return row, nearest + _squared_lengths(query)


@nb.njit(cache=True, nogil=True)
def _nearest_rows(
    query: NDArray[np.int16], stored: NDArray[np.int16], stored_lengths: NDArray[np.int32]
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Return rows, and squared distances less the squared lengths of the query."""
    n, m = len(query), len(stored)
    row, nearest = np.empty(n, np.intp), np.empty(n, np.int32)
    distances = np.empty(m, np.int32)
    for i in range(n):
        _products_of_row(query, i, stored, distances)
        least = np.int32(FAR)
        for j in range(m):
            distances[j] = stored_lengths[j] - 2 * distances[j]
            least = min(least, distances[j])
        first = 0
        while distances[first] != least:
            first += 1
        row[i], nearest[i] = first, least
    return row, nearest
