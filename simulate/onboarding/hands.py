"""Arms and hands found in a tree of links, from the shapes of its links alone.

A hand is a link with two or more moving branches at the end of an arm. Where its tips are, how they
close and how wide they open follows from moving the finger joints and looking at the shapes.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simulate.motion.collision import link_poses
from simulate.robots.description import Arm, Floats, Joint, RobotDescription, Vector
from simulate.robots.mesh_cover import shape_points
from simulate.robots.other_hands import FINGERS

__all__ = [
    "FoundHand",
    "arm_ends",
    "arm_from",
    "find_hands",
    "hand_of",
    "mounted_hand",
    "points_of",
    "shapeless_fingers",
    "tip_gap",
]

_MIN_ARM_JOINTS = 3
_MAX_FINGER_JOINTS = 4
_MAX_FREE_FINGERS = 9
"""Finger joints whose ends are tried in all combinations."""
_REACHES = 0.85
"""Fingers that reach at least this share of the longest one's length may be opposed."""
_TIP_M = 0.015
"""Length of a finger that counts as its tip."""
_TOOL_ABOVE_TIP_M = 0.009
_MIN_STROKE_M = 0.008
_ALIGNED = 0.94
"""Cosine of the angle below which a direction is taken to be the wrist's axis."""


@dataclass(frozen=True)
class FoundHand:
    """A hand: its wrist link, its arm's joints and its fingers.

    Parameters
    ----------
    wrist
        Link that carries the fingers.
    joints
        Arm joints from the root to the wrist.
    fingers
        Finger joints, parents before children.
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


def find_hands(robot: RobotDescription) -> list[FoundHand]:
    """Return the hands of a robot without fixed joints, in the order of its links."""
    hands = []
    for wrist in _wrists(robot):
        hand = hand_of(robot, wrist)
        if hand is not None:
            hands.append(hand)
    return hands


def shapeless_fingers(robot: RobotDescription) -> list[str]:
    """Return the ends of the branches that lack a shape where too few have one for a hand."""
    below = _below(robot)
    bare = []
    for wrist in _wrists(robot):
        branches = [list(_subtree(below, joint)) for joint in below[wrist]]
        shaped = [any(robot.link(joint.child).shapes for joint in branch) for branch in branches]
        if sum(shaped) < 2:
            pairs = zip(branches, shaped, strict=True)
            bare += [branch[-1].child for branch, has_shape in pairs if not has_shape]
    return bare


def mounted_hand(robot: RobotDescription, wrist: str) -> FoundHand | None:
    """Return a hand of known kind on a wrist link, of which only the arm is found; None = no arm.

    Its sizes are 0: whoever hung it on knows them.
    """
    joints = tuple(robot.path(wrist))
    if len(joints) < _MIN_ARM_JOINTS:
        return None
    fingers = tuple(joint for joint in robot.joints if joint.name in FINGERS)
    ends = (0.0,) * len(fingers)
    none, z, x = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    return FoundHand(wrist, joints, fingers, ends, ends, none, z, x, 0.0, 0.0, 0.0, 0.0)


def arm_ends(robot: RobotDescription) -> list[str]:
    """Return the last link of every chain of at least three moving joints, longest chain first."""
    parents = {joint.parent for joint in robot.joints}
    ends = [link.name for link in robot.links if link.name not in parents]
    long = [end for end in ends if len(robot.path(end)) >= _MIN_ARM_JOINTS]
    return sorted(long, key=lambda end: -len(robot.path(end)))


def _wrists(robot: RobotDescription) -> Iterator[str]:
    """Yield the outermost links with two or more short moving branches behind an arm."""
    below = _below(robot)

    def depth(link: str) -> int:
        return max((1 + depth(joint.child) for joint in below.get(link, [])), default=0)

    for link in robot.links:
        branches = below.get(link.name, [])
        if len(branches) < 2 or len(robot.path(link.name)) < _MIN_ARM_JOINTS:
            continue
        if all(1 + depth(joint.child) <= _MAX_FINGER_JOINTS for joint in branches):
            yield link.name


def _below(robot: RobotDescription) -> dict[str, list[Joint]]:
    below: dict[str, list[Joint]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def hand_of(robot: RobotDescription, wrist: str) -> FoundHand | None:
    """Return the hand on a wrist link; None if its fingers do not open and close."""
    below = _below(robot)
    branches = [list(_subtree(below, joint)) for joint in below.get(wrist, [])]
    fingers = tuple(joint for branch in branches for joint in branch)
    tips = _opposed_tips(robot, wrist, branches)
    if tips is None:
        return None
    ends = _ends(robot, wrist, fingers, tips)
    if ends is None:
        return None
    closed, opened = ends
    return _measured(robot, wrist, fingers, tips, closed, opened)


def _subtree(below: Mapping[str, list[Joint]], joint: Joint) -> Iterator[Joint]:
    yield joint
    for child in below.get(joint.child, []):
        yield from _subtree(below, child)


def _opposed_tips(
    robot: RobotDescription, wrist: str, branches: Sequence[Sequence[Joint]]
) -> tuple[str, str] | None:
    """Return the outermost links of the two branches that reach farthest and lie apart."""
    reaches = []
    for branch in branches:
        values = {joint.name: _neutral(joint) for joint in branch}
        poses = link_poses(wrist, branch, values)
        shaped = [
            (float(np.linalg.norm(points, axis=1).max()), joint.child, points.mean(axis=0))
            for joint in branch
            if len(points := points_of(robot, joint.child, poses[joint.child]))
        ]
        if shaped:
            reaches.append(max(shaped, key=lambda row: row[0]))
    if len(reaches) < 2:
        return None
    longest = max(reach for reach, _, _ in reaches)
    far = [row for row in reaches if row[0] >= _REACHES * longest]
    if len(far) < 2:
        far = sorted(reaches, key=lambda row: -row[0])[:2]
    pairs = itertools.combinations(far, 2)
    first, second = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0][2] - pair[1][2])))
    return first[1], second[1]


def _neutral(joint: Joint) -> float:
    return (joint.lower + joint.upper) / 2


def _ends(
    robot: RobotDescription, wrist: str, fingers: Sequence[Joint], tips: tuple[str, str]
) -> tuple[dict[str, float], dict[str, float]] | None:
    """Return the finger values that bring the tips together, and those that part them most."""
    free = [joint for joint in fingers if joint.mimic is None or _source(joint, fingers) is None]
    if not 1 <= len(free) <= _MAX_FREE_FINGERS:
        return None
    tried = []
    for ends in itertools.product((0, 1), repeat=len(free)):
        chosen = {j.name: (j.lower, j.upper)[e] for j, e in zip(free, ends, strict=True)}
        values = _with_mimics(fingers, chosen)
        poses = link_poses(wrist, fingers, values)
        middles = [points_of(robot, tip, poses[tip]).mean(axis=0) for tip in tips]
        tried.append((float(np.linalg.norm(middles[0] - middles[1])), values))
    near, wide = min(tried, key=lambda row: row[0]), max(tried, key=lambda row: row[0])
    return (near[1], wide[1]) if wide[0] - near[0] >= _MIN_STROKE_M else None


def _source(joint: Joint, fingers: Sequence[Joint]) -> Joint | None:
    assert joint.mimic is not None
    return next((finger for finger in fingers if finger.name == joint.mimic[0]), None)


def _with_mimics(fingers: Sequence[Joint], chosen: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every finger joint, those that follow another included."""
    values = dict(chosen)
    for _ in fingers:  # one may follow a follower
        for joint in fingers:
            if joint.name not in chosen and joint.mimic is not None:
                source, factor = joint.mimic
                followed = factor * values.get(source, 0.0) + joint.mimic_offset
                values[joint.name] = min(max(followed, joint.lower), joint.upper)
    return values


def _measured(
    robot: RobotDescription,
    wrist: str,
    fingers: tuple[Joint, ...],
    tips: tuple[str, str],
    closed: Mapping[str, float],
    opened: Mapping[str, float],
) -> FoundHand | None:
    near = [points_of(robot, tip, link_poses(wrist, fingers, closed)[tip]) for tip in tips]
    wide = [points_of(robot, tip, link_poses(wrist, fingers, opened)[tip]) for tip in tips]
    apart = wide[1].mean(axis=0) - wide[0].mean(axis=0)
    closing = _as_meant(robot, wrist, fingers, apart / np.linalg.norm(apart))
    approach = _approach(robot, wrist, near, closing)
    if approach is None:
        return None
    closing = closing - (closing @ approach) * approach
    closing /= np.linalg.norm(closing)
    across = np.cross(approach, closing)
    reach = min(float((points @ approach).max()) for points in near)
    pads = [points[points @ approach >= (points @ approach).max() - _TIP_M] for points in wide]
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
    ordered = tuple(fingers)
    moving = [j for j in ordered if abs(opened[j.name] - closed[j.name]) > 1e-6]
    return FoundHand(
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
    )


def _lever(wrist: str, fingers: Sequence[Joint], values: Mapping[str, float], tcp: Floats) -> float:
    poses = link_poses(wrist, fingers, values)
    turning = [poses[joint.child][:3, 3] for joint in fingers if joint.kind == "revolute"]
    return max((float(np.linalg.norm(tcp - origin)) for origin in turning), default=0.0)


def _as_meant(
    robot: RobotDescription, wrist: str, fingers: Sequence[Joint], closing: Floats
) -> Floats:
    """Return the axis of a sliding finger that is nearly the given direction, else that."""
    poses = link_poses(wrist, fingers, {})
    for joint in fingers:
        if joint.kind == "prismatic" and joint.parent == wrist:
            axis = poses[joint.child][:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
            if abs(axis @ closing) >= _ALIGNED:
                return np.asarray(axis * np.sign(axis @ closing))
    return closing


def _approach(
    robot: RobotDescription, wrist: str, tips: Sequence[Floats], closing: Floats
) -> Floats | None:
    """Return the direction (3,) from the wrist to the closed tips, across the closing axis.

    An axis of the last arm joint that is nearly the same counts as meant.
    """
    outwards = np.mean([points.mean(axis=0) for points in tips], axis=0)
    outwards = outwards - (outwards @ closing) * closing
    length = float(np.linalg.norm(outwards))
    if length < 1e-3:
        return None
    outwards /= length
    axis = np.array(robot.path(wrist)[-1].axis) if robot.path(wrist) else outwards
    axis = axis / np.linalg.norm(axis)
    axis = axis * np.sign(axis @ outwards) if axis @ outwards else axis
    return np.asarray(axis if axis @ outwards >= _ALIGNED else outwards)


def points_of(robot: RobotDescription, link: str, wrist_from_link: Floats) -> Floats:
    """Return points (n, 3) m on the shapes of a link, in the wrist frame."""
    parts = [shape_points(shape) for shape in robot.link(link).shapes]
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    return np.asarray(points @ wrist_from_link[:3, :3].T + wrist_from_link[:3, 3])


def tip_gap(robot: RobotDescription, arm: Arm, opening: float) -> float:
    """Return the gap (m) between the fingertips of a hand at an opening, 0 (closed) to 1."""
    fingers = [joint for joint in robot.joints if joint.name in arm.fingers]
    poses = link_poses(arm.wrist, fingers, arm.finger_values(opening))
    clouds = [cloud for name, pose in poses.items() if len(cloud := points_of(robot, name, pose))]
    approach, closing = np.array(arm.approach), np.array(arm.closing)
    reach = max(float((cloud @ approach).max()) for cloud in clouds)
    tips = [cloud[cloud @ approach >= reach - _TIP_M] @ closing for cloud in clouds]
    middle = float(np.array(arm.tcp) @ closing)
    sides: dict[bool, list[float]] = {True: [], False: []}
    for tip in tips:
        if len(tip):
            beyond = bool(tip.mean() > middle)
            sides[beyond].append(float(tip.min() if beyond else tip.max()))
    if not (sides[True] and sides[False]):
        return 0.0
    return max(min(sides[True]) - max(sides[False]), 0.0)


def _middle(values: Floats) -> float:
    return float((values.min() + values.max()) / 2)


def _vector(values: Floats) -> Vector:
    x, y, z = (round(float(v), 6) for v in values)
    return (x, y, z)


def arm_from(hand: FoundHand, name: str, side: int, joints: Sequence[Joint], home: Floats) -> Arm:
    """Return the arm of a found hand.

    Parameters
    ----------
    hand
        The hand.
    name, side
        Of the arm.
    joints
        Those of the hand's joints that the arm may use.
    home : (dof,) float, rad
    """
    revolute = hand.fingers[0].kind == "revolute"
    driven = [j for j in hand.fingers if j.mimic is None or _source(j, hand.fingers) is None]
    lever = hand.lever or 1.0
    moved = 2.0 if len(driven) == 1 else 1.0  # fingers that one motor moves
    effort = min(min(joint.effort for joint in driven), moved * _FINGER_N * lever)
    return Arm(
        name=name,
        side=side,
        joints=tuple(joint.name for joint in joints),
        wrist=hand.wrist,
        tcp=hand.tcp,
        approach=hand.approach,
        closing=hand.closing,
        home=tuple(round(float(v), 4) for v in home),
        end_effector=f"{name}_hand",
        fingers=tuple(joint.name for joint in hand.fingers),
        finger_range=1.0,
        finger_closed=hand.closed,
        finger_open=hand.opened,
        mouth=round(hand.stroke, 4),
        max_payload=_PAYLOAD_KG,
        gripper_type=f"{hand.wrist}_jaws",
        finger_width=round(hand.width, 4),
        finger_length=round(hand.length, 4),
        max_force=round(2 * effort / lever / moved, 3),
        close_effort=round(effort, 4),
        open_effort=round(effort * 1.3, 4),
        finger_speed=1.5 if revolute else 0.15,
        grip="parallel_jaws",
        kind="ParallelJawGripper",
    )


_FINGER_N = 15.0
"""Force of a finger that is not known, N."""
_PAYLOAD_KG = 1.0
