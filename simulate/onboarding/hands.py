"""Arms and hands found in a tree of links, from the shapes of links and the names of joints.

A hand is a link with moving branches at the end of an arm, or of its own, of which two bring their
tips together and apart; or one whose single jaw closes on a part of the link itself. Where the tips
are, how they close and how wide they open follows from moving the finger joints and looking at the
shapes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rtask.errors import RobotError
from simulate.motion.collision import link_poses
from simulate.onboarding.closing import Closing, best_pair, neutral, subtree
from simulate.onboarding.hand_words import is_of_hand, names_a_hand, names_a_wrist, names_no_hand
from simulate.onboarding.measured_hand import MeasuredHand, measured_jaw, measured_pair
from simulate.onboarding.single_jaw import single_jaw
from simulate.robots.description import Floats, Joint, RobotDescription
from simulate.robots.mesh_cover import shape_corners
from simulate.robots.other_hands import FINGERS

__all__ = [
    "MIN_ARM_JOINTS",
    "arm_ends",
    "find_hands",
    "hand_between",
    "hand_of",
    "mounted_hand",
    "shapeless_fingers",
    "unmeasured_hand",
]

MIN_ARM_JOINTS = 3
_MAX_FINGER_JOINTS = 7
"""Moving joints in a row in a finger, those that follow another included."""
_MAX_HAND_JOINTS = 44
_MAX_REACH_M, _MAX_NAMED_M = 0.36, 0.5
"""Of a finger's shapes from its first joint; and where its joints are called fingers."""
_MIN_RANGE = 1e-3
"""Range of a joint, rad or m, below which it does not move."""
_ALONE_M = 0.2
"""Reach of the fingers of a hand without an arm whose names say nothing."""
_CLOSED_M = 0.03


def find_hands(robot: RobotDescription) -> list[MeasuredHand]:
    """Return the hands of a robot without fixed joints, in the order of its links.

    A hand whose wrist has fewer than three joints behind it, such as a gripper of its own, is
    found too: see :attr:`MeasuredHand.joints`.
    """
    below = _below(robot)
    depth = {link.name: len(robot.path(link.name)) for link in robot.links}
    by_wrist: dict[str, MeasuredHand] = {}
    taken: set[str] = set()
    for link in sorted(depth, key=lambda name: depth[name]):
        if link in taken or not _may_be_wrist(robot, below, link):
            continue
        hand = _hand_on(robot, below, link)
        if hand is not None and (depth[link] >= MIN_ARM_JOINTS or _is_alone(robot, below, hand)):
            by_wrist[link] = hand
            taken |= {joint.child for joint in _fingers_on(below, link)}
    return [by_wrist[link.name] for link in robot.links if link.name in by_wrist]


def hand_of(robot: RobotDescription, wrist: str) -> MeasuredHand | None:
    """Return the hand on a wrist link; None if its fingers do not open and close."""
    return _hand_on(robot, _below(robot), wrist)


def hand_between(robot: RobotDescription, links: tuple[str, str]) -> MeasuredHand:
    """Return the hand whose jaws are two links that somebody named.

    Parameters
    ----------
    robot
        Without fixed joints.
    links
        Both jaws; a link on a fixed joint stands for the one that it is part of.

    Raises
    ------
    RobotError
        A link is not there, or the two do not open and close.
    """
    first, second = (_moving_link(robot, name) for name in links)
    if first == second:
        raise RobotError(f"{links[0]!r} and {links[1]!r} are one rigid part, not two jaws")
    paths = [robot.path(name) for name in (first, second)]
    shared = [a for a, b in zip(*paths, strict=False) if a is b]
    wrist = shared[-1].child if shared else robot.root
    own = [path[len(shared) :] for path in paths]
    if all(own):
        closing = best_pair(robot, wrist, own)
        hand = measured_pair(robot, wrist, closing) if closing is not None else None
    else:
        jaws = [joint for path in own for joint in path]
        jaw = single_jaw(robot, wrist, jaws[0]) if len(jaws) == 1 else None
        hand = measured_jaw(robot, wrist, jaw) if jaw is not None else None
    if hand is None:
        without = [name for name in (first, second) if not robot.link(name).shapes]
        why = (
            f"{' and '.join(map(repr, without))} has no collision shape"
            if without
            else "moving their joints does not bring them together and apart by 8 mm or more"
        )
        raise RobotError(f"{links[0]!r} and {links[1]!r} are no pair of jaws: {why}")
    return hand


def _moving_link(robot: RobotDescription, name: str) -> str:
    names = {link.name for link in robot.links}
    if name in names:
        return name
    if name in robot.frames:
        return robot.frames[name][0]
    there = ", ".join(sorted(names))
    raise RobotError(f"robot {robot.name!r} has no link {name!r}; it has {there}")


def shapeless_fingers(robot: RobotDescription) -> list[str]:
    """Return the ends of the branches that lack a shape where too few have one for a hand."""
    below = _below(robot)
    bare = []
    for link in robot.links:
        joints = below.get(link.name, [])
        is_behind_arm = len(robot.path(link.name)) >= MIN_ARM_JOINTS
        if not (is_behind_arm and _may_be_wrist(robot, below, link.name)):
            continue
        if len(joints) < 2 and not names_a_hand("", joints):
            continue
        branches = [list(subtree(below, joint)) for joint in joints]
        shaped = [any(robot.link(joint.child).shapes for joint in branch) for branch in branches]
        if sum(shaped) < min(len(branches), 2):
            pairs = zip(branches, shaped, strict=True)
            bare += [branch[-1].child for branch, has_shape in pairs if not has_shape]
    return bare


def unmeasured_hand(robot: RobotDescription) -> str:
    """Return why fingers that only their names show cannot be measured; empty if there are none.

    They have no shapes, limits that let no joint move, or are one finger, with nothing to close on.
    """
    named = [joint for joint in robot.joints if is_of_hand(joint)]
    if not named:
        return ""
    names = ", ".join(dict.fromkeys(joint.child for joint in named))
    if not any(robot.link(joint.child).shapes for joint in named):
        return f"{names}: no shapes"
    if all(joint.upper - joint.lower < _MIN_RANGE for joint in named):
        return f"{names}: limits that leave no motion"
    chain = max((robot.path(joint.child) for joint in named), key=len)
    if 1 < len(named) == len(robot.joints) == len(chain):
        return f"{names}: one finger of its own, with nothing to close on"
    return ""


def mounted_hand(robot: RobotDescription, wrist: str) -> MeasuredHand | None:
    """Return a hand of known kind on a wrist link, of which only the arm is found; None = no arm.

    Its sizes are 0: whoever hung it on knows them.
    """
    joints = tuple(robot.path(wrist))
    if len(joints) < MIN_ARM_JOINTS:
        return None
    fingers = tuple(joint for joint in robot.joints if joint.name in FINGERS)
    ends = (0.0,) * len(fingers)
    none, z, x = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    return MeasuredHand(wrist, joints, fingers, ends, ends, none, z, x, 0.0, 0.0, 0.0, 0.0)


def arm_ends(robot: RobotDescription) -> list[str]:
    """Return the last link of every chain of at least three moving joints, longest chain first."""
    parents = {joint.parent for joint in robot.joints}
    ends = [link.name for link in robot.links if link.name not in parents]
    long = [end for end in ends if len(robot.path(end)) >= MIN_ARM_JOINTS]
    return sorted(long, key=lambda end: -len(robot.path(end)))


def _below(robot: RobotDescription) -> dict[str, list[Joint]]:
    below: dict[str, list[Joint]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def _fingers_on(below: Mapping[str, Sequence[Joint]], wrist: str) -> list[Joint]:
    return [joint for first in below.get(wrist, []) for joint in subtree(below, first)]


def _may_be_wrist(robot: RobotDescription, below: Mapping[str, Sequence[Joint]], link: str) -> bool:
    """Tell whether what a link carries is small enough, and short enough, to be fingers."""

    def depth(name: str) -> int:
        return max((1 + depth(joint.child) for joint in below.get(name, [])), default=0)

    fingers = _fingers_on(below, link)
    if not fingers or len(fingers) > _MAX_HAND_JOINTS or depth(link) > _MAX_FINGER_JOINTS:
        return False
    if names_no_hand(fingers):
        return False
    # A platform of three fingers, each as long as an arm's hand, is one by its names alone.
    longest = _MAX_NAMED_M if names_a_hand("", fingers) else _MAX_REACH_M
    return all(_reach(robot, list(subtree(below, joint))) <= longest for joint in below[link])


def _reach(robot: RobotDescription, branch: Sequence[Joint]) -> float:
    """Return how far (m) the shapes of a finger reach from its first joint."""
    values = {joint.name: neutral(joint) for joint in branch}
    poses = link_poses(branch[0].parent, branch, values)
    start = poses[branch[0].child][:3, 3]
    boxes = [
        _moved(shape_corners(shape), poses[joint.child])
        for joint in branch
        for shape in robot.link(joint.child).shapes
    ]
    return max((float(np.linalg.norm(box - start, axis=1).max()) for box in boxes), default=0.0)


def _moved(points: Floats, pose: Floats) -> Floats:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _hand_on(
    robot: RobotDescription, below: Mapping[str, Sequence[Joint]], wrist: str
) -> MeasuredHand | None:
    joints = below.get(wrist, [])
    branches = [list(subtree(below, joint)) for joint in joints]
    branches = [branch for branch in branches if not names_no_hand(branch)]
    closing = best_pair(robot, wrist, branches) if len(branches) > 1 else None
    hand = measured_pair(robot, wrist, closing) if closing is not None else None
    if hand is not None:
        assert closing is not None
        return hand.with_rest(_folded(wrist, branches, closing, hand))
    for branch in branches:  # the other jaw may be part of the link itself
        moved = [joint for joint in branch if joint.mimic is None]
        if len(moved) == 1 and moved[0] is branch[0] and not names_a_wrist(moved[0]):
            jaw = single_jaw(robot, wrist, branch[0])
            hand = measured_jaw(robot, wrist, jaw) if jaw is not None else None
            if hand is not None:
                others = (joint for joint in _fingers_on(below, wrist) if joint is not branch[0])
                return hand.with_rest({joint.name: _at_rest(joint) for joint in others})
    return None


def _folded(
    wrist: str, branches: Sequence[Sequence[Joint]], closing: Closing, hand: MeasuredHand
) -> dict[str, float]:
    """Return the joints of the other fingers, at the limits that keep these farthest back."""
    used = {joint.name for joint in closing.joints}
    approach = np.array(hand.approach)
    values: dict[str, float] = {}
    for branch in branches:
        for joint in branch:
            if joint.name in used:
                continue
            ends = []
            for value in (joint.lower, joint.upper):
                poses = link_poses(wrist, branch, {**values, joint.name: value})
                ends.append((float(poses[branch[-1].child][:3, 3] @ approach), value))
            far = abs(ends[0][0] - ends[1][0]) > 1e-3
            values[joint.name] = round(min(ends)[1], 6) if far else _at_rest(joint)
    return values


def _at_rest(joint: Joint) -> float:
    return 0.0 if joint.lower <= 0.0 <= joint.upper else round(neutral(joint), 6)


def _is_alone(
    robot: RobotDescription, below: Mapping[str, Sequence[Joint]], hand: MeasuredHand
) -> bool:
    """Tell whether what is on a link near the root is a gripper of its own, not legs or wheels."""
    whole = len(robot.joints) == len(_fingers_on(below, hand.wrist)) + len(hand.joints)
    if names_a_hand(robot.name if whole else "", hand.fingers):
        return True
    if hand.is_single or names_no_hand(robot.joints):
        return False
    near = max(_reach(robot, list(subtree(below, joint))) for joint in below[hand.wrist])
    return whole and near <= _ALONE_M and hand.closed_gap <= _CLOSED_M
