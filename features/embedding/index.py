"""Vectors of views, searched with faiss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Neighbour", "VectorIndex"]


@dataclass(frozen=True)
class Neighbour:
    """An object near a vector, by its nearest view; ``cosine`` from -1 to 1."""

    object_iri: str
    class_iri: str
    view_iri: str
    cosine: float


class VectorIndex:
    """Unit vectors by the IRI of their view; kept in memory, made again from the graph.

    Examples
    --------
    >>> index = VectorIndex()
    >>> index.add("view:1", "object:1", "class:cup", np.array([1, 0], np.float32))
    >>> index.add("view:2", "object:2", "class:cup", np.array([0, 1], np.float32))
    >>> [found.object_iri for found in index.nearest(np.array([0.8, 0.6], np.float32), 2)]
    ['object:1', 'object:2']
    """

    def __init__(self) -> None:
        self._index: Any = None
        self._names: dict[int, tuple[str, str, str]] = {}
        self._numbers: dict[str, int] = {}
        self._next = 0

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, view: object) -> bool:
        return view in self._numbers

    def add(self, view: str, object_iri: str, class_iri: str, vector: NDArray[np.float32]) -> None:
        """Add a view, or replace it.

        Raises
        ------
        ValueError
            When the vector is of another length than the others.
        """
        import faiss

        if self._index is None:
            self._index = faiss.IndexIDMap2(faiss.IndexFlatIP(len(vector)))
        if len(vector) != self._index.d:
            raise ValueError(f"a vector of {len(vector)} numbers; the others have {self._index.d}")
        self.remove(view)
        number, self._next = self._next, self._next + 1
        self._index.add_with_ids(vector[None].astype(np.float32), np.array([number], np.int64))
        self._names[number], self._numbers[view] = (view, object_iri, class_iri), number

    def remove(self, view: str) -> None:
        """Forget a view; an unknown one is no error."""
        number = self._numbers.pop(view, None)
        if number is not None:
            self._index.remove_ids(np.array([number], np.int64))
            del self._names[number]

    def relabel(self, view: str, object_iri: str, class_iri: str) -> None:
        """Say that a view shows another object; an unknown view is no error."""
        number = self._numbers.get(view)
        if number is not None:
            self._names[number] = (view, object_iri, class_iri)

    def views(self) -> dict[str, tuple[str, str]]:
        """Return object and class by view."""
        return {view: (object_iri, kind) for view, object_iri, kind in self._names.values()}

    def nearest(self, vector: NDArray[np.float32], count: int) -> list[Neighbour]:
        """Return the nearest objects, each by its nearest view, best first."""
        if not self._names:
            return []
        asked = min(len(self._names), 8 * count)
        cosines, numbers = self._index.search(vector[None].astype(np.float32), asked)
        nearest: dict[str, Neighbour] = {}
        for cosine, number in zip(cosines[0].tolist(), numbers[0].tolist(), strict=True):
            if number in self._names:
                view, object_iri, kind = self._names[number]
                nearest.setdefault(object_iri, Neighbour(object_iri, kind, view, float(cosine)))
        return list(nearest.values())[:count]
