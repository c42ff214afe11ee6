"""Merge policy: which segments merge or shrink when the delta is sealed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.recognition.index.folder import SegmentEntry
from features.recognition.index.segments import Block, ViewName

__all__ = ["MAX_DEAD", "Piece", "sealed_pieces"]

MAX_DEAD = 0.25
"""Share of removed views above which a segment is rewritten without them."""

_ALIKE = 2.0


@dataclass(frozen=True, eq=False)
class Piece:
    """A block with the names that its views have by now, and those removed.

    Parameters
    ----------
    block
        With tables once it is sealed.
    names
        Of the block's V views.
    alive : (V,) bool
    folder
        Name of the segment's folder, where it has one.
    """

    block: Block
    names: tuple[ViewName, ...]
    alive: NDArray[np.bool_]
    folder: str | None = None

    @property
    def dead_share(self) -> float:
        """Share of removed views."""
        return 1.0 - float(self.alive.mean()) if len(self.alive) else 1.0

    def entry(self, folder: str) -> SegmentEntry:
        """Return what a manifest says about it."""
        dead = np.flatnonzero(~self.alive).tolist()
        relabelled = {
            view: (new.object_iri, new.class_iri)
            for view, (new, old) in enumerate(zip(self.names, self.block.names, strict=True))
            if new != old and self.alive[view]
        }
        return SegmentEntry(folder, tuple(dead), relabelled)

    @classmethod
    def of_entry(cls, entry: SegmentEntry, block: Block) -> Piece:
        """Return a stored segment as the manifest has it."""
        names = list(block.names)
        for view, (object_iri, class_iri) in entry.relabelled.items():
            names[view] = ViewName(names[view].view_iri, object_iri, class_iri)
        alive = np.ones(len(names), bool)
        alive[list(entry.dead)] = False
        return cls(block, tuple(names), alive, entry.name)


def sealed_pieces(pieces: Sequence[Piece]) -> list[Piece]:
    """Return the pieces of the next manifest, all with tables; an untouched one keeps its folder.

    Neighbours whose sizes differ by less than a factor of two are joined, again and again: a
    query meets about as many segments as the logarithm of the number of seals.
    """
    groups: list[tuple[list[Piece], int]] = []
    for piece in pieces:
        live = int(np.count_nonzero(piece.alive[piece.block.view_of_row]))
        group, rows = [piece], live
        while groups and max(rows, groups[-1][1]) < _ALIKE * min(rows, groups[-1][1]):
            earlier, earlier_rows = groups.pop()
            group, rows = earlier + group, earlier_rows + rows
        groups.append((group, rows))
    return [_sealed(group) for group, _ in groups if any(piece.alive.any() for piece in group)]


def _sealed(group: Sequence[Piece]) -> Piece:
    only = group[0]
    if len(group) == 1 and only.block.tables is not None and only.dead_share <= MAX_DEAD:
        return only
    block = Block.joined([piece.block.kept(piece.alive, piece.names) for piece in group])
    return Piece(block.with_tables(), block.names, np.ones(len(block.names), bool))
