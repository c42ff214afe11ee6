"""What the names of joints and links say about hands: evidence beside the shapes."""

from __future__ import annotations

import re

from simulate.robots.description import Joint, RobotDescription

__all__ = ["hand_joints", "names_a_hand", "names_a_leg"]

_HAND = re.compile(r"finger|thumb|gripper|(?<![a-z])jaws?(?![a-z])|claw|knuckle|pincer", re.I)
_WRIST = re.compile(r"wrist|yaw|roll(?!er)|pitch|extension|rotat|handlebar", re.I)
"""Joints that carry a hand are often named after it."""
_DIGIT = re.compile(r"finger|thumb|(?<![a-z])jaws?(?![a-z])|claw|knuckle|pincer", re.I)
_LEG = re.compile(
    r"leg(?![a-z])|wheel|(?<![a-z])hip|knee|ankle|(?<![a-z])foot|feet|thigh|shank|calf|(?<![a-z])toe|"
    r"propeller|rotor(?![a-z])|caster|steer",
    re.I,
)


def hand_joints(robot: RobotDescription) -> list[str]:
    """Return the moving joints whose names speak of fingers, jaws or a gripper.

    Names of joints that carry a hand, such as ``gripper_roll``, do not count.
    """
    return [
        joint.name
        for joint in robot.joints
        if any(
            _HAND.search(name) and (_DIGIT.search(name) or not _WRIST.search(name))
            for name in (joint.name, joint.child)
        )
        and not _WRIST.search(_DIGIT.sub("", joint.name) if not _DIGIT.search(joint.name) else "")
    ]


def names_a_hand(robot: RobotDescription, joints: list[Joint]) -> bool:
    """Tell whether a joint, its links or the robot is named after a part of a hand."""
    names = [name for joint in joints for name in (joint.name, joint.parent, joint.child)]
    return any(_HAND.search(name) or "hand" in name.lower() for name in (robot.name, *names))


def names_a_leg(joints: list[Joint]) -> bool:
    """Tell whether a joint or a link is named after a part of a leg, or a wheel."""
    return any(
        _LEG.search(name) for joint in joints for name in (joint.name, joint.parent, joint.child)
    )
