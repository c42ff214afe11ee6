"""What the names of joints and links say about hands: evidence beside the shapes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from simulate.robots.description import Joint, RobotDescription

__all__ = ["hand_joints", "is_of_hand", "names_a_hand", "names_a_wrist", "names_no_hand"]

_DIGIT = re.compile(r"finger|thumb|(?<![a-z])jaws?(?![a-z])|claw|knuckle|pincer", re.I)
_GRIPPER = re.compile(r"gripper", re.I)
_CARRIES = re.compile(r"wrist|yaw|roll(?!er)|pitch|extension|rotat", re.I)
"""Joints that carry a gripper are often named after it."""
_OTHER = re.compile(
    r"leg(?![a-z])|wheel|(?<![a-z])hip|knee|ankle|(?<![a-z])foot|feet|thigh|shank|calf|(?<![a-z])toe|"
    r"propeller|rotor(?![a-z])|caster|steer|neck|(?<![a-z])head(?![a-z])|(?<![a-z])eye|torso|waist|"
    r"chest|shoulder|elbow",
    re.I,
)


def hand_joints(robot: RobotDescription) -> list[str]:
    """Return the moving joints whose names speak of fingers, jaws or a gripper.

    Names of joints that carry a hand, such as ``gripper_roll``, do not count.
    """
    return [joint.name for joint in robot.joints if is_of_hand(joint)]


def is_of_hand(joint: Joint) -> bool:
    """Tell whether a joint, or the link it moves, is named after a finger, a jaw or a gripper."""
    if any(_DIGIT.search(name) for name in (joint.name, joint.child)):
        return True
    named = any(_GRIPPER.search(name) for name in (joint.name, joint.child))
    return named and not _CARRIES.search(joint.name)


def names_a_hand(name: str, joints: Sequence[Joint]) -> bool:
    """Tell whether a robot, or a joint or a link of it, is named after a part of a hand."""
    names = [name, *(text for j in joints for text in (j.name, j.parent, j.child))]
    return any(
        _DIGIT.search(text) or _GRIPPER.search(text) or "hand" in text.lower() for text in names
    )


def names_a_wrist(joint: Joint) -> bool:
    """Tell whether a joint is named after a wrist, and not after what the wrist carries."""
    return bool(_CARRIES.search(joint.name)) and not is_of_hand(joint)


def names_no_hand(joints: Sequence[Joint]) -> bool:
    """Tell whether joints, or the links they move, are named after a leg, a wheel or a head.

    Names of fingers, jaws or a gripper outweigh that.
    """
    names = [name for joint in joints for name in (joint.name, joint.child)]
    return any(map(_OTHER.search, names)) and not any(map(is_of_hand, joints))
