"""Paths out of movements that robots recorded: of the same body, or of a mirrored arm.

What the graph offers (``recall_motions``) is in the joints of the asking body already; here it
becomes a guess for :mod:`simulate.motion.remembered`, which checks it in the present surroundings.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simulate.motion.kinematics import Chain
from simulate.motion.remembered import RememberedPath
from simulate.robots.description import Floats

__all__ = ["corners_of", "following_joints", "mirror_signs", "path_of", "way_before_closing"]

_CORNER_RAD = 0.02
"""Deviation of a joint from the recording that is left out between two corners."""
_CLOSING = 0.02
"""The hand closes once its opening has gone down by more than this share."""
_MIRRORED_M, _MIRRORED_POSTURES = 0.001, 12


def following_joints(
    chain: Chain, recorded: Sequence[str] | None = None, scales: Sequence[float] | None = None
) -> list[dict[str, Any]]:
    """Return the joints of an arm as ``recall_motions`` takes them, with their limits.

    Parameters
    ----------
    recorded
        Names of the recorded joints whose place they take; None = their own.
    scales
        Factors for the recorded values; None = 1.
    """
    names = chain.names if recorded is None else recorded
    factors = [1.0] * chain.dof if scales is None else scales
    return [
        {"name": name, "recorded": there, "scale": float(scale), "lower": float(low),
         "upper": float(high)}
        for name, there, scale, low, high in zip(
            chain.names, names, factors, chain.lower, chain.upper, strict=True
        )
    ]  # fmt: skip


def mirror_signs(arm: Chain, other: Chain) -> tuple[float, ...] | None:
    """Return the factor by which each joint of an arm makes the mirrored movement of another one.

    Returns
    -------
    1 or -1 for each joint, so that the hand of ``other`` is the image of that of ``arm`` in the
    plane y = 0; None if the arms are not mirror images of each other.
    """
    if arm.dof != other.dof:
        return None
    fractions = np.random.default_rng(0).random((_MIRRORED_POSTURES, arm.dof))
    postures = arm.lower + fractions * (arm.upper - arm.lower)
    _, there = arm.tool_poses(postures)
    image = there * np.array([1.0, -1.0, 1.0])
    for signs in itertools.product((1.0, -1.0), repeat=arm.dof):
        _, here = other.tool_poses(postures * np.array(signs))
        if np.abs(here - image).max() < _MIRRORED_M:
            return signs
    return None


def way_before_closing(motion: Mapping[str, Any], arm: Sequence[str], hand: str) -> Floats:
    """Return the postures of an arm until its hand begins to close.

    Parameters
    ----------
    motion
        Of the answer to ``recall_motions``.
    arm
        Names of its joints.
    hand
        Name under which the movement has the opening of the hand; without it all of it is the way.

    Returns
    -------
    (k, dof) float, rad; k = 0 if the movement has other joints.
    """
    joints = list(motion["joints"])
    if not set(arm) <= set(joints) or not motion["positions"]:
        return np.zeros((0, len(arm)))
    rows = np.reshape(np.asarray(motion["positions"], dtype=np.float64), (-1, len(joints)))
    end = len(rows)
    if hand in joints:
        opening = rows[:, joints.index(hand)]
        closing = np.flatnonzero(opening < np.maximum.accumulate(opening) - _CLOSING)
        end = int(closing[0]) if len(closing) else end
    return rows[:end, [joints.index(name) for name in arm]]


def corners_of(postures: Floats, tolerance: float = _CORNER_RAD) -> Floats:
    """Return the corners of a recorded way: straight edges that no sample leaves by more.

    Ramer-Douglas-Peucker in joint space, with the largest difference of a joint as the distance.

    Parameters
    ----------
    postures : (k, dof) float, rad
    tolerance
        rad.

    Returns
    -------
    (c, dof) float, rad
        With the first and the last posture.
    """
    if len(postures) < 3:
        return postures
    keep, waiting = {0, len(postures) - 1}, [(0, len(postures) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        edge = postures[last] - postures[first]
        length = max(float(edge @ edge), 1e-12)
        inner = postures[first + 1 : last] - postures[first]
        along = np.clip(inner @ edge / length, 0.0, 1.0)
        off = np.abs(inner - along[:, None] * edge).max(axis=1)
        if off.max() > tolerance:
            middle = first + 1 + int(off.argmax())
            keep.add(middle)
            waiting += [(first, middle), (middle, last)]
    return postures[sorted(keep)]


def path_of(motion: Mapping[str, Any], arm: Sequence[str], hand: str) -> RememberedPath | None:
    """Return a recalled movement as a path to remember; None if it was straight, or of others."""
    corners = corners_of(way_before_closing(motion, arm, hand))
    return RememberedPath(corners, str(motion["attempt"])) if len(corners) >= 3 else None
