"""Forces of three fingers with one drive: whether they balance, and what is left for loads.

In the plane across the hand's axis each finger pushes within its friction cone. A coupled drive
does not say how its force is shared: whatever balances on the object can be, so that two fingers
may do all the work on a bar while the third only leans on it. All balanced shares of a given drive
form a polytope; the mean of its corners stands for what the contacts settle on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand

__all__ = ["Grip", "asked_of_fingers", "gripped"]

_LENGTH_M = 0.03
_SINGULAR, _NEGATIVE = 1e-7, -1e-9
_TOO_SMALL, _MOST = 1e-9, 1e6


@dataclass(frozen=True, eq=False)
class Grip:
    """Balanced forces of closed fingers, in the gripper frame; n hands of three fingers.

    Parameters
    ----------
    holds : (n,) bool
        Whether any forces within the friction cones balance; where not, the others are 0.
    places : (n, 3, 2), m
        Of the contacts, from the axis.
    normals : (n, 3, 2)
        Out of the object, their part across the axis, unit length.
    push, aside : (n, 3), N
        Force of each finger across the axis: against the normal, and by friction along the normal
        turned by 90 degrees about the axis.
    spare : (n, 3), N
        Friction that is left along the axis.
    """

    holds: NDArray[np.bool_]
    places: FloatArray
    normals: FloatArray
    push: FloatArray
    aside: FloatArray
    spare: FloatArray

    @property
    def middle(self) -> FloatArray:
        """Middle (n, 3) of the contacts, those that push harder counting more, m."""
        total = np.maximum(self.push.sum(axis=1), _TOO_SMALL)
        place = np.einsum("nk,nki->ni", self.push, self.places) / total[:, None]
        return np.column_stack([place, np.zeros(len(place))])


def gripped(
    hand: ThreeFingerHand,
    places: FloatArray,
    normals: FloatArray,
    touching: NDArray[np.bool_],
    friction: float | None = None,
) -> Grip:
    """Return what fingers with the hand's whole force do to what they touch.

    Parameters
    ----------
    places : (n, 3, 2), m
        Of the contacts in the gripper frame, across the axis.
    normals : (n, 3, 3)
        There, out of the object, unit length. One that leans along the axis must be kept from
        sliding along it, which uses friction up.
    touching : (n, 3) bool
    friction
        Coulomb coefficient; None = the hand's.

    Examples
    --------
    Two fingers hold a bar, though none of them pushes along its normals, and so does any friction
    above that of the line between them:

    >>> hand = ThreeFingerHand("centric", 0.1)
    >>> bar = 0.03 * WAYS[None, :, :2]
    >>> sides = np.array([[[1.0, 0, 0], [0, 1, 0], [0, -1, 0]]])
    >>> both = gripped(hand, bar, sides, np.array([[False, True, True]]))
    >>> both.holds, both.push.round(1)
    (array([ True]), array([[ 0. , 34.6, 34.6]]))
    """
    level = normals[:, :, :2]
    cosine = np.linalg.norm(level, axis=2)
    level = level / np.maximum(cosine, _TOO_SMALL)[:, :, None]
    steep = np.abs(normals[:, :, 2]) / np.maximum(cosine, _TOO_SMALL)
    mu = hand.friction if friction is None else friction
    left = mu**2 - steep**2
    usable = touching & (left > 0)
    # A horizontal force with the push p across the axis presses with p cos e on a face that leans
    # by e, of whose friction the part against sliding along the face is taken.
    slip = cosine * np.sqrt(np.maximum(left, 0.0))
    holds, push, aside = _balanced(
        np.ascontiguousarray(places) / _LENGTH_M, np.ascontiguousarray(level), slip, usable,
        np.ascontiguousarray(WAYS[:, :2]),
    )  # fmt: skip
    push, aside = 3 * hand.max_force * push, 3 * hand.max_force * aside
    spare = np.sqrt(np.maximum((slip * push) ** 2 - aside**2, 0.0))
    return Grip(holds, np.asarray(places), level, push, aside, spare)


def asked_of_fingers(
    hand: ThreeFingerHand, grip: Grip, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Return what loads ask of a closed hand, as a share of what it bears: it holds below 1, (n,).

    Along the axis and about it friction bears the load; across the axis a finger must not be pushed
    open; about a line across it friction acts up on one side and down on the other, and along the
    height of each pad. The shares are combined as those of soft contacts (Howe and Cutkosky 1996).

    Parameters
    ----------
    force, moment : (n, 3), N and N m
        On the object in the gripper frame, about :attr:`Grip.middle`.
    """
    middle = grip.middle[:, None, :2]
    arms = grip.places - middle
    reach = np.linalg.norm(arms, axis=2)
    free = np.sqrt(grip.spare**2 + grip.aside**2) - np.abs(grip.aside)
    across = np.hypot(moment[:, 0], moment[:, 1])
    line = moment[:, :2] / np.maximum(across, _TOO_SMALL)[:, None]
    # By how much a force up at each contact turns the object about the line of the moment.
    turning = arms[:, :, 1] * line[:, None, 0] - arms[:, :, 0] * line[:, None, 1]
    # Friction up must equal friction down: the most it turns is least about some contact (duality).
    shifted = np.abs(turning[:, :, None] - turning[:, None, :])
    tipping = np.einsum("nj,njk->nk", grip.spare, shifted).min(axis=1)
    beside = np.abs(np.einsum("nki,ni->nk", grip.normals, line))
    ahead = np.sqrt(np.maximum(1 - beside**2, 0.0))
    height = hand.fingertip / 2
    tipping += height * (grip.spare * beside + grip.push * ahead).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (
            force[:, 2] / grip.spare.sum(axis=1),
            2 * np.hypot(force[:, 0], force[:, 1]) / grip.push.sum(axis=1),
            moment[:, 2] / (free * reach).sum(axis=1),
            across / tipping,
        )
        asked = np.sqrt(
            sum(np.nan_to_num(share, nan=0.0, posinf=_MOST, neginf=_MOST) ** 2 for share in shares)
        )
    return np.asarray(np.where(grip.holds, asked, np.inf))


@njit(cache=True, nogil=True)
def _balanced(
    places: FloatArray,
    normals: FloatArray,
    friction: FloatArray,
    usable: NDArray[np.bool_],
    ways: FloatArray,
) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Return whether forces balance (n,), and their normal and tangential parts (n, 3) per drive.

    A force in a plane cone is a sum of its two edges with weights of at least 0: six columns, and
    four equations (two forces, a moment, the drive is 1). Each corner of their solutions has four
    weights that may differ from 0.
    """
    count = len(places)
    holds = np.zeros(count, np.bool_)
    push, aside = np.zeros((count, 3)), np.zeros((count, 3))
    columns, rows = np.empty((6, 4)), np.empty((4, 5))
    chosen, total = np.empty(4, np.int64), np.empty(6)
    for n in range(count):
        for k in range(3):
            x, y = normals[n, k]
            for side in range(2):
                slip = friction[n, k] if side == 0 else -friction[n, k]
                fx, fy = -x - slip * y, -y + slip * x
                column = columns[2 * k + side]
                column[0], column[1] = fx, fy
                column[2] = places[n, k, 0] * fy - places[n, k, 1] * fx
                column[3] = -fx * ways[k, 0] - fy * ways[k, 1]
        total[:] = 0.0
        corners = 0
        for first in range(5):
            for second in range(first + 1, 6):
                # Every column but these two.
                used = 0
                able = True
                for column_index in range(6):
                    if column_index != first and column_index != second:
                        chosen[used] = column_index
                        able = able and usable[n, column_index // 2]
                        used += 1
                if not able or not _solved(columns, chosen, rows):
                    continue
                if rows[:, 4].min() < _NEGATIVE:
                    continue
                corners += 1
                for i in range(4):
                    total[chosen[i]] += rows[i, 4]
        if corners:
            holds[n] = True
            for k in range(3):
                push[n, k] = (total[2 * k] + total[2 * k + 1]) / corners
                aside[n, k] = friction[n, k] * (total[2 * k] - total[2 * k + 1]) / corners
    return holds, push, aside


@njit(cache=True, nogil=True)
def _solved(columns: FloatArray, chosen: NDArray[np.int64], rows: FloatArray) -> bool:
    """Solve for the weights of four columns, into the last of ``rows`` (4, 5); tell if possible."""
    for i in range(4):
        for j in range(4):
            rows[i, j] = columns[chosen[j], i]
        rows[i, 4] = 0.0
    rows[3, 4] = 1.0
    for i in range(4):
        best = i
        for j in range(i + 1, 4):
            if abs(rows[j, i]) > abs(rows[best, i]):
                best = j
        if abs(rows[best, i]) < _SINGULAR:
            return False
        if best != i:
            for j in range(5):
                rows[i, j], rows[best, j] = rows[best, j], rows[i, j]
        scale = rows[i, i]
        for j in range(i, 5):
            rows[i, j] /= scale
        for other in range(4):
            if other != i:
                factor = rows[other, i]
                for j in range(i, 5):
                    rows[other, j] -= factor * rows[i, j]
    return True
