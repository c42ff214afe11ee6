"""The matching kernels: nearest stored descriptor, and the nearest of another object.

Cheng 2014, 3.1 to 3.3: candidates from hash tables, ranked by Hamming distance, the few best
measured exactly. The ratio test of Lowe 2004, 7.1 compares with the nearest descriptor *of
another object*: the same object is stored from many views, and the plain rule would hold its own
other views against it.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.nearest import FAR, squared_distances

__all__ = [
    "MAX_CANDIDATES",
    "build_tables",
    "hamming_distance",
    "match_exact",
    "match_flat",
    "match_tables",
    "squared_distance",
]

Rows = NDArray[np.int32]
Codes = NDArray[np.uint64]

MAX_CANDIDATES = 10
"""Candidates measured exactly for each query descriptor; all ties of the last one come along."""

MAX_RIVALS = 5
"""Candidates of other objects that are measured too: an object that is stored from many views
would fill the first ten places alone, and pass the ratio rule for want of a rival."""

_RIVAL_REACH = 8  # bits beyond the last of the ten within which rivals are looked for first
_REMOVED = 999
_ROW = 2**32 - 1  # the lower half of a distance and its row in one number


@intrinsic
def _popcount(typing_context: Any, word: Any) -> Any:
    """Count bits with the processor's own instruction (LLVM ``ctpop``)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@nb.njit(cache=True, nogil=True)
def build_tables(buckets: NDArray[np.uint32], bits: int) -> tuple[Rows, Rows]:
    """Sort rows into hash tables by the lowest ``bits`` of their bucket numbers.

    Parameters
    ----------
    buckets : (n, L) uint32

    Returns
    -------
    offsets : (L, 2**bits + 1) int32
    rows : (L, n) int32
        Rows of bucket ``b`` in table ``l`` are ``rows[l, offsets[l, b]:offsets[l, b + 1]]``.
    """
    n, tables = buckets.shape
    size = 1 << bits
    offsets = np.zeros((tables, size + 1), np.int32)
    rows = np.empty((tables, n), np.int32)
    for table in range(tables):
        for i in range(n):
            offsets[table, (buckets[i, table] & (size - 1)) + 1] += 1
        for b in range(size):
            offsets[table, b + 1] += offsets[table, b]
        cursor = offsets[table, :-1].copy()
        for i in range(n):
            b = buckets[i, table] & (size - 1)
            rows[table, cursor[b]] = i
            cursor[b] += 1
    return offsets, rows


_count_bits: Any = _popcount


@nb.njit(cache=True, nogil=True, inline="always")
def hamming_distance(codes_a: Codes, i: int, codes_b: Codes, j: int) -> int:
    """Return how many of the 128 bits of two rows' codes differ; inside kernels only."""
    low, high = codes_a[i, 0] ^ codes_b[j, 0], codes_a[i, 1] ^ codes_b[j, 1]
    return int(_count_bits(low) + _count_bits(high))


@nb.njit(cache=True, nogil=True, inline="always")
def squared_distance(a: UInt8Array, i: int, b: UInt8Array, j: int) -> Any:
    """Return the squared distance of row i of one and row j of the other; inside kernels only."""
    # Numba widens sums of 32 bits to 64, of which half as many fit into a vector. Views of single
    # rows would be counted references, which cost as much as the distance itself.
    total = np.int32(0)
    for k in range(128):
        difference = np.int32(np.int32(a[i, k]) - np.int32(b[j, k]))
        total = np.int32(total + np.int32(difference * difference))
    return total


@nb.njit(cache=True, nogil=True)
def _distance_reached(histogram: Rows, target: int, last: int) -> int:
    """Return the least Hamming distance, at most ``last``, within which ``target`` rows lie."""
    reached = 0
    for h in range(last):
        reached += histogram[h]
        if reached >= target:
            return h
    return last


@nb.njit(cache=True, nogil=True)
def _shortlist(hamming: NDArray[np.int16], count: int, most: int, short: Rows) -> int:
    """Write the candidates with a Hamming distance of at most ``most`` to ``short``."""
    # Without a branch, which would be guessed wrong at every second candidate.
    shortlisted = 0
    for c in range(count):
        short[shortlisted] = c
        shortlisted += 1 if hamming[c] <= most else 0
    return shortlisted


@nb.njit(cache=True, nogil=True)
def _two_nearest(
    query: UInt8Array,
    i: int,
    stored: UInt8Array,
    labels: Rows,
    views: Rows,
    candidates: Rows,
    hamming: NDArray[np.int16],
    count: int,
    histogram: Rows,
    short: Rows,
    measured: NDArray[np.int64],
) -> tuple[Any, Any, Any, Any]:
    """Measure the candidates of least Hamming distance: best row and distance, rival's likewise.

    ``histogram`` of the Hamming distances is used up; ``short`` and ``measured`` are scratch of
    ``count`` rows.
    """
    limit = _distance_reached(histogram, MAX_CANDIDATES, 128)
    shortlisted = _shortlist(hamming, count, limit, short)
    # Distance and row in one number: its least is the nearest, of equal ones the lowest row.
    nothing = np.int64(FAR) << 32
    least = nothing
    for k in range(shortlisted):
        row = candidates[short[k]]
        measured[k] = np.int64(squared_distance(query, i, stored, row)) << 32 | row
        least = min(least, measured[k])
    if shortlisted == 0:
        return -1, FAR, -1, FAR
    best, nearest = least & _ROW, least >> 32
    own = labels[views[best]]
    rivals, least = 0, nothing
    for k in range(shortlisted):
        is_rival = labels[views[measured[k] & _ROW]] != own
        rivals += is_rival
        least = min(least, measured[k] if is_rival else nothing)
    rival_row, rival = (least & _ROW, least >> 32) if rivals else (-1, FAR)
    if rivals < MAX_RIVALS and shortlisted < count:
        rival_row, rival = _nearest_rival(
            *(query, i, stored, labels, views, candidates, hamming, count, histogram, short),
            *(own, limit),
        )
    return best, nearest, rival_row, rival


@nb.njit(cache=True, nogil=True)
def _nearest_rival(
    query: UInt8Array,
    i: int,
    stored: UInt8Array,
    labels: Rows,
    views: Rows,
    candidates: Rows,
    hamming: NDArray[np.int16],
    count: int,
    histogram: Rows,
    short: Rows,
    own: int,
    limit: int,
) -> tuple[int, int]:
    """Look for rivals beyond the last of the ten: row of the nearest, and its distance."""
    shortlisted = _shortlist(hamming, count, min(limit + _RIVAL_REACH, 128), short)
    for _ in range(2):
        histogram[:] = 0
        others = 0
        for k in range(shortlisted):
            if labels[views[candidates[short[k]]]] != own:
                histogram[hamming[short[k]]] += 1
                others += 1
        if others >= MAX_RIVALS or shortlisted == count:
            break
        # Many views of one object crowd the list: look at all candidates, which is rarely needed.
        shortlisted = _shortlist(hamming, count, 128, short)
    limit = max(limit, _distance_reached(histogram, MAX_RIVALS, 128))
    rival_row, rival = -1, FAR
    for k in range(shortlisted):
        row = candidates[short[k]]
        if hamming[short[k]] <= limit and labels[views[row]] != own:
            distance = squared_distance(query, i, stored, row)
            if distance < rival or (distance == rival and row < rival_row):
                rival_row, rival = row, distance
    return rival_row, rival


@nb.njit(cache=True, nogil=True)
def _slots(rows: int) -> int:
    """Return how many places a set of so many rows has: a power of two, at most a quarter full."""
    slots = 64
    while slots < 4 * rows:
        slots *= 2
    return slots


@nb.njit(cache=True, nogil=True)
def _distinct_rows(
    buckets: NDArray[np.uint32],
    i: int,
    mask: int,
    offsets: Rows,
    table_rows: Rows,
    seen: Rows,
    slots: int,
    candidates: Rows,
) -> int:
    """Write the rows in a descriptor's buckets to ``candidates``, each once; return how many.

    ``seen`` is scratch: a set by open addressing, which stays in the cache as marks on all rows of
    the segment would not.
    """
    for slot in range(slots):
        seen[slot] = -1
    last = np.uint32(slots - 1)
    count = 0
    for table in range(buckets.shape[1]):
        bucket = buckets[i, table] & mask
        for p in range(offsets[table, bucket], offsets[table, bucket + 1]):
            row = table_rows[table, p]
            # Knuth's multiplicative hash; its low bits are the weakest.
            at = (np.uint32(row) * np.uint32(2654435761) >> np.uint32(7)) & last
            while seen[at] >= 0 and seen[at] != row:
                at = (at + np.uint32(1)) & last
            candidates[count] = row
            count += seen[at] != row
            seen[at] = row
    return count


@nb.njit(cache=True, nogil=True)
def match_tables(
    query: UInt8Array,
    query_codes: Codes,
    query_buckets: NDArray[np.uint32],
    stored: UInt8Array,
    codes: Codes,
    offsets: Rows,
    table_rows: Rows,
    labels: Rows,
    views: Rows,
    alive: UInt8Array,
    is_whole: bool,
) -> tuple[Rows, Rows, Rows, Rows]:
    """Match against hash tables.

    Parameters
    ----------
    query, query_codes, query_buckets
        (n, 128) uint8, (n, 2) uint64 and (n, L) uint32 of the image to recognise.
    stored, codes, offsets, table_rows
        Descriptors, codes and tables of a segment of N rows.
    labels, views
        Object of each view, and view of each row: labels are looked up at query time.
    alive : (N,) uint8
        0 = removed.
    is_whole
        None is removed, so that ``alive`` need not be read.

    Returns
    -------
    best, nearest : (n,) int32
        Row of the nearest descriptor found, and the squared distance to it; -1 and ``FAR`` where
        there is none.
    rival_row, rival : (n,) int32
        The same of the nearest of another object.
    """
    n, tables = query_buckets.shape
    mask = offsets.shape[1] - 2
    best = np.full(n, -1, np.int32)
    nearest = np.full(n, FAR, np.int32)
    rival_row = np.full(n, -1, np.int32)
    rival = np.full(n, FAR, np.int32)
    histogram = np.zeros(129, np.int32)
    room = 0
    candidates = np.empty(room, np.int32)
    hamming = np.empty(room, np.int16)
    short = np.empty(room, np.int32)
    measured = np.empty(room, np.int64)
    seen = np.empty(_slots(room), np.int32)  # is emptied for a descriptor in empty buckets, too
    for i in range(n):
        most = 0
        for table in range(tables):
            bucket = query_buckets[i, table] & mask
            most += offsets[table, bucket + 1] - offsets[table, bucket]
        if most > room:
            room = max(2 * most, 4096)
            candidates = np.empty(room, np.int32)
            hamming = np.empty(room, np.int16)
            short = np.empty(room, np.int32)
            measured = np.empty(room, np.int64)
            seen = np.empty(_slots(room), np.int32)
        distinct = _distinct_rows(
            query_buckets, i, mask, offsets, table_rows, seen, _slots(most), candidates
        )
        # Rows lie anywhere in memory. Without branches, which would be guessed wrong, the processor
        # waits for many of them at once.
        count = 0
        histogram[:] = 0
        for c in range(distinct):
            row = candidates[c]
            candidates[count] = row
            h = hamming_distance(query_codes, i, codes, row)
            hamming[count] = h
            is_stored = 1 if is_whole or alive[row] else 0
            histogram[h] += is_stored
            count += is_stored
        if count:
            best[i], nearest[i], rival_row[i], rival[i] = _two_nearest(
                *(query, i, stored, labels, views, candidates, hamming, count),
                *(histogram, short, measured),
            )
    return best, nearest, rival_row, rival


@nb.njit(cache=True, nogil=True)
def match_flat(
    query: UInt8Array,
    query_codes: Codes,
    stored: UInt8Array,
    codes: Codes,
    labels: Rows,
    views: Rows,
    alive: UInt8Array,
) -> tuple[Rows, Rows, Rows, Rows]:
    """Match against every stored code: no tables to build, best recall; for what is still small.

    Parameters and results as in :func:`match_tables`.
    """
    n, rows = len(query), len(stored)
    best = np.full(n, -1, np.int32)
    nearest = np.full(n, FAR, np.int32)
    rival_row = np.full(n, -1, np.int32)
    rival = np.full(n, FAR, np.int32)
    histogram = np.zeros(129, np.int32)
    candidates = np.arange(rows).astype(np.int32)
    hamming = np.empty(rows, np.int16)
    short = np.empty(rows, np.int32)
    measured = np.empty(rows, np.int64)
    for i in range(n):
        histogram[:] = 0
        for row in range(rows):
            if alive[row]:
                h = hamming_distance(query_codes, i, codes, row)
                hamming[row] = h
                histogram[h] += 1
            else:
                hamming[row] = _REMOVED
        best[i], nearest[i], rival_row[i], rival[i] = _two_nearest(
            *(query, i, stored, labels, views, candidates, hamming, rows),
            *(histogram, short, measured),
        )
    return best, nearest, rival_row, rival


def match_exact(
    query: UInt8Array, stored: UInt8Array, row_labels: NDArray[np.int32]
) -> tuple[Rows, Rows, Rows, Rows]:
    """Match by the full product: the truth that the other two approach.

    Parameters
    ----------
    query : (n, 128) uint8
    stored : (N, 128) uint8
    row_labels : (N,) int32
        Object of each row; all different = Lowe's plain rule.

    Returns
    -------
    best, nearest, rival_row, rival
        As in :func:`match_tables`.

    Examples
    --------
    >>> stored = np.array([[0] * 128, [9] * 128, [10] * 128], np.uint8)
    >>> answer = match_exact(stored[2:], stored, np.array([0, 1, 1], np.int32))
    >>> [numbers.tolist() for numbers in answer]
    [[2], [0], [0], [12800]]
    """
    n = len(query)
    rival_row, rival = np.full(n, -1, np.int32), np.full(n, FAR, np.int32)
    if len(stored) == 0 or n == 0:
        return rival_row.copy(), rival.copy(), rival_row, rival
    distances = squared_distances(query, stored).astype(np.float64)
    best = distances.argmin(axis=1).astype(np.int32)
    nearest = distances[np.arange(n), best].astype(np.int32)
    distances[row_labels[None, :] == row_labels[best][:, None]] = np.inf
    second = distances.argmin(axis=1)
    second_distance = distances[np.arange(n), second]
    has_rival = np.isfinite(second_distance)
    rival_row[has_rival], rival[has_rival] = (
        second[has_rival],
        second_distance[has_rival].astype(np.int32),
    )
    return best, nearest, rival_row, rival
