"""Moments at which something changed, for who slides along time."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtask.world.index.tail import Entry

__all__ = ["Moments", "moments_about"]

_NEVER = float("inf")
_Sorted = tuple[NDArray[np.float64], NDArray[np.intp]]


class Moments(NamedTuple):
    """Unix times, s, of the first and the last change, and of those before and after an instant."""

    first_s: float
    last_s: float
    before_s: float | None
    after_s: float | None


def moments_about(
    time_s: float, tail: Sequence[Entry], changes: tuple[_Sorted, _Sorted], gone: Collection[int]
) -> Moments | None:
    """Return when the first thing came somewhere, and when anything changed about a time.

    Parameters
    ----------
    tail
        Placements that are not sorted in.
    changes
        The begins, then the ends, of those that are, Unix times, each with its order.
    gone
        Rows that do not count.

    Returns
    -------
    None if nothing has a place.
    """
    late = [moment for e in tail for moment in (e.begin, e.end)]
    before = [moment for moment in late if moment < time_s]
    after = [moment for moment in late if time_s < moment < _NEVER]
    last = [moment for moment in late if moment < _NEVER]
    for times, order in changes:
        low = int(np.searchsorted(times, time_s, side="left", sorter=order))
        high = int(np.searchsorted(times, time_s, side="right", sorter=order))
        before += _first_staying(times, order[:low][::-1], gone)
        after += _first_staying(times, order[high:], gone)
        ended = int(np.searchsorted(times, _NEVER, side="left", sorter=order))
        last += _first_staying(times, order[:ended][::-1], gone)
    first = [e.begin for e in tail] + _first_staying(*changes[0], gone)
    if not first:
        return None
    return Moments(
        min(first), max(last), max(before, default=None),
        min((moment for moment in after if moment < _NEVER), default=None),
    )  # fmt: skip


def _first_staying(
    times: NDArray[np.float64], rows: Iterable[np.intp], gone: Collection[int]
) -> list[float]:
    """Return the time of the first of some rows that is not gone, if there is one."""
    staying = (float(times[k]) for k in rows if int(k) not in gone)
    return list(itertools.islice(staying, 1))
