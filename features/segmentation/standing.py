"""Parts that stand wholly on something larger: necks, caps and knobs.

The valley around a bottle's neck is as sharp as that between two objects; what tells them apart is
that a neck floats over the table and its foot lies within the body's. A small object put on top of
a large one looks the same and is joined too.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["join_standing_parts"]

_FLOATS_M = 0.020
_LOW_PERCENTILE, _HIGH_PERCENTILE = 3.0, 97.0
_CONTACT_M = 0.010
_REACH_M = 0.003
_INSIDE_SHARE = 0.85
_LARGEST_SHARE = 0.6


@dataclass(frozen=True)
class _Part:
    """Feet (n, 2) float32 in mm on the plane, their hull, lowest and highest point (m)."""

    feet: NDArray[np.float32]
    hull: NDArray[np.float32]
    low: float
    high: float

    @property
    def area(self) -> float:
        return float(cv2.contourArea(self.hull))


def join_standing_parts(
    feet: NDArray[np.float64], heights: NDArray[np.float64], labels: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Give each floating part the label of what it stands on.

    Parameters
    ----------
    feet : (n, 2) float, m
        Where each labelled point stands on the plane.
    heights : (n,) float, m
        Over the plane.
    labels : (n,) int32
        From 1.

    Returns
    -------
    (n,) int32
        Labels of which some no longer occur.
    """
    parts = {}
    for label in np.unique(labels).tolist():
        mine = labels == label
        flat = np.ascontiguousarray(1e3 * feet[mine], dtype=np.float32)
        low, high = np.percentile(heights[mine], [_LOW_PERCENTILE, _HIGH_PERCENTILE])
        parts[label] = _Part(
            flat, np.asarray(cv2.convexHull(flat), np.float32), float(low), float(high)
        )
    out = labels.copy()
    # Smallest first: a cap joins its neck before the neck joins the body.
    for label in sorted(parts, key=lambda name: (parts[name].area, name)):
        part = parts[label]
        if part.low < _FLOATS_M:
            continue
        for other in sorted(parts, key=lambda name: (parts[name].area, name)):
            if other != label and _stands_on(part, parts[other]):
                out[out == label] = other
                break
    return out


def _stands_on(part: _Part, base: _Part) -> bool:
    if part.area > _LARGEST_SHARE * base.area or not (
        base.low < part.low < base.high + _CONTACT_M < part.high + _CONTACT_M
    ):
        return False
    step = max(1, len(part.feet) // 200)
    distances = [
        cv2.pointPolygonTest(base.hull, (float(x), float(y)), True) for x, y in part.feet[::step]
    ]
    return bool(np.mean(np.array(distances) > -1e3 * _REACH_M) >= _INSIDE_SHARE)
