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
        cells = max((len(pair.valid) for pair in self.pairs.values() if pair is not None), default=0)
        chunks = [
            _COUNTS.pack(len(votes.view), len(self.own), len(self.others), cells),
            *(array.astype("<i8").tobytes() for array in (votes.view, votes.rival_view)),
            *(array.astype("<i4").tobytes() for array in (votes.nearest, votes.rival)),
        ]
        for number in compared:
            pair = self.pairs[number]
            chunks.append(struct.pack("<qi", number, -1 if pair is None else len(pair.rows)))
            if pair is not None:
                chunks.append(pair.rows.astype("<i4").tobytes())
                # A view of another object has no cells; in the file every pair has as many.
                chunks += [pair.valid.tobytes().ljust(cells, b"\0")]
                chunks += [pair.agreeing.tobytes().ljust(cells, b"\0")]
        # Earlier versions read up to here.
        chunks.append(np.array(sorted(self.different), "<i8").tobytes())
        return b"".join(chunks)

    @classmethod
    def from_bytes(cls, place: int, data: bytes) -> Known:
        """Read what :meth:`to_bytes` wrote; ValueError where the data end too soon."""
        reader = _Reader(data)
        count, own, others, cells = (int(k) for k in reader.array("<i4", 4))
        view, rival_view = reader.array("<i8", count), reader.array("<i8", count)
        nearest, rival = reader.array("<i4", count), reader.array("<i4", count)
        pairs: dict[int, ViewPair | None] = {}
        for _ in range(own + others):
            number, rows = int(reader.array("<i8", 1)[0]), int(reader.array("<i4", 1)[0])
            pairs[number] = (
                ViewPair(
                    reader.array("<i4", rows), reader.array("u1", cells), reader.array("u1", cells)
                )
                if rows >= 0
                else None
            )
        compared, different = tuple(pairs), frozenset(reader.rest("<i8").tolist())
        votes = Votes(view, nearest, rival_view, rival)
        return cls(place, votes, compared[:own], compared[own:], pairs, different)


class _Reader:
    """Arrays that stand one behind the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self._position = data, 0

    def array(self, dtype: str, count: int) -> NDArray[Any]:
        """Return the next ones."""
        found = np.frombuffer(self._data, dtype, count, self._position)
        self._position += found.nbytes
        return found

    def rest(self, dtype: str) -> NDArray[Any]:
        """Return all that follow."""
        return np.frombuffer(self._data[self._position :], dtype)
