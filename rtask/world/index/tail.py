"""Tail of the index of placements: those since the last sorting, by thing and by frame."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from rtask.world.index.cells import Cell, cell_of

__all__ = ["Entry", "Tail"]


class Entry(NamedTuple):
    """A placement in the index; frame -1 stands for no pose. Times in s, position in m.

    Place -1 stands for a mere pose, else it is the number of a relation with a place.
    """

    subject: int
    begin: float
    node: str
    end: float
    frame: int
    x: float
    y: float
    z: float
    place: int = -1

    def follows(self, before: Entry) -> bool:
        """Whether the thing was on, in or held by the same before, without a break."""
        return self.place >= 0 and self.place == before.place and before.end == self.begin


class Tail:
    """Placements that are not sorted yet.

    >>> tail = Tail()
    >>> tail.add(Entry(1, 0.0, "urn:a", 9.0, 2, 0.0, 0.0, 0.0))
    >>> len(tail), tail.last(1, 5.0).node, list(tail.of_subject(2))
    (1, 'urn:a', [])
    """

    def __init__(self) -> None:
        self._entries: dict[str, Entry] = {}
        self._of_subject: dict[int, list[Entry]] = {}
        self._in_cell: dict[Cell, dict[str, Entry]] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def values(self) -> list[Entry]:
        """Return all placements."""
        return list(self._entries.values())

    def of_subject(self, number: int) -> Sequence[Entry]:
        """Return the placements of a thing or frame, sorted."""
        return self._of_subject.get(number, ())

    def last(self, number: int, time_s: float, *, before: bool = False) -> Entry | None:
        """Return the last placement of a thing that began by, or before, an instant."""
        entries = self._of_subject.get(number, ())
        find = bisect_left if before else bisect_right
        k = find(entries, time_s, key=lambda entry: entry.begin)
        return entries[k - 1] if k else None

    def in_cells(self, cells: Iterable[Cell]) -> Iterator[Entry]:
        """Yield the placements whose poses are in some cells."""
        for cell in cells:
            yield from self._in_cell.get(cell, {}).values()

    def add(self, entry: Entry) -> None:
        """Add a placement, or replace what was known of it."""
        self.remove(entry.node)
        self._entries[entry.node] = entry
        insort(self._of_subject.setdefault(entry.subject, []), entry)
        if entry.frame >= 0:
            self._in_cell.setdefault(_cell_of(entry), {})[entry.node] = entry

    def remove(self, node: str) -> None:
        """Forget a placement, if it is here."""
        entry = self._entries.pop(node, None)
        if entry is None:
            return
        entries = self._of_subject[entry.subject]
        del entries[bisect_left(entries, entry)]
        if entry.frame >= 0:
            del self._in_cell[_cell_of(entry)][node]


def _cell_of(entry: Entry) -> Cell:
    return cell_of(entry.frame, entry.x, entry.y, entry.z)
