"""Hypotheses about the object's pixels: its segment, alone or with touching neighbours.

A segmenter that is not told what it looks at cuts a handle from its mug. The stored model says how
large the whole may be, and so which neighbours can be parts of it. It also takes two things that
lean on each other for one: then half of the segment may be the object.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["Hypothesis", "halves", "hypotheses", "parted", "spread"]

_DILATION_PX = 9
_GAP_M = 0.012
_MAX_NEIGHBOURS = 5
_LARGER = 1.1
_ENOUGH_POINTS = 600
_MAX_PARTED, _MIN_PARTED = 3, 30


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Segments that are one object.

    Parameters
    ----------
    labels
        The segment asked for first.
    mask : (h, w) bool
    is_part
        The mask is a part of the segment.
    """

    labels: tuple[int, ...]
    mask: NDArray[np.bool_]
    is_part: bool = False


def hypotheses(
    points: NDArray[np.float32],
    labels: NDArray[np.int32],
    label: int,
    diameter_m: float,
) -> list[Hypothesis]:
    """Return the segment alone, with each touching neighbour, and with all of them.

    Parameters
    ----------
    points : (h, w, 3) float32, m, camera
        NaN = missing.
    labels : (h, w) int32
        0 = no object.
    label
        The segment.
    diameter_m
        Of the model: what is larger together is not one object.
    """
    alone = labels == label
    guesses = [Hypothesis((label,), alone)]
    mine = _some(points[alone])
    joined = [
        other
        for other in _touching(points, labels, label, mine)
        if spread(np.vstack([mine, _some(points[labels == other])])) <= _LARGER * diameter_m
    ][:_MAX_NEIGHBOURS]
    guesses += [Hypothesis((label, other), alone | (labels == other)) for other in joined]
    if len(joined) > 1:
        together = np.isin(labels, [label, *joined])
        if spread(_some(points[together])) <= _LARGER * diameter_m:
            guesses.append(Hypothesis((label, *joined), together))
    return guesses


def parted(
    points: NDArray[np.float32],
    labels: NDArray[np.int32],
    label: int,
    diameter_m: float,
) -> list[Hypothesis]:
    """Return the segment with each other one that may be the same object beyond a gap.

    What stands in front, or an edge that the segmenter left open, parts the pixels of one object.
    Arguments are those of :func:`hypotheses`; segments that touch are left to it.
    """
    alone = labels == label
    mine = _some(points[alone])
    if len(mine) == 0:
        return []
    touching = _touching(points, labels, label, mine)
    middle, gaps = np.median(mine, axis=0), {}
    tree = cKDTree(mine)
    for other in np.unique(labels[labels > 0]).tolist():
        if other == label or other in touching:
            continue
        theirs = _some(points[labels == other])
        if (
            len(theirs) < _MIN_PARTED
            or np.abs(np.median(theirs, axis=0) - middle).max() > diameter_m
        ):
            continue
        if spread(np.vstack([mine, theirs])) <= diameter_m:
            gaps[other] = float(tree.query(theirs)[0].min())
    nearest = sorted(gaps, key=gaps.__getitem__)[:_MAX_PARTED]
    return [Hypothesis((label, other), alone | (labels == other)) for other in nearest]


def halves(points: NDArray[np.float32], labels: NDArray[np.int32], label: int) -> list[Hypothesis]:
    """Return the halves of the segment along and across its longest extent in space.

    Of two things that the segmenter took for one, a half shows mostly one. Arguments are those of
    :func:`hypotheses`.
    """
    alone = (labels == label) & np.isfinite(points).all(axis=-1)
    places = points[alone].astype(np.float64)
    if len(places) < 2 * _MIN_PARTED:
        return []
    middle = places.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(places.T))
    parts = []
    for axis in (2, 1):
        along = (places - middle) @ axes[:, axis]
        for side in (along > np.median(along), along < np.median(along)):
            mask = np.zeros(labels.shape, bool)
            mask[alone] = side
            parts.append(Hypothesis((label,), mask, is_part=True))
    return parts


def spread(points: NDArray[np.floating]) -> float:
    """Return the largest extent in m of points (n, 3) over many directions, outliers left out."""
    k = np.arange(60) + 0.5
    height, turn = 1 - k / 60, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - height**2)
    ways = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    low, high = np.percentile(points @ ways.T, [1, 99], axis=0)
    return float((high - low).max())


def _some(points: NDArray[np.float32]) -> NDArray[np.float32]:
    points = points[np.isfinite(points).all(axis=1)]
    return points[:: max(len(points) // _ENOUGH_POINTS, 1)]


def _touching(
    points: NDArray[np.float32], labels: NDArray[np.int32], label: int, mine: NDArray[np.float32]
) -> list[int]:
    """Return the segments beside this one without a gap in space, nearest first."""
    rows, columns = np.nonzero(labels == label)
    top, left = max(rows.min() - _DILATION_PX, 0), max(columns.min() - _DILATION_PX, 0)
    box = (
        slice(top, rows.max() + _DILATION_PX + 1),
        slice(left, columns.max() + _DILATION_PX + 1),
    )
    mask = (labels[box] == label).astype(np.uint8)
    grown = cv2.dilate(mask, np.ones((_DILATION_PX, _DILATION_PX), np.uint8)).astype(bool)
    beside = grown & (labels[box] > 0) & (labels[box] != label)
    numbers = labels[box][beside]
    places = points[box][beside]
    finite = np.isfinite(places).all(axis=1)
    if not finite.any() or len(mine) == 0:
        return []
    edge = points[box][mask.astype(bool)]
    gaps, _ = cKDTree(edge[np.isfinite(edge).all(axis=1)]).query(places[finite])
    nearest: dict[int, float] = {}
    for number, gap in zip(numbers[finite].tolist(), gaps.tolist(), strict=True):
        nearest[number] = min(gap, nearest.get(number, np.inf))
    return sorted((n for n, gap in nearest.items() if gap <= _GAP_M), key=nearest.__getitem__)
