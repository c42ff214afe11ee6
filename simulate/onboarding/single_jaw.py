"""Hands with a single moving jaw: the other one is part of the link that carries it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulate.motion.collision import link_poses
from simulate.onboarding.closing import link_cloud, points_of
from simulate.robots.description import Floats, Joint, RobotDescription

__all__ = ["SingleJaw", "single_jaw"]

_MIN_STROKE_M = 0.008
_WIDEST_RAD = 0.8
"""Turn of a jaw from closed that counts as open; beyond it, its face looks away."""
_OFF_AXIS_M = 0.012
"""Distance of a jaw's middle from its axis below which it turns in place, as a wrist does."""
_ALONG, _MAX_ALONG = 0.4, 1.6
"""Shares of the jaw's length between which the fixed jaw lies beyond the hinge."""
_BESIDE_M = 0.04
"""Farthest that a point of the fixed jaw lies from the jaw's middle along the axis of the hinge."""
_CLOSE = 0.5
"""Largest share of its length that the jaw's tip is away from the fixed one when closed."""
_FEWEST = 3


@dataclass(frozen=True)
class SingleJaw:
    """A jaw that closes on one which stands still.

    Parameters
    ----------
    joint
        That moves it.
    closed, opened
        Values of the joint, rad or m.
    approach, closing
        Unit axes (3,) in the wrist frame; closing points from the fixed jaw to the other.
    fixed : (n, 3)
        Points of the fixed jaw, m, wrist frame.
    """

    joint: Joint
    closed: float
    opened: float
    approach: Floats
    closing: Floats
    fixed: Floats


def single_jaw(robot: RobotDescription, wrist: str, joint: Joint) -> SingleJaw | None:
    """Return the jaw that a joint moves against its parent link, or None if it moves none.

    Parameters
    ----------
    robot
        Without fixed joints.
    wrist
        Link that carries the jaw, and of which the fixed jaw is part.
    joint
        A joint on it.
    """
    palm, jaw = link_cloud(robot, wrist), link_cloud(robot, joint.child)
    if not (len(palm) and len(jaw)) or joint.parent != wrist:
        return None
    measure = _sliding if joint.kind == "prismatic" else _turning
    return measure(robot, wrist, joint, palm)


def _turning(robot: RobotDescription, wrist: str, joint: Joint, palm: Floats) -> SingleJaw | None:
    hinge = joint.pose.matrix
    axis = hinge[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
    arms = palm - hinge[:3, 3]
    best: tuple[float, SingleJaw] | None = None
    for closed, other in ((joint.lower, joint.upper), (joint.upper, joint.lower)):
        opened = closed + float(np.clip(other - closed, -_WIDEST_RAD, _WIDEST_RAD))
        here = _jaw(robot, wrist, joint, closed) - hinge[:3, 3]
        there = _jaw(robot, wrist, joint, opened) - hinge[:3, 3]
        out = _middle(here)
        out = out - (out @ axis) * axis
        if np.linalg.norm(out) < _OFF_AXIS_M:
            continue
        approach = out / np.linalg.norm(out)
        if approach @ hinge[:3, 3] < -_OFF_AXIS_M:  # it folds back onto the arm
            continue
        closing = np.cross(axis, approach)
        closing = closing * np.sign((_middle(there) - _middle(here)) @ closing)
        length = float((here @ approach).max())
        ahead, beside = arms @ approach, np.abs((arms - out) @ axis)
        is_fixed = (ahead >= _ALONG * length) & (ahead <= _MAX_ALONG * length)
        fixed = arms[is_fixed & (beside <= _BESIDE_M)]
        if len(fixed) < _FEWEST:
            continue
        tip = here[here @ approach >= _ALONG * length]
        gap = float(np.median(tip @ closing) - np.median(fixed @ closing))
        if gap < -_CLOSE * length or gap > _CLOSE * length:
            continue
        made = SingleJaw(joint, closed, opened, approach, closing, fixed + hinge[:3, 3])
        if best is None or abs(gap) < best[0]:
            best = (abs(gap), made)
    return best[1] if best is not None else None


def _sliding(robot: RobotDescription, wrist: str, joint: Joint, palm: Floats) -> SingleJaw | None:
    if joint.upper - joint.lower < _MIN_STROKE_M:
        return None
    axis = joint.pose.matrix[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
    middle = _jaw(robot, wrist, joint, (joint.lower + joint.upper) / 2)
    out = _middle(middle) - _middle(palm)
    out = out - (out @ axis) * axis
    if np.linalg.norm(out) < 1e-3:
        return None
    approach = out / np.linalg.norm(out)
    across = np.cross(approach, axis)
    reach = float((middle @ approach).max())
    start = float((middle @ approach).min())
    level = float(np.median(middle @ across))
    is_level = (palm @ approach >= start + _ALONG * (reach - start)) & (
        np.abs(palm @ across - level) <= _BESIDE_M
    )
    fixed = palm[is_level]
    if len(fixed) < _FEWEST:
        return None
    away = np.sign(_middle(middle) @ axis - float(np.median(fixed @ axis)))
    if not away:
        return None
    closed, opened = (joint.lower, joint.upper) if away > 0 else (joint.upper, joint.lower)
    return SingleJaw(joint, closed, opened, approach, away * axis, fixed)


def _middle(points: Floats) -> Floats:
    """Return the middle (3,) of the extents of points (n, 3).

    Their mean would lie where a mesh is fine: a jaw of a few large triangles with the motor that
    turns it in its link seemed to turn in place.
    """
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def _jaw(robot: RobotDescription, wrist: str, joint: Joint, value: float) -> Floats:
    """Return the points (n, 3) m of the jaw at a joint value, wrist frame."""
    pose = link_poses(wrist, [joint], {joint.name: value})[joint.child]
    return points_of(robot, joint.child, pose)
