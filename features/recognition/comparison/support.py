"""Agreement of one stored view with another: what the facts of the store are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.comparison.alignment import Alignment
from features.recognition.comparison.difference import Comparison
from features.recognition.comparison.evidence import ViewFacts

__all__ = ["ViewPair", "facts_of", "keypoints_only", "view_pair"]

MIN_MATCHES = 8
"""Matches from which another view says something about a view's keypoints and cells."""


@dataclass(frozen=True, eq=False)
class ViewPair:
    """Agreement of a stored view with another one, seen in the first one's frame.

    Parameters
    ----------
    rows : (n,) intp
        Keypoints of the first that the second confirms.
    valid, agreeing : (bytes,) uint8
        Cells of its picture that both show, and those where the print is the same; one bit each.
        None where only keypoints were compared: of a view of another object nothing else counts.
    """

    rows: NDArray[np.int32]
    valid: UInt8Array
    agreeing: UInt8Array

    @property
    def is_drawn(self) -> bool:
        """Tell whether cells were compared; in a file, there may be empty ones where none were."""
        return bool(self.valid.any())


def view_pair(alignment: Alignment, comparison: Comparison) -> ViewPair:
    """Return what a comparison in the frame of the first view says of it."""
    same = (comparison.correlation > 0.5) | (~comparison.textured & (comparison.correlation > -0.2))
    same &= comparison.near & (comparison.colour_gap < 12)
    return ViewPair(
        rows=alignment.query_rows.astype(np.int32),
        valid=np.packbits(comparison.near),
        agreeing=np.packbits(same),
    )


def keypoints_only(alignment: Alignment) -> ViewPair:
    """Return what matches alone say of the first view: which of its keypoints the other has."""
    nothing = np.empty(0, np.uint8)
    return ViewPair(alignment.query_rows.astype(np.int32), nothing, nothing)


def facts_of(
    keypoints: int,
    cells: int,
    own: Sequence[ViewPair | None],
    others: Sequence[ViewPair | None],
) -> ViewFacts:
    """Return the facts of a view.

    Parameters
    ----------
    keypoints, cells
        How many the view has.
    own, others
        Its pairs with other views of the same object, and of other objects; None for a view that
        does not agree with it.

    Examples
    --------
    >>> every = np.ones(4, bool)
    >>> pair = ViewPair(np.arange(8), np.packbits(every), np.packbits(every))
    >>> facts = facts_of(9, 4, [pair], [])
    >>> facts.own.tolist(), round(float(facts.support[0]), 2)
    ([1, 1, 1, 1, 1, 1, 1, 1, 0], 0.59)
    """
    agreeing, valid = np.zeros(cells, np.float32), np.zeros(cells, np.float32)
    like = [pair for pair in own if pair is not None]
    for pair in (pair_like for pair_like in like if pair_like.is_drawn):
        agreeing += np.unpackbits(pair.agreeing, count=cells)
        valid += np.unpackbits(pair.valid, count=cells)
    return ViewFacts(
        own=_counted(keypoints, like),
        shared=_counted(keypoints, [pair for pair in others if pair is not None]),
        # One view that agrees is not yet the rule: the 0.7 stands for those that were not taken.
        support=agreeing / (valid + np.float32(0.7)),
        verified=len(like),
        unlike=len(own) - len(like),
    )


def _counted(keypoints: int, pairs: Sequence[ViewPair]) -> NDArray[np.int32]:
    counts = np.zeros(keypoints, np.int32)
    for pair in pairs:
        counts[np.unique(pair.rows)] += 1
    return counts
