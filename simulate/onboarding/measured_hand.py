"""Sizes and axes of a hand, measured on the shapes of its jaws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from simulate.motion.collision import link_poses
from simulate.onboarding.closing import Closing, points_of
from simulate.onboarding.single_jaw import SingleJaw
from simulate.robots.description import Floats, Joint, RobotDescription, Vector

__all__ = ["TIP_M", "MeasuredHand", "measured_jaw", "measured_pair"]

TIP_M = 0.015
"""Length of a finger that counts as its tip."""
_TOOL_ABOVE_TIP_M = 0.009
_MIN_STROKE_M = 0.008
_ALIGNED = 0.94
"""Cosine of the angle below which a direction is taken to be the wrist's axis."""
_JAW_ALIGNED = 0.97
_SAME, _NEAR_FRAME, _SQUARE, _AGREEING = 0.9986, 0.82, 0.9, 0.996
"""Cosines: an axis of the fingers' frames is the wrist's; or may be so far from the way to the
tips, from square to the closing axis, and from that of the other finger."""


@dataclass(frozen=True)
class MeasuredHand:
    """A hand: its wrist link, its arm's joints and its fingers.

    Parameters
    ----------
    wrist
        Link that carries the fingers.
    joints
        Arm joints from the root to the wrist; fewer than three for a gripper without an arm.
    fingers
        Finger joints that close and open it, parents before children.
    closed, opened
        Value of each finger joint, rad or m.
    tcp, approach, closing
        Tool centre point (m) and unit axes in the wrist frame.
    stroke
        Opening between the tips when the hand is open, m.
    width, length
        Of a finger: across, and free length beyond the palm, m.
    lever
        Distance (m) of the tool centre point from the farthest joint that turns a finger; 0 if the
        fingers slide.
    closed_gap
        What is left between the tips when the hand is closed, m; negative if their shapes overlap.
    is_single
        Whether one jaw moves, and the other is part of the wrist link.
    is_triple
        Whether the jaws are two of three equal fingers that close about an axis.
    rest
        Joints of the fingers that are not used, and the values (rad, m) at which they are out of
        the way.
    """

    wrist: str
    joints: tuple[Joint, ...]
    fingers: tuple[Joint, ...]
    closed: tuple[float, ...]
    opened: tuple[float, ...]
    tcp: Vector
    approach: Vector
    closing: Vector
    stroke: float
    width: float
    length: float
    lever: float
    closed_gap: float = 0.0
    is_single: bool = False
    is_triple: bool = False
    rest: Mapping[str, float] = field(default_factory=dict)

    def with_rest(self, rest: Mapping[str, float]) -> MeasuredHand:
        """Return the hand with the joints that it does not use."""
        return replace(self, rest=dict(rest))


def measured_pair(robot: RobotDescription, wrist: str, closing: Closing) -> MeasuredHand | None:
    """Return the hand of two fingertips that close; None if they leave no opening between them."""
    fingers, closed, opened = closing.joints, closing.closed, closing.opened
    near = [points_of(robot, tip, link_poses(wrist, fingers, closed)[tip]) for tip in closing.tips]
    wide = [points_of(robot, tip, link_poses(wrist, fingers, opened)[tip]) for tip in closing.tips]
    apart = wide[1].mean(axis=0) - wide[0].mean(axis=0)
    axis = _as_meant(wrist, fingers, apart / np.linalg.norm(apart))
    approach = _approach(robot, wrist, closing, near, axis)
    if approach is None:
        return None
    axis = axis - (axis @ approach) * approach
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        return None
    hand = _measured(robot, wrist, fingers, (near, wide), (approach, axis / length), closed, opened)
    return replace(hand, is_triple=closing.is_triple) if hand is not None else None


def measured_jaw(robot: RobotDescription, wrist: str, jaw: SingleJaw) -> MeasuredHand | None:
    """Return the hand of a single moving jaw; None if it leaves no opening."""
    link, name = jaw.joint.child, jaw.joint.name
    closed, opened = {name: jaw.closed}, {name: jaw.opened}
    near, wide = (
        [jaw.fixed, points_of(robot, link, link_poses(wrist, [jaw.joint], ends)[link])]
        for ends in (closed, opened)
    )
    # Jaws are measured to some 11 degrees: what is farther from the wrist's axis was built so.
    approach = _as_wrist_axis(robot, wrist, jaw.approach, _JAW_ALIGNED)
    across = np.cross(jaw.approach, jaw.closing)
    axes = (approach, np.cross(across, approach))
    hand = _measured(robot, wrist, (jaw.joint,), (near, wide), axes, closed, opened)
    return replace(hand, is_single=True) if hand is not None else None


def _tip_slice(points: Floats, approach: Floats) -> Floats:
    """Return the points (n, 3) of a finger that are at its tip."""
    along = points @ approach
    return np.asarray(points[along >= along.max() - TIP_M])


def _measured(
    robot: RobotDescription,
    wrist: str,
    fingers: tuple[Joint, ...],
    clouds: tuple[Sequence[Floats], Sequence[Floats]],
    axes: tuple[Floats, Floats],
    closed: Mapping[str, float],
    opened: Mapping[str, float],
) -> MeasuredHand | None:
    """Return the hand whose jaws' points are ``clouds``, closed and open, wrist frame."""
    (near, wide), (approach, closing) = clouds, axes
    across = np.cross(approach, closing)
    reach = min(float((points @ approach).max()) for points in near)
    pads = [_tip_slice(points, approach) for points in wide]
    if (pads[1] @ closing).mean() < (pads[0] @ closing).mean():
        pads = pads[::-1]
    stroke = float((pads[1] @ closing).min() - (pads[0] @ closing).max())
    if stroke < _MIN_STROKE_M:
        return None
    middle = ((pads[1] @ closing).min() + (pads[0] @ closing).max()) / 2
    sideways = float(np.mean([_middle(points @ across) for points in pads]))
    depth = reach - _TOOL_ABOVE_TIP_M
    tcp = depth * approach + middle * closing + sideways * across
    palm = [joint.child for joint in robot.path(wrist)][-1:] or [wrist]
    own = points_of(robot, palm[0], np.eye(4))
    front = float((own @ approach).max()) if len(own) else 0.0
    width = float(np.median([np.ptp(points @ across) for points in pads]))
    shut = [_tip_slice(points, approach) @ closing for points in near]
    moving = [j for j in fingers if abs(opened[j.name] - closed[j.name]) > 1e-6]
    return MeasuredHand(
        wrist=wrist,
        joints=tuple(robot.path(wrist)),
        fingers=tuple(moving),
        closed=tuple(closed[j.name] for j in moving),
        opened=tuple(opened[j.name] for j in moving),
        tcp=_vector(tcp),
        approach=_vector(approach),
        closing=_vector(closing),
        stroke=stroke,
        width=float(np.clip(width, 0.005, 0.05)),
        length=float(np.clip(reach - front, 0.015, 0.12)),
        lever=_lever(wrist, fingers, opened, tcp),
        closed_gap=float(max(s.min() for s in shut) - min(s.max() for s in shut)),
    )


def _lever(wrist: str, fingers: Sequence[Joint], values: Mapping[str, float], tcp: Floats) -> float:
    poses = link_poses(wrist, fingers, values)
    turning = [poses[joint.child][:3, 3] for joint in fingers if joint.kind == "revolute"]
    return max((float(np.linalg.norm(tcp - origin)) for origin in turning), default=0.0)


def _as_meant(wrist: str, fingers: Sequence[Joint], closing: Floats) -> Floats:
    """Return the axis of a sliding finger that is nearly the given direction, else that."""
    poses = link_poses(wrist, fingers, {})
    for joint in fingers:
        if joint.kind == "prismatic" and joint.parent == wrist:
            axis = poses[joint.child][:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
            if abs(axis @ closing) >= _ALIGNED:
                return np.asarray(axis * np.sign(axis @ closing))
    return closing


def _approach(
    robot: RobotDescription,
    wrist: str,
    fingers: Closing,
    tips: Sequence[Floats],
    closing: Floats,
) -> Floats | None:
    """Return the direction (3,) from the wrist to the closed tips, across the closing axis.

    An axis of the fingers' frames, or of the last arm joint, that is nearly the same counts as
    meant: on a bracket that leads aside, the way from the wrist to the tips is not the fingers'.
    """
    outwards = np.mean([points.mean(axis=0) for points in tips], axis=0)
    outwards = outwards - (outwards @ closing) * closing
    length = float(np.linalg.norm(outwards))
    if length < 1e-3:
        return None
    outwards /= length
    framed = _finger_axis(wrist, fingers, outwards, closing)
    if framed is not None:
        return _as_wrist_axis(robot, wrist, framed, _SAME)
    return _as_wrist_axis(robot, wrist, outwards)


def _finger_axis(wrist: str, fingers: Closing, outwards: Floats, closing: Floats) -> Floats | None:
    """Return the axis of the frames in which fingers are mounted that is nearest to a direction.

    None where the fingers' frames disagree, or none of their axes is near; and for a thumb and a
    finger, which are mounted each in its own way.
    """
    poses = link_poses(wrist, fingers.joints, {})
    above = {joint.child: joint for joint in fingers.joints}
    axes, motions = [], []
    for tip in fingers.tips:
        joint = above.get(tip)
        while joint is not None and joint.parent != wrist:
            joint = above.get(joint.parent)
        if joint is None:
            return None
        frame = poses[joint.child][:3, :3]
        motions.append(frame @ np.array(joint.axis))
        nearest = int(np.abs(outwards @ frame).argmax())
        axis = frame[:, nearest] * np.sign(outwards @ frame[:, nearest])
        # Fingers may be mounted tilted towards each other.
        square = axis - (axis @ closing) * closing
        length = float(np.linalg.norm(square))
        if length < _SQUARE:
            return None
        axes.append(square / length)
    if axes[0] @ axes[1] < _AGREEING:
        return None
    is_pair = abs(motions[0] @ motions[1]) >= _SQUARE * np.linalg.norm(motions[0]) ** 2
    if not (is_pair or fingers.is_triple):
        return None
    mean = np.mean(axes, axis=0)
    mean = mean / np.linalg.norm(mean)
    return np.asarray(mean) if mean @ outwards >= _NEAR_FRAME else None


def _as_wrist_axis(
    robot: RobotDescription, wrist: str, direction: Floats, aligned: float = _ALIGNED
) -> Floats:
    """Return the axis of the last arm joint if a direction is nearly the same, else that."""
    path = robot.path(wrist)
    if not path:
        return direction
    axis = np.array(path[-1].axis) / np.linalg.norm(path[-1].axis)
    along = float(axis @ direction)
    return np.asarray(axis * np.sign(along) if abs(along) >= aligned else direction)


def _middle(values: Floats) -> float:
    return float((values.min() + values.max()) / 2)


def _vector(values: Floats) -> Vector:
    x, y, z = (round(float(v), 6) for v in values)
    return (x, y, z)
