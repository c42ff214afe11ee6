"""Stays: runs of placements at one place, each of which begins as the one before it ends.

A thing that is nudged about in a box, or that somebody looks at for a year, has thousands of
placements there. Where such a run begins is read from a table, not found by walking through it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["stays_from"]


def stays_from(
    subjects: NDArray[np.int32],
    begins: NDArray[np.float64],
    ends: NDArray[np.float64],
    places: NDArray[np.int32],
) -> NDArray[np.intp]:
    """Return for each row the first one from which the thing stayed where it is, without a break.

    Parameters
    ----------
    subjects, begins, ends, places : (n,)
        Sorted by subject and begin; times in s. Place -1 stands for a mere pose.

    Examples
    --------
    >>> subjects, places = np.array([0, 0, 0, 0, 1]), np.array([7, 7, 7, 8, 8])
    >>> begins, ends = np.array([0.0, 1, 2, 3, 4]), np.array([1.0, 2, 3, 4, np.inf])
    >>> stays_from(subjects, begins, ends, places).tolist()
    [0, 0, 0, 3, 4]
    """
    count = len(subjects)
    if not count:
        return np.empty(0, np.intp)
    follows = (
        (subjects[1:] == subjects[:-1])
        & (places[1:] == places[:-1])
        & (places[1:] >= 0)
        & (ends[:-1] == begins[1:])
    )
    # Which of two placements with one begin counts depends on more than their order: who asks
    # looks at them one by one.
    is_tied = (subjects[1:] == subjects[:-1]) & (begins[1:] == begins[:-1])
    follows[is_tied] = False
    follows[1:] &= ~is_tied[:-1]
    is_first = np.concatenate([[True], ~follows])
    return np.maximum.accumulate(np.where(is_first, np.arange(count), 0))
