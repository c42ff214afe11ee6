"""Exhaustive matching with faiss: the reference for the cascade, far slower than it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.nearest import FAR

__all__ = ["ExactMatcher"]


class ExactMatcher:
    """Exact nearest neighbours among labelled descriptors.

    Parameters
    ----------
    descriptors : (N, 128) uint8
    labels : (N,) int
        Object of each row.
    """

    def __init__(self, descriptors: UInt8Array, labels: NDArray[np.integer]) -> None:
        import faiss

        if len(descriptors) != len(labels):
            raise ValueError(f"{len(descriptors)} descriptors but {len(labels)} labels")
        self._labels = np.asarray(labels)
        self._index: Any = faiss.IndexFlatL2(128)
        self._index.add(np.ascontiguousarray(descriptors, np.float32))

    def match(
        self, query: UInt8Array
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """Return best row and squared distances to it and to the nearest of another label (n,)."""
        n, total = len(query), len(self._labels)
        best, nearest = np.full(n, -1, np.int32), np.full(n, FAR, np.int32)
        rival = np.full(n, FAR, np.int32)
        open_rows, asked = np.arange(n), min(8, total)
        while len(open_rows) and total:
            wanted = np.ascontiguousarray(query[open_rows], np.float32)
            distance, row = self._index.search(wanted, asked)
            best[open_rows], nearest[open_rows] = row[:, 0], np.rint(distance[:, 0])
            other = self._labels[row] != self._labels[row[:, :1]]
            has_other = other.any(axis=1)
            first = other.argmax(axis=1)[has_other]
            rival[open_rows[has_other]] = np.rint(distance[has_other, first])
            if asked == total:
                break
            open_rows, asked = open_rows[~has_other], min(4 * asked, total)
        return best, nearest, rival
