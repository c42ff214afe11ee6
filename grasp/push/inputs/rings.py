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
        How many other parts there are: rings beside the outline, or across it.
    """

    outline: FloatArray
    holes: tuple[FloatArray, ...]
    others: int = 0


def outline_and_holes(rings: Sequence[FloatArray], what: str, part: int = 1) -> PartRings:
    """Return the outline of a part, the outermost rings inside it, and how many others there are.

    What lies in a hole is neither a hole nor a part.

    Parameters
    ----------
    what
        Kind of drawing, for messages.
    part
        Number of the part, counted from 1, the largest.

    Raises
    ------
    ValueError
        When nothing is closed, there is no such part, or a hole's outline crosses itself.
    """
    closed = sorted((r for r in rings if len(r) >= 3), key=_enclosed, reverse=True)
    if not closed or _enclosed(closed[0]) == 0.0:
        raise ValueError(f"no closed outline in this {what}")
    outlines = closed[:1]
    for ring in closed[1:]:
        if _enclosed(ring) < _MIN_PART * _enclosed(closed[0]):
            break
        # What lies inside a part is a hole of that part.
        if not any(_is_inside(ring, other) or _is_about(ring, other) for other in outlines):
            outlines.append(ring)
    if not 1 <= part <= len(outlines):
        there = "is 1 part" if len(outlines) == 1 else f"are {len(outlines)} parts"
        raise ValueError(f"part {part}: there {there} in this {what}")
    outline, holes = outlines[part - 1], list[FloatArray]()
    for ring in closed:
        if _enclosed(ring) < _MIN_HOLE * _enclosed(outline):
            break
        if _is_about(ring, outline) or not _is_inside(ring, outline):
            continue
        if not any(_touches(ring, hole) for hole in holes):
            try:
                holes.append(as_polygon(ring))
            except ValueError as error:
                raise ValueError(f"hole {len(holes) + 1}: {error}") from error
    return PartRings(outline, tuple(holes), len(outlines) - 1)


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
    if ring is outline:
        return True
    if not _SAME < _enclosed(ring) / _enclosed(outline) < 1.0 / _SAME:
        return False
    size = np.ptp(outline, axis=0).max()
    low, high = ring.min(axis=0) - outline.min(axis=0), ring.max(axis=0) - outline.max(axis=0)
    return bool(max(np.abs(low).max(), np.abs(high).max()) <= (1.0 - _SAME) * size)


def _touches(ring: FloatArray, hole: FloatArray) -> bool:
    """Return whether a smaller ring lies in a hole or reaches into it."""
    return bool(np.any(_covers(hole, ring)))
