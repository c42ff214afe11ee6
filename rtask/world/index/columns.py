"""Columns of the index of placements: how they are joined and ordered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["joined", "order_of"]


def joined(old: NDArray[Any], staying: NDArray[np.bool_], new: Sequence[object]) -> NDArray[Any]:
    """Return the rows of a column that stay, and new ones."""
    return np.concatenate([old[staying], np.array(new, old.dtype).reshape(-1, *old.shape[1:])])


def order_of(
    subjects: NDArray[np.int32], begins: NDArray[np.float64], nodes: Sequence[str]
) -> NDArray[np.intp]:
    """Return the order by subject, then begin, then node."""
    order = np.lexsort((begins, subjects))
    subjects, begins = subjects[order], begins[order]
    is_tied = (subjects[1:] == subjects[:-1]) & (begins[1:] == begins[:-1])
    first = 0
    for last in (*(np.flatnonzero(~is_tied) + 1).tolist(), len(order)) if is_tied.any() else ():
        if last - first > 1:
            order[first:last] = sorted(order[first:last].tolist(), key=nodes.__getitem__)
        first = last
    return order
