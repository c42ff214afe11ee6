"""Arms made of hands that were found: their joints, efforts and openings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simulate.motion.collision import link_poses
from simulate.onboarding.closing import finger_source, points_of
from simulate.onboarding.measured_hand import TIP_M, MeasuredHand
from simulate.robots.description import Arm, Floats, Joint, RobotDescription

__all__ = ["arm_from", "tip_gap"]

_FINGER_N = 15.0
"""Force of a finger that is not known, N."""
_PAYLOAD_KG = 1.0


def arm_from(
    hand: MeasuredHand, name: str, side: int, joints: Sequence[Joint], home: Floats
) -> Arm:
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
    driven = [j for j in hand.fingers if finger_source(j, hand.fingers) is None]
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


def tip_gap(robot: RobotDescription, arm: Arm, opening: float) -> float:
    """Return the gap (m) between the fingertips of a hand at an opening, 0 (closed) to 1."""
    fingers = [joint for joint in robot.joints if joint.name in arm.fingers]
    poses = link_poses(arm.wrist, fingers, arm.finger_values(opening))
    clouds = [cloud for name, pose in poses.items() if len(cloud := points_of(robot, name, pose))]
    approach, closing = np.array(arm.approach), np.array(arm.closing)
    reach = max(float((cloud @ approach).max()) for cloud in clouds)
    tips = [cloud[cloud @ approach >= reach - TIP_M] @ closing for cloud in clouds]
    middle = float(np.array(arm.tcp) @ closing)
    if arm.has_single_jaw:  # the fixed one is where the opening ends
        return max(float(min(tip.min() for tip in tips if len(tip))) - middle + arm.mouth / 2, 0.0)
    sides: dict[bool, list[float]] = {True: [], False: []}
    for tip in tips:
        if len(tip):
            beyond = bool(tip.mean() > middle)
            sides[beyond].append(float(tip.min() if beyond else tip.max()))
    if not (sides[True] and sides[False]):
        return 0.0
    return max(min(sides[True]) - max(sides[False]), 0.0)
