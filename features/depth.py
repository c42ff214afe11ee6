"""Depth images from the numbers that cameras write: what was measured, and how far away.

A camera has to write something where it measured nothing, and no format says what. 0, what is not
finite and the end of the type are known; others write the end of fewer bits, or of their range.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, finite_depth

__all__ = ["depth_of_metres", "depth_of_steps"]

_MARKS = (4_095, 8_191, 10_000, 16_383, 32_767, 32_768, 65_534)
"""Numbers that stand for "not measured": ends of 12 to 16 bits, and a round far end of a range."""
_MIN_SHARE = 0.005
"""Of an image, that a mark holds: less may be a surface that the camera saw."""
_GAP, _MAX_NEAR = 0.2, 0.01
"""Within such a share of a mark's number, on either side, lie at most so many pixels for each of
its own: surfaces have neighbours, and noise spreads them over many numbers."""
_BEYOND_M = 8.0
"""Depth from which on any one number that stands alone is the end of a range, and no surface."""
_TOO_NEAR_M = 0.03
"""No depth camera measures so near: a number there that stands alone is a code."""
_NO_DEPTH_M = 1e5
"""More than that is the largest float or a figure for infinity, in metres and in millimetres."""
_MOST_MARKS = 3
_MOSTLY = 0.5
"""Share of an image that is below zero for which a turned sign is likelier than a code."""


def depth_of_steps(
    steps: NDArray[Any], step_m: float = 0.001, say: Callable[[str], None] | None = None
) -> NDArray[np.float32]:
    """Return a depth image (h, w), m, of whole numbers of steps, such as millimetres (REP 118).

    Missing (0) are 0, negative ones and the largest of 16 bits; a number at which ranges end, where
    much of the image has it and nothing lies near it; and any number beyond 8 m or within 3 cm that
    stands alone like that.

    Parameters
    ----------
    say
        Called with a sentence for each such number that only its frequency gives away.

    Examples
    --------
    >>> depth_of_steps(np.array([[0, 700, 65_535]], np.uint16)).round(3).tolist()
    [[0.0, 0.699999988079071, 0.0]]
    >>> depth_of_steps(np.array([[700, 710, 10_000]], np.uint16), say=print).round(2).tolist()
    33% of the depth is exactly 10 m, and nothing lies near it: taken for not measured
    [[0.699999988079071, 0.7099999785423279, 0.0]]
    """
    _say_negative(say, steps)
    is_measured = (steps > 0) & (steps < np.iinfo(np.uint16).max)
    if is_measured.any():
        for mark in _standing_alone(np.bincount(steps[is_measured].ravel()), steps.size):
            is_far_or_near = mark * step_m >= _BEYOND_M or mark * step_m <= _TOO_NEAR_M
            if mark in _MARKS or is_far_or_near:
                is_mark = steps == mark
                is_measured &= ~is_mark
                _say_taken(say, float(is_mark.mean()), mark * step_m)
    return np.where(is_measured, steps * step_m, 0).astype(np.float32)


def depth_of_metres(
    depth_m: FloatArray, say: Callable[[str], None] | None = None
) -> NDArray[np.float32]:
    """Return a depth image (h, w), m, with 0 where nothing was measured.

    That is what :func:`features.geometry.finite_depth` leaves out, the largest floats, and a number
    beyond 8 m or within 3 cm that much of the image has, and near which nothing lies.

    Parameters
    ----------
    say
        As of :func:`depth_of_steps`.

    Examples
    --------
    >>> depth_of_metres(np.array([[0.7, 3.4e38, -1.0]])).round(1).tolist()
    [[0.699999988079071, 0.0, 0.0]]
    """
    _say_negative(say, depth_m)
    depth = finite_depth(depth_m)
    depth[depth >= _NO_DEPTH_M] = 0
    for _ in range(_MOST_MARKS):
        # Only the ends of the range are looked at: to sort all numbers of each image takes long.
        farthest = float(depth.max(initial=0))
        nearest = float(depth.min(initial=np.inf, where=depth > 0))
        marks = [nearest] * (nearest <= _TOO_NEAR_M) + [farthest] * (farthest >= _BEYOND_M)
        alone = [mark for mark in marks if _stands_alone(depth, mark)]
        if not alone:
            break
        is_mark = depth == alone[0]
        depth[is_mark] = 0
        _say_taken(say, float(is_mark.mean()), alone[0])
    return depth


def _stands_alone(depth_m: NDArray[np.float32], mark_m: float) -> bool:
    """Whether much of a depth image, and not all, is one number near which nothing lies."""
    own = int(np.count_nonzero(depth_m == mark_m))
    if own < _MIN_SHARE * depth_m.size or own == np.count_nonzero(depth_m):
        return False
    is_near = (depth_m > (1 - _GAP) * mark_m) & (depth_m < (1 + _GAP) * mark_m)
    return int(np.count_nonzero(is_near)) - own <= _MAX_NEAR * own


def _standing_alone(counts: NDArray[np.intp], pixels: int) -> list[int]:
    """Return the numbers that much of an image has, and that nothing else measured lies near.

    An image of one number alone shows that number: there is nothing beside which it stands out.
    """
    upto = np.concatenate(([0], np.cumsum(counts)))
    marks = []
    for number in np.flatnonzero(counts >= _MIN_SHARE * pixels).tolist():
        own = counts[number]
        low = int((1 - _GAP) * number)
        high = min(int((1 + _GAP) * number) + 1, len(counts))
        if own < upto[-1] and upto[high] - upto[low] - own <= _MAX_NEAR * own:
            marks.append(number)
    return marks


def _say_negative(say: Callable[[str], None] | None, numbers: NDArray[Any]) -> None:
    """Say that most numbers lie below zero, differently far: z backward, as drawings have it."""
    if say is None or numbers.dtype.kind == "u":
        return
    is_negative = numbers < 0
    share = float(is_negative.mean()) if numbers.size else 0.0
    below = numbers[is_negative]
    if share > _MOSTLY and (below != below[0]).any():  # one number may be a code
        say(f"{share:.0%} of the numbers lie below zero: taken for not measured; is z backward?")


def _say_taken(say: Callable[[str], None] | None, share: float, depth_m: float) -> None:
    if say is not None:
        say(
            f"{share:.0%} of the depth is exactly {depth_m:.4g} m, and nothing lies near it: taken "
            "for not measured"
        )
