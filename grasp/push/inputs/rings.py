"""Classification of a drawing's rings into outline, holes and further parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.polygon import as_polygon

__all__ = ["PartRings", "joined", "outline_and_holes"]

_MIN_HOLE = 1e-5
"""Of the outline's area: smaller rings are marks."""
_MIN_PART = 1e-2
"""Of the outline's area: smaller rings beside it are marks."""
_SAME = 0.98
"""Of the outline's area: larger rings inside it are the outline drawn twice."""


class PartRings(NamedTuple):
    """Rings of a drawing, sorted by what they are.

    Parameters
    ----------
    outline : (n, 2)
    holes : each (m, 2)
    others
        How many rings beside the outline, or across it, may be parts of their own.
    """

    outline: FloatArray
    holes: tuple[FloatArray, ...]
    others: int = 0


def outline_and_holes(rings: Sequence[FloatArray], what: str) -> PartRings:
    """Return the ring that encloses most, and the outermost rings inside it.

    What lies in a hole is neither a hole nor a part.

    Raises
    ------
    ValueError
        When nothing is closed, or a hole's outline crosses itself.
    """
    closed = sorted((r for r in rings if len(r) >= 3), key=_enclosed, reverse=True)
    if not closed or _enclosed(closed[0]) == 0.0:
        raise ValueError(f"no closed outline in this {what}")
    outline, holes, others = closed[0], list[FloatArray](), list[FloatArray]()
    for ring in closed[1:]:
        share = _enclosed(ring) / _enclosed(outline)
        if share < _MIN_HOLE:
            break
        if share > _SAME and _is_about(ring, outline):
            continue
        if not _is_inside(ring, outline):
            # What lies inside another part is a hole of that part.
            if share >= _MIN_PART and not any(_is_inside(ring, part) for part in others):
                others.append(ring)
        elif not any(_touches(ring, hole) for hole in holes):
            try:
                holes.append(as_polygon(ring))
            except ValueError as error:
                raise ValueError(f"hole {len(holes) + 1}: {error}") from error
    return PartRings(outline, tuple(holes), len(others))


def joined(pieces: Sequence[FloatArray]) -> Iterator[tuple[FloatArray, bool]]:
    """Join polylines end to end; yield each chain and whether it closed."""
    if not pieces:
        return
    near = 1e-6 * float(np.ptp(np.vstack(pieces), axis=0).max() or 1.0)
    left = list(pieces)
    while left:
        chain = left.pop()
        grown = True
        while grown and not _is_closed(chain, near):
            grown = False
            for i, piece in enumerate(left):
                for line in (piece, piece[::-1]):
                    if np.abs(line[0] - chain[-1]).max() <= near:
                        chain, grown = np.vstack([chain, line[1:]]), True
                        break
                    if np.abs(line[-1] - chain[0]).max() <= near:
                        chain, grown = np.vstack([line[:-1], chain]), True
                        break
                if grown:
                    del left[i]
                    break
        closed = _is_closed(chain, near)
        yield (chain[:-1] if closed else chain), closed


def _is_closed(chain: FloatArray, near: float) -> bool:
    return len(chain) > 3 and float(np.abs(chain[0] - chain[-1]).max()) <= near


def _enclosed(ring: FloatArray) -> float:
    x, y = (ring - ring[0]).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _covers(ring: FloatArray, points: FloatArray) -> FloatArray:
    """Return which points (m, 2) a ring encloses, (m,) bool."""
    a, b = ring, np.roll(ring, -1, axis=0)
    px, py = points[:, :1], points[:, 1:]
    spans = (a[:, 1] > py) != (b[:, 1] > py)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    left = px < a[:, 0] + (py - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return np.asarray((spans & left).sum(axis=1) % 2 == 1)


def _is_inside(ring: FloatArray, outline: FloatArray) -> bool:
    return bool(np.all(_covers(outline, ring)))


def _is_about(ring: FloatArray, outline: FloatArray) -> bool:
    """Return whether a ring of nearly the same area covers nearly the same place."""
    size = np.ptp(outline, axis=0).max()
    low, high = ring.min(axis=0) - outline.min(axis=0), ring.max(axis=0) - outline.max(axis=0)
    return bool(max(np.abs(low).max(), np.abs(high).max()) <= (1.0 - _SAME) * size)


def _touches(ring: FloatArray, hole: FloatArray) -> bool:
    """Return whether a smaller ring lies in a hole or reaches into it."""
    return bool(np.any(_covers(hole, ring)))
