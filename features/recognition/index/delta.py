"""The part of the index that still grows: views added since the last seal."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.recognition.index.segments import Block

__all__ = ["Delta"]


class Delta:
    """Appends blocks in place; a block taken from it never changes.

    Arrays are written beyond the rows that earlier blocks show, and replaced by longer copies
    when they are full.

    Examples
    --------
    >>> delta = Delta()
    >>> delta.append(Block.empty(rows=3, views=1))
    >>> len(delta.block()), len(delta)
    (3, 1)
    """

    def __init__(self) -> None:
        self._rows = self._views = 0
        self._arrays: dict[str, NDArray[Any]] = Block.empty(4096, 16).arrays()
        self._per_view = {"looks", "measures", "shapes"}
        self._pictures: tuple[bytes | memoryview, ...] = ()

    def __len__(self) -> int:
        """Return the number of views."""
        return self._views

    def append(self, block: Block) -> None:
        """Add the views of a block."""
        added = block.arrays()
        added["view_of_row"] = block.view_of_row + np.int32(self._views)
        for field, array in added.items():
            start = self._views if field in self._per_view else self._rows
            stop = start + len(array)
            if stop > len(self._arrays[field]):
                longer = np.zeros((2 * stop, *array.shape[1:]), self._arrays[field].dtype)
                longer[:start] = self._arrays[field][:start]
                self._arrays[field] = longer
            self._arrays[field][start:stop] = array
        self._pictures += tuple(block.picture(view) for view in range(len(block.looks)))
        self._rows += len(block)
        self._views += len(block.looks)

    def block(self) -> Block:
        """Return what is in it by now, without copying; names stay with the index."""
        shown: dict[str, Any] = {
            field: array[: self._views if field in self._per_view else self._rows]
            for field, array in self._arrays.items()
        }
        return Block(**shown, pictures=self._pictures)
