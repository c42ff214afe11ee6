"""Facts about one stored view: its votes, and how it agrees with the views they chose."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.support import ViewPair
from features.recognition.comparison.votes import Votes

__all__ = ["Known"]

_COUNTS = struct.Struct("<4i")


@dataclass(frozen=True, eq=False)
class Known:
    """Basis of a view's facts; views by their numbers in the sequence of changes.

    Parameters
    ----------
    place
        In that sequence, since when it holds.
    votes
        Of the view's descriptors.
    own, others
        The views of the same object and of others that it was compared with.
    pairs
        What came of it; None where two views do not agree.
    different
        Views of other objects that show another print, whatever else is stored.
    """

    place: int
    votes: Votes
    own: tuple[int, ...]
    others: tuple[int, ...]
    pairs: Mapping[int, ViewPair | None]
    different: frozenset[int] = frozenset()

    @property
    def has_voted(self) -> bool:
        return len(self.votes.view) > 0

    @property
    def is_drawn(self) -> bool:
        """Tell whether the picture was compared with those of all views of the same object."""
        own = (self.pairs[number] for number in self.own)
        return all(pair is None or pair.is_drawn for pair in own)

    def to_bytes(self) -> bytes:
        """Return everything but the place, numbers little-endian.

        Examples
        --------
        >>> one, near = np.ones(2, np.int64), np.zeros(2, np.int32)
        >>> cells = np.packbits(np.ones(9, bool))
        >>> pair = ViewPair(np.arange(3, dtype=np.int32), cells, cells)
        >>> pairs = {2: pair, 5: None}
        >>> known = Known(7, Votes(one, near, one, near), (2,), (5,), pairs, frozenset({9}))
        >>> again = Known.from_bytes(7, known.to_bytes())
        >>> again.own, again.pairs[5], again.pairs[2].rows.tolist(), set(again.different)
        ((2,), None, [0, 1, 2], {9})
        """
        votes, compared = self.votes, (*self.own, *self.others)
        cells = max(
            (len(pair.valid) for pair in self.pairs.values() if pair is not None), default=0
        )
        chunks = [
            _COUNTS.pack(len(votes.view), len(self.own), len(self.others), cells),
            *(array.astype("<i8").tobytes() for array in (votes.view, votes.rival_view)),
            *(array.astype("<i4").tobytes() for array in (votes.nearest, votes.rival)),
        ]
        chunks += [_pair_to_bytes(number, self.pairs[number], cells) for number in compared]
        # Earlier versions read up to here.
        chunks.append(struct.pack("<i", len(self.different)))
        chunks.append(np.array(sorted(self.different), "<i8").tobytes())
        more = (number for number in self.pairs if number not in compared)
        chunks += [_pair_to_bytes(number, self.pairs[number], cells) for number in more]
        return b"".join(chunks)

    @classmethod
    def from_bytes(cls, place: int, data: bytes) -> Known:
        """Read what :meth:`to_bytes` wrote; ValueError where the data end too soon."""
        reader = _Reader(data)
        count, own, others, cells = (int(k) for k in reader.array("<i4", 4))
        view, rival_view = reader.array("<i8", count), reader.array("<i8", count)
        nearest, rival = reader.array("<i4", count), reader.array("<i4", count)
        pairs = dict(_read_pair(reader, cells) for _ in range(own + others))
        compared, different = tuple(pairs), frozenset[int]()
        if reader.has_more:
            different = frozenset(reader.array("<i8", int(reader.array("<i4", 1)[0])).tolist())
        while reader.has_more:
            number, pair = _read_pair(reader, cells)
            pairs[number] = pair
        votes = Votes(view, nearest, rival_view, rival)
        return cls(place, votes, compared[:own], compared[own:], pairs, different)


class _Reader:
    """Arrays that stand one behind the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self._position = data, 0

    def array(self, dtype: str, count: int) -> NDArray[Any]:
        """Return the next ones."""
        values = np.frombuffer(self._data, dtype, count, self._position)
        self._position += values.nbytes
        return values

    @property
    def has_more(self) -> bool:
        return self._position < len(self._data)


def _pair_to_bytes(number: int, pair: ViewPair | None, cells: int) -> bytes:
    """Return a pair behind the number of its view.

    A view of another object has no cells; in the file every pair has as many.
    """
    if pair is None:
        return struct.pack("<qi", number, -1)
    masks = (mask.tobytes().ljust(cells, b"\0") for mask in (pair.valid, pair.agreeing))
    head = struct.pack("<qi", number, len(pair.rows))
    return b"".join([head, pair.rows.astype("<i4").tobytes(), *masks])


def _read_pair(reader: _Reader, cells: int) -> tuple[int, ViewPair | None]:
    number, rows = int(reader.array("<i8", 1)[0]), int(reader.array("<i4", 1)[0])
    if rows < 0:
        return number, None
    arrays = reader.array("<i4", rows), reader.array("u1", cells), reader.array("u1", cells)
    return number, ViewPair(*arrays)
