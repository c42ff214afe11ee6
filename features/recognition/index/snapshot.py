"""Snapshot of the index for one query: an immutable set of blocks and their views' labels.

Writers replace the snapshot as a whole, so that a query in another thread never sees half a
change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.cascade import match_exact, match_flat, match_tables
from features.recognition.index.hashing import Hasher
from features.recognition.index.nearest import FAR
from features.recognition.index.segments import Block
from features.recognition.views.appearance import colour_of
from features.recognition.views.light import spread

__all__ = ["EXACT_BELOW", "Matches", "Part", "Snapshot", "StoredView"]

EXACT_BELOW = 2000
"""Rows of a block below which the full product is taken, sealed or not: same answers after both."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Nearest stored descriptor for each of n query descriptors.

    Parameters
    ----------
    view : (n,) int32
        Number of its view in the snapshot, -1 where there is none.
    keypoints : (n, 4) float32
        Its keypoint.
    points3d : (n, 3) float32
        Its place in space, NaN where unknown.
    nearest, rival : (n,) int32
        Squared distances to it and to the nearest of another object; ``FAR`` where none.
    rival_view : (n,) int32
        View of the nearest of another object, -1 where none.
    """

    view: NDArray[np.int32]
    keypoints: NDArray[np.float32]
    points3d: NDArray[np.float32]
    nearest: NDArray[np.int32]
    rival: NDArray[np.int32]
    rival_view: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Part:
    """A block with the number of its first view and its rows that are not removed."""

    block: Block
    first_view: int
    alive: UInt8Array

    @cached_property
    def is_whole(self) -> bool:
        """Whether no row is removed."""
        return bool(self.alive.all())

    def views(self) -> slice:
        """Return the numbers of its views."""
        return slice(self.first_view, self.first_view + len(self.block.looks))

    def view_of(self, rows: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the numbers of the views that rows belong to."""
        views: NDArray[np.int32] = self.block.view_of_row[rows] + np.int32(self.first_view)
        return views

    def match(
        self,
        query: UInt8Array,
        codes: NDArray[np.uint64],
        buckets: NDArray[np.uint32],
        labels: NDArray[np.int32],
    ) -> tuple[NDArray[np.int32], ...]:
        """Return best row and squared distance to it, and those of the nearest of another label.

        Parameters
        ----------
        query, codes, buckets
            Descriptors (n, 128) and what :meth:`Hasher.encode` made of them.
        labels : (V,) int32
            Of the block's views.
        """
        block = self.block
        if len(block) < EXACT_BELOW:
            rows = np.flatnonzero(self.alive).astype(np.int32)
            best, nearest, rival_row, rival = match_exact(
                query, block.descriptors[rows], labels[block.view_of_row[rows]]
            )
            best[best >= 0] = rows[best[best >= 0]]
            rival_row[rival_row >= 0] = rows[rival_row[rival_row >= 0]]
            return best, nearest, rival_row, rival
        if block.tables is not None:
            offsets, rows = block.tables
            return match_tables(
                *(query, codes, buckets, block.descriptors, block.codes, offsets, rows),
                *(labels, block.view_of_row, self.alive, self.is_whole),
            )
        return match_flat(
            *(query, codes, block.descriptors, block.codes),
            *(labels, block.view_of_row, self.alive),
        )


@dataclass(frozen=True, eq=False)
class StoredView:
    """One stored view, as verification needs it.

    Parameters
    ----------
    descriptors : (n, 128) uint8
    keypoints : (n, 4) float32
    points3d : (n, 3) float32, m
    picture
        Encoded; empty where none was kept.
    """

    descriptors: UInt8Array
    keypoints: NDArray[np.float32]
    points3d: NDArray[np.float32]
    picture: bytes | memoryview


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The index at one moment.

    Parameters
    ----------
    parts
        Blocks in the order of their view numbers.
    object_of_view, class_of_view : (V,) int32
        Numbers into the lists of IRIs.
    alive : (V,) bool
        False = removed.
    view_iris, object_iris, class_iris
        Lists that only ever grow.
    hasher
        Of all codes in the blocks.
    serials : (V,) int64
        Of the views as the index received them: a view keeps its number here when the index is
        sealed, and one that is replaced under its IRI gets another. 0 for removed ones.
    """

    parts: tuple[Part, ...]
    object_of_view: NDArray[np.int32]
    class_of_view: NDArray[np.int32]
    alive: NDArray[np.bool_]
    view_iris: Sequence[str]
    object_iris: Sequence[str]
    class_iris: Sequence[str]
    hasher: Hasher
    serials: NDArray[np.int64]

    def match(self, descriptors: UInt8Array, labels: NDArray[np.int32] | None = None) -> Matches:
        """Match descriptors (n, 128) against everything that is stored.

        Parameters
        ----------
        labels : (V,) int32, optional
            What a rival has to differ in, default :attr:`object_of_view`.
        """
        n = len(descriptors)
        matches = Matches(
            view=np.full(n, -1, np.int32),
            keypoints=np.zeros((n, 4), np.float32),
            points3d=np.full((n, 3), np.nan, np.float32),
            nearest=np.full(n, FAR, np.int32),
            rival=np.full(n, FAR, np.int32),
            rival_view=np.full(n, -1, np.int32),
        )
        parts = [part for part in self.parts if len(part.block)]
        if n == 0 or not parts:
            return matches
        codes, buckets = self.hasher.encode(descriptors)
        labels = self.object_of_view if labels is None else labels
        answers = [part.match(descriptors, codes, buckets, labels[part.views()]) for part in parts]
        nearest = np.stack([answer[1] for answer in answers])
        winner = nearest.argmin(axis=0)
        for p, (part, (row, distance, *_)) in enumerate(zip(parts, answers, strict=True)):
            won = (winner == p) & (row >= 0)
            rows = row[won]
            matches.view[won] = part.view_of(rows)
            matches.keypoints[won] = part.block.keypoints[rows]
            matches.points3d[won] = part.block.points3d[rows]
            matches.nearest[won] = distance[won]
        # The rival is the nearest whose label is not the winner's: of each part its first where
        # that has another label, else its second.
        winner_label = labels[matches.view]
        for part, (row, distance, second_row, second) in zip(parts, answers, strict=True):
            own = (row >= 0) & (labels[part.view_of(row)] == winner_label)
            rival = np.where(own, second, distance)
            nearer = rival < matches.rival
            matches.rival[nearer] = rival[nearer]
            matches.rival_view[nearer] = part.view_of(np.where(own, second_row, row)[nearer])
        return matches

    def appearance(self, look: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity (V,) of an appearance vector (768,) to every view; removed: -1."""
        if not self.parts:
            return np.empty(0, np.float32)
        similarity = np.concatenate([part.block.looks @ look for part in self.parts])
        return np.where(self.alive, similarity, np.float32(-1))

    def colours(
        self, colours: NDArray[np.float32], costs: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Return the similarity (V,) of colours to those of every view; removed: -1.

        Parameters
        ----------
        colours : (L, 192) float32
            Histograms of the query in several lights; the light that suits a view best counts.
        costs : (L,) float32
            Taken off the similarity in each light.
        """
        if not self.parts:
            return np.empty(0, np.float32)
        asked = spread(colours)
        similarity = [
            (asked @ part.block.colours.T - costs[:, None]).max(axis=0) for part in self.parts
        ]
        return np.where(self.alive, np.concatenate(similarity), np.float32(-1))

    def shapes(self, shape: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity (V,) of a shape (240,) to every view; -1 where it has none."""
        if not self.parts:
            return np.empty(0, np.float32)
        similarity = np.concatenate([part.block.shapes @ shape for part in self.parts])
        return np.where(self.alive & np.isfinite(similarity), similarity, np.float32(-1))

    def measures(self, views: NDArray[np.integer]) -> NDArray[np.float32]:
        """Return mask side (px), visible diagonal (m), cut or not of the chosen views (k, 3)."""
        if not self.parts:
            return np.empty((0, 3), np.float32)
        measures = np.concatenate([part.block.measures for part in self.parts])
        chosen: NDArray[np.float32] = measures[views]
        return chosen

    def look(self, view: int) -> NDArray[np.float32]:
        """Return the appearance vector (768,) of one view."""
        part = self._part_of(view)
        return np.asarray(part.block.looks[view - part.first_view], np.float32)

    def colour(self, view: int) -> NDArray[np.float32]:
        """Return the colour histogram (192,) of one view, as :func:`colour_histogram` makes it."""
        return colour_of(self.look(view))

    def _part_of(self, view: int) -> Part:
        starts = [part.first_view for part in self.parts]
        return self.parts[int(np.searchsorted(starts, view, side="right")) - 1]

    def stored_view(self, view: int) -> StoredView:
        """Return the rows of one view."""
        part = self._part_of(view)
        number, block = view - part.first_view, part.block
        rows = block.rows_of(number)
        return StoredView(
            block.descriptors[rows], block.keypoints[rows], block.points3d[rows],
            block.picture(number),
        )  # fmt: skip
