"""Directions on a grid, and moves that go sideways by chance."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

__all__ = ["EAST", "MOVES", "NORTH", "SHARES", "SIDES", "SOUTH", "WEST", "aside"]

NORTH, SOUTH, EAST, WEST = range(4)
MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1))
"""(rows, columns) a direction leads."""
SIDES = ((EAST, WEST), (EAST, WEST), (NORTH, SOUTH), (NORTH, SOUTH))
"""Left and right of a direction."""
SHARES = (0.8, 0.1, 0.1)
"""Of moves that go straight on, and to either side (Hester and Stone 2013)."""

# As in numpy.random.Generator.choice, so that a seed means the same moves, twenty times faster.
_BOUNDS = (np.cumsum(SHARES) / np.cumsum(SHARES)[-1]).tolist()
_TURNED = tuple((direction, *sides) for direction, sides in enumerate(SIDES))


def aside(direction: int, chance: float) -> int:
    """Return where a move in a direction really goes, for a number drawn from [0, 1).

    >>> [aside(NORTH, chance) for chance in (0.5, 0.85, 0.95)] == [NORTH, EAST, WEST]
    True
    """
    return _TURNED[direction][bisect_right(_BOUNDS, chance)]
