"""Placements that were read of late, until a commit touches what they consist of."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from rtask.rdf.terms import NamedNode
from rtask.world.placement import Placement, read_placement

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore

__all__ = ["PlacementCache"]

_MAX_PLACEMENTS = 5_000


class PlacementCache:
    """Stored placements, each read once while nothing about it changes.

    A report of what stands on a table asks the same placements several times over.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._bulk_loads = kb.bulk_loads
        self._changes = 0
        self._placements: dict[str, Placement | None] = {}
        self._nodes_of_part: dict[str, set[str]] = {}

    def read(self, node: str) -> Placement | None:
        """Return a stored placement, or None if its subject or its begin is missing."""
        with self._lock:
            if self._bulk_loads != self._kb.bulk_loads:
                self._bulk_loads = self._kb.bulk_loads
                self._clear()
            if node in self._placements:
                return self._placements[node]
            changes = self._changes
        parts: set[str] = {node}
        placement = read_placement(self._kb, node, parts)
        with self._lock:
            # What was read while a commit was stored may be of before it.
            if changes == self._changes:
                if len(self._placements) >= _MAX_PLACEMENTS:
                    self._clear()
                self._placements[node] = placement
                for part in parts:
                    self._nodes_of_part.setdefault(part, set()).add(node)
        return placement

    def forget(self, change: Change) -> None:
        """Forget the placements that a commit touched."""
        with self._lock:
            self._changes += 1
            for quad in (*change.added, *change.removed):
                if isinstance(quad.subject, NamedNode):
                    for node in self._nodes_of_part.pop(quad.subject.value, ()):
                        self._placements.pop(node, None)

    def _clear(self) -> None:
        self._changes += 1
        self._placements.clear()
        self._nodes_of_part.clear()
