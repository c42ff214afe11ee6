"""Room for the fingers between the things that stand around (Gatto 2016, 3.3.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.gripper import ParallelGripper

__all__ = ["FREE", "finger_clearance"]

FREE = 0.05
"""Clearance that is reported when nothing is near, m: more than any finger needs."""

_TIP_SLACK = 0.004


def finger_clearance(
    centre: NDArray[np.float64],
    theta: float,
    opening: float,
    tip_height: float,
    gripper: ParallelGripper,
    neighbours: NDArray[np.float64] | None,
) -> float:
    """Return the distance from the opened fingers to the nearest neighbour, m.

    Each finger is a post of square section that stands on its tip outside the opening. Both are
    checked at the opening from which they close; on the way they only move inwards.

    Parameters
    ----------
    centre : (2,), m
        Midway between the jaws.
    theta
        Closing direction, rad.
    opening
        Distance between the jaws before closing, m.
    tip_height
        Of the fingertips over the support, m; what lies lower passes under them.
    neighbours : (m, 3) or None, m
        Points of other objects: x, y in the frame of ``centre``, z over the support.

    Returns
    -------
    0 when a finger would stand in a neighbour; at most :data:`FREE`.
    """
    if neighbours is None or len(neighbours) == 0:
        return FREE
    high = neighbours[neighbours[:, 2] > tip_height - _TIP_SLACK]
    if len(high) == 0:
        return FREE
    closing = np.array([np.cos(theta), np.sin(theta)])
    across = np.array([-closing[1], closing[0]])
    local = (high[:, :2] - centre) @ np.stack([closing, across], axis=1)
    half = gripper.finger_width / 2
    out_x = np.abs(np.abs(local[:, 0]) - (opening / 2 + half)) - half
    out_y = np.abs(local[:, 1]) - half
    distance = np.hypot(np.maximum(out_x, 0.0), np.maximum(out_y, 0.0))
    return float(min(distance.min(), FREE))
