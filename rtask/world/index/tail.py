"""Tail of the index of placements: those since the last sorting, by thing and by frame."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

__all__ = ["Entry", "Tail"]


class Entry(NamedTuple):
    """A placement in the index; frame -1 stands for no pose. Times in s, position in m."""

    subject: int
    begin: float
    node: str
    end: float
    frame: int
    x: float
    y: float
    z: float


class Tail:
    """Placements that are not sorted yet.

    >>> tail = Tail()
    >>> tail.add(Entry(1, 0.0, "urn:a", 9.0, 2, 0.0, 0.0, 0.0))
    >>> len(tail), [entry.node for entry in tail.in_frame(2)], list(tail.of_subject(2))
    (1, ['urn:a'], [])
    """

    def __init__(self) -> None:
        self._entries: dict[str, Entry] = {}
        self._of_subject: dict[int, dict[str, Entry]] = {}
        self._in_frame: dict[int, dict[str, Entry]] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def values(self) -> list[Entry]:
        """Return all placements."""
        return list(self._entries.values())

    def of_subject(self, number: int) -> Collection[Entry]:
        """Return the placements of a thing or frame."""
        return self._of_subject.get(number, {}).values()

    def in_frame(self, number: int) -> Collection[Entry]:
        """Return the placements whose pose is in a frame."""
        return self._in_frame.get(number, {}).values()

    def add(self, entry: Entry) -> None:
        """Add a placement, or replace what was known of it."""
        self.remove(entry.node)
        self._entries[entry.node] = entry
        self._of_subject.setdefault(entry.subject, {})[entry.node] = entry
        self._in_frame.setdefault(entry.frame, {})[entry.node] = entry

    def remove(self, node: str) -> None:
        """Forget a placement, if it is here."""
        entry = self._entries.pop(node, None)
        if entry is not None:
            del self._of_subject[entry.subject][node]
            del self._in_frame[entry.frame][node]
