"""Two images matched by cascade hashing, each in the other (Cheng 2014; Gatto 2016, Table 3).

An index of views asks for the nearest descriptor of another *object*, and holds millions. A pair
of images has a few hundred rows that all stand for themselves: what is marked fits into the
nearest cache, and only what matched is matched back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.cascade import (
    MAX_CANDIDATES,
    build_tables,
    hamming_distance,
    squared_distance,
)
from features.recognition.index.hashing import Hasher, used_table_bits
from features.recognition.index.nearest import FAR

__all__ = ["HashedImage", "match_images"]

Rows = NDArray[np.int32]

_ROW = 2**32 - 1
_NOTHING = FAR << 32
_NO_RIVAL = 2**30  # squared; a lone candidate passes the ratio rule


@dataclass(frozen=True, eq=False)
class HashedImage:
    """The descriptors of an image with their codes and hash tables.

    Parameters
    ----------
    descriptors : (n, 128) uint8
    codes : (n, 2) uint64
    buckets : (n, L) uint32
    offsets, rows
        Of :func:`~features.recognition.index.cascade.build_tables`.
    """

    descriptors: UInt8Array
    codes: NDArray[np.uint64]
    buckets: NDArray[np.uint32]
    offsets: Rows
    rows: Rows

    @classmethod
    def of(cls, descriptors: UInt8Array, hasher: Hasher) -> HashedImage:
        """Hash the descriptors (n, 128) of an image."""
        codes, buckets = hasher.encode(descriptors)
        buckets = np.ascontiguousarray(buckets)
        offsets, rows = build_tables(buckets, used_table_bits(len(descriptors)))
        return cls(np.ascontiguousarray(descriptors), codes, buckets, offsets, rows)


def match_images(
    one: HashedImage, other: HashedImage, distance_cap: int, ratio: float
) -> tuple[Rows, Rows]:
    """Return the rows of two images that are each other's nearest.

    Parameters
    ----------
    one, other
        Hashed by the same hasher.
    distance_cap
        Largest squared distance of a match.
    ratio
        Of squared distances: a match must be nearer than so much of the second nearest (Lowe
        2004, 7.1). The rule holds from ``one`` to ``other`` only.

    Returns
    -------
    rows, columns : (m,) int32
        Rows of ``one`` in order, and of ``other`` that they match.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> seen = rng.integers(0, 80, (300, 128), dtype=np.uint8)
    >>> hasher = Hasher.seeded()
    >>> image, turned = HashedImage.of(seen, hasher), HashedImage.of(seen[::-1], hasher)
    >>> rows, columns = match_images(image, turned, 100_000, 0.64)
    >>> len(rows), bool((rows + columns == 299).all())
    (300, True)
    """
    return _match(
        *(one.descriptors, one.codes, one.buckets, one.offsets, one.rows),
        *(other.descriptors, other.codes, other.buckets, other.offsets, other.rows),
        *(distance_cap, ratio),
    )


@nb.njit(cache=True, nogil=True)
def _match(
    query: UInt8Array,
    query_codes: NDArray[np.uint64],
    query_buckets: NDArray[np.uint32],
    query_offsets: Rows,
    query_rows: Rows,
    stored: UInt8Array,
    stored_codes: NDArray[np.uint64],
    stored_buckets: NDArray[np.uint32],
    stored_offsets: Rows,
    stored_rows: Rows,
    distance_cap: int,
    ratio: float,
) -> tuple[Rows, Rows]:
    n, m = len(query), len(stored)
    most = max(n, m) + 1
    marks, marks_back = np.full(m, -1, np.int32), np.full(n, -1, np.int32)
    candidates, hamming = np.empty(most, np.int32), np.empty(most, np.int16)
    histogram = np.empty(129, np.int32)
    back = np.full(m, -2, np.int32)  # not asked yet
    rows, columns = np.empty(n, np.int32), np.empty(n, np.int32)
    matched = 0
    for i in range(n):
        best, nearest, rival = _nearest(
            *(query, query_codes, query_buckets, i, stored, stored_codes),
            *(stored_offsets, stored_rows, marks, candidates, hamming, histogram),
        )
        if best < 0 or nearest >= distance_cap or nearest >= ratio * min(rival, _NO_RIVAL):
            continue
        if back[best] == -2:
            back[best], _, _ = _nearest(
                *(stored, stored_codes, stored_buckets, best, query, query_codes),
                *(query_offsets, query_rows, marks_back, candidates, hamming, histogram),
            )
        if back[best] == i:
            rows[matched], columns[matched] = i, best
            matched += 1
    return rows[:matched].copy(), columns[:matched].copy()


@nb.njit(cache=True, nogil=True)
def _nearest(
    query: UInt8Array,
    query_codes: NDArray[np.uint64],
    query_buckets: NDArray[np.uint32],
    i: int,
    stored: UInt8Array,
    codes: NDArray[np.uint64],
    offsets: Rows,
    table_rows: Rows,
    marks: Rows,
    candidates: Rows,
    hamming: NDArray[np.int16],
    histogram: Rows,
) -> tuple[Any, Any, Any]:
    """Return the nearest stored row, and squared distances to it and to the next nearest.

    ``marks`` holds the last query row that met a stored one, so that nothing need be cleared.
    """
    mask = offsets.shape[1] - 2
    count = 0
    for table in range(query_buckets.shape[1]):
        bucket = query_buckets[i, table] & mask
        for p in range(offsets[table, bucket], offsets[table, bucket + 1]):
            row = table_rows[table, p]
            candidates[count] = row
            count += 1 if marks[row] != i else 0
            marks[row] = i
    histogram[:] = 0
    for c in range(count):
        h = hamming_distance(query_codes, i, codes, candidates[c])
        hamming[c] = h
        histogram[h] += 1
    limit, reached = 128, 0
    for h in range(128):
        reached += histogram[h]
        if reached >= MAX_CANDIDATES:
            limit = h
            break
    short = 0
    for c in range(count):  # written without a branch, which would be guessed wrong
        candidates[short] = candidates[c]
        short += 1 if hamming[c] <= limit else 0
    # Distance and row in one number: its least is the nearest, of equal ones the lowest row.
    first = second = np.int64(_NOTHING)
    for c in range(short):
        row = candidates[c]
        measured = np.int64(squared_distance(query, i, stored, row)) << 32 | row
        second = min(second, max(first, measured))
        first = min(first, measured)
    if short == 0:
        return -1, FAR, FAR
    return first & _ROW, first >> 32, second >> 32
