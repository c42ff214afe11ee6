"""Relations as sorted arrays: joins of whole sets at once.

A pair of ids is one 64-bit key, subject in the upper half. Sorted keys give the objects of a
subject as a slice; the same pairs the other way round give the subjects of an object
(vertical partitioning; Subercaze et al. 2016, "Inferray").
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from reasoner.terms.vocabulary import LITERAL

Keys = NDArray[np.uint64]
"""(n,) pairs, ascending and distinct unless said otherwise."""
Ids = NDArray[np.uint64]
"""(n,) ids of terms."""

HALF = np.uint64(32)
LOW = np.uint64(0xFFFFFFFF)
MAX_ROWS = 2_000_000
"""A join with more rows is done in parts."""
MAX_ROWS_OF_ONE = 20_000_000
"""Rows of a join that cannot be parted, because one fact gives them."""


class TooManyRowsError(Exception):
    """A join has more rows than are made at once."""


NO_KEYS: Keys = np.empty(0, np.uint64)


def pack(high: Ids, low: Ids) -> Keys:
    """Return pairs as keys, in the order given.

    >>> pack(np.uint64([1]), np.uint64([2])).tolist() == [(1 << 32) + 2]
    True
    """
    return (high << HALF) | low


def upper(keys: Keys) -> Ids:
    """Return the upper halves."""
    return keys >> HALF


def lower(keys: Keys) -> Ids:
    """Return the lower halves."""
    return keys & LOW


def distinct(keys: Keys) -> Keys:
    """Return keys sorted, each once."""
    if len(keys) < 2:
        return keys
    keys = np.sort(keys)
    keep = np.empty(len(keys), bool)
    keep[0] = True
    np.not_equal(keys[1:], keys[:-1], out=keep[1:])
    return keys[keep]


def is_in(keys: Keys, among: Keys) -> NDArray[np.bool_]:
    """Tell for each key whether it is in a sorted array."""
    if len(among) == 0:
        return np.zeros(len(keys), bool)
    place = np.searchsorted(among, keys)
    place[place == len(among)] = 0
    is_equal: NDArray[np.bool_] = among[place] == keys
    return is_equal


def merge(old: Keys, new: Keys) -> Keys:
    """Join two sorted arrays without common keys."""
    if len(old) == 0 or len(new) == 0:
        return new if len(old) == 0 else old
    if len(new) * 8 < len(old):
        return np.insert(old, np.searchsorted(old, new), new)
    both = np.concatenate((old, new))
    both.sort(kind="stable")  # two ascending runs: one pass
    return both


def connecting(keys: Keys) -> Keys:
    """Return as few pairs as connect all that some pairs connect, each from a lowest id.

    >>> clique = Column.of([1, 1, 2, 7], [2, 3, 3, 8]).keys
    >>> [(int(key) >> 32, int(key) & 0xFFFFFFFF) for key in connecting(clique)]
    [(1, 2), (1, 3), (7, 8)]
    """
    ids = distinct(np.concatenate((distinct(upper(keys)), distinct(lower(keys)))))
    left, right = np.searchsorted(ids, upper(keys)), np.searchsorted(ids, lower(keys))
    lowest = np.arange(len(ids))
    while True:
        apart = lowest[left] != lowest[right]
        if not apart.any():
            break
        left, right = left[apart], right[apart]
        a, b = lowest[left], lowest[right]
        np.minimum.at(lowest, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(further := lowest[lowest], lowest):
            lowest = further
    others = lowest != np.arange(len(ids))
    return pack(ids[lowest[others]], ids[others])


class Column:
    """The pairs of one property, immutable.

    Examples
    --------
    >>> column = Column.of([1, 1, 2], [5, 6, 5])
    >>> column.objects(1).tolist(), column.subjects(5).tolist()
    ([5, 6], [1, 2])
    """

    __slots__ = ("_inverse", "keys")

    def __init__(self, keys: Keys) -> None:
        self.keys = keys
        self._inverse: Keys | None = None

    @classmethod
    def of(cls, subjects: list[int], objects: list[int]) -> Column:
        """Make a column from two lists of ids of the same length."""
        high, low = np.array(subjects, np.uint64), np.array(objects, np.uint64)
        return cls(distinct(pack(high, low)))

    def __len__(self) -> int:
        return len(self.keys)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return zip(upper(self.keys).tolist(), lower(self.keys).tolist(), strict=True)

    @property
    def inverse(self) -> Keys:
        """The pairs with the object in the upper half, ascending; made when first asked for."""
        if self._inverse is None:
            self._inverse = np.sort(pack(lower(self.keys), upper(self.keys)))
        return self._inverse

    def highest_resource(self) -> int:
        """Return the highest id in the column that is not a literal's."""
        objects = lower(self.keys)
        resources = objects[objects < LITERAL]
        highest = int(resources.max()) if len(resources) else 0
        return max(highest, int(self.keys[-1]) >> 32) if len(self.keys) else 0

    def has(self, s: int, o: int) -> bool:
        """Tell whether a pair is in the column."""
        key = np.uint64(s << 32 | o)
        place = int(self.keys.searchsorted(key))
        return place < len(self.keys) and bool(self.keys[place] == key)

    def objects(self, s: int) -> Ids:
        """Return the objects of a subject, ascending."""
        return _slice(self.keys, s)

    def subjects(self, o: int) -> Ids:
        """Return the subjects of an object, ascending."""
        return _slice(self.inverse, o)


def columns_of(facts: Iterable[tuple[int, int, int]]) -> dict[int, Column]:
    """Return facts (subject, property, object) in any order as columns, by property.

    >>> columns_of([(1, 7, 2), (1, 8, 2), (0, 7, 5)])[7].keys.tolist() == [5, (1 << 32) + 2]
    True
    """
    flat = np.fromiter(itertools.chain.from_iterable(facts), np.uint64).reshape(-1, 3)
    order = np.argsort(flat[:, 1], kind="stable")
    subjects, properties, objects = flat[order].T
    keys = pack(subjects, objects)
    distinct_ones, starts = np.unique(properties, return_index=True)
    parts = np.split(keys, starts[1:])
    return {
        p: Column(distinct(part)) for p, part in zip(distinct_ones.tolist(), parts, strict=False)
    }


def _slice(keys: Keys, high: int) -> Ids:
    ends = np.array([high << 32, high << 32 | 0xFFFFFFFF], np.uint64)
    start = int(keys.searchsorted(ends[0]))
    end = int(keys.searchsorted(ends[1], side="right"))
    return lower(keys[start:end])


def expand(keys: Keys, highs: Ids, most: int = MAX_ROWS) -> tuple[NDArray[np.intp], Ids]:
    """Join ids with the upper halves of sorted keys.

    Returns
    -------
    index : (m,) int
        Which of the ids each match belongs to.
    lows : (m,) uint64
        Lower half of each match.

    Examples
    --------
    >>> keys = Column.of([1, 1, 2], [5, 6, 7]).keys
    >>> index, lows = expand(keys, np.uint64([2, 1]))
    >>> index.tolist(), lows.tolist()
    ([0, 1, 1], [7, 5, 6])

    Raises
    ------
    TooManyRowsError
        If there are more matches than may be made at once; none is made then.
    """
    first = highs << HALF
    start = np.searchsorted(keys, first)
    counts = np.searchsorted(keys, first | LOW, side="right") - start
    total = int(counts.sum())
    if total > most:
        raise TooManyRowsError
    index = np.repeat(np.arange(len(highs)), counts)
    offset = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
    return index, lower(keys[np.repeat(start, counts) + offset])
