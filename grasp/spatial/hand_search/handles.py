"""Handles: where many grasps lie in a row (ten Pas and Platt 2015, 4.3).

One grasp may be an accident of noise. Several whose axes and approaches agree, one behind the
other along their axis, say that there is something long to hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate

__all__ = ["Handle", "find_handles"]


@dataclass(frozen=True)
class Handle:
    """Grasps in a row.

    Parameters
    ----------
    grasp
        The member nearest to the middle.
    members
        Numbers of all, along the axis.
    axis : (3,)
        Unit vector along which they lie.
    length
        From the first to the last, m.
    """

    grasp: GraspCandidate
    members: tuple[int, ...]
    axis: FloatArray
    length: float


def find_handles(
    candidates: Sequence[GraspCandidate],
    *,
    least: int = 10,
    length: float = 0.005,
    angle: float = 0.34,
    distance: float = 0.01,
    gap: float = 0.02,
) -> list[Handle]:
    """Gather candidates into handles, those with most members first.

    Parameters
    ----------
    candidates
        In one frame; the axis of each is its gripper's y.
    least, length
        Members and length (m) that a handle has at the least.
    angle
        By which axes, of either sign, and approaches may differ, rad.
    distance
        Of a member from the axis of the first, m.
    gap
        Between neighbours along the axis at which a row ends, m.

    Returns
    -------
    No candidate belongs to two handles.
    """
    if not candidates:
        return []
    poses = np.stack([c.frame_from_gripper for c in candidates])
    centres, axes, approaches = poses[:, :3, 3], poses[:, :3, 1], poses[:, :3, 2]
    alike = (np.abs(axes @ axes.T) > np.cos(angle)) & (approaches @ approaches.T > np.cos(angle))
    free = np.ones(len(candidates), bool)
    handles: list[Handle] = []
    while True:
        best: NDArray[np.int64] = np.empty(0, np.int64)
        for i in np.flatnonzero(free):
            row = _row(centres, axes[i], int(i), np.flatnonzero(free & alike[i]), distance, gap)
            if len(row) > len(best) and _extent(centres, axes[i], row) >= length:
                best, first = row, i
        if len(best) < least:
            return handles
        free[best] = False
        along = centres[best] @ axes[first]
        middle = best[int(np.argmin(np.abs(along - (along.min() + along.max()) / 2)))]
        handles.append(
            Handle(
                candidates[int(middle)],
                tuple(int(k) for k in best),
                axes[first],
                float(np.ptp(along)),
            )
        )


def _row(
    centres: FloatArray,
    axis: FloatArray,
    i: int,
    among: NDArray[np.int64],
    distance: float,
    gap: float,
) -> NDArray[np.int64]:
    """Return those of ``among`` near the axis line of candidate ``i`` without a gap to it."""
    offset = centres[among] - centres[i]
    along = offset @ axis
    near = np.linalg.norm(offset - along[:, None] * axis, axis=1) < distance
    among, along = among[near], along[near]
    order = np.argsort(along, kind="stable")
    among, along = among[order], along[order]
    piece = np.concatenate([[0], np.cumsum(np.diff(along) > gap)])
    return np.asarray(among[piece == piece[np.flatnonzero(among == i)[0]]])


def _extent(centres: FloatArray, axis: FloatArray, row: NDArray[np.int64]) -> float:
    return float(np.ptp(centres[row] @ axis)) if len(row) else 0.0
