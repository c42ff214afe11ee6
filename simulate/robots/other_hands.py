"""Suction cups and three-finger hands as parts of robots: their links, joints and settings.

Both hang on a mounting plate whose z points out of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grasp.spatial.gripper_files import OtherHand, end_effector_named
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand
from rtask.errors import RobotError
from simulate.robots.description import (
    Arm,
    Floats,
    Inertial,
    Joint,
    Link,
    Pose,
    RobotDescription,
    Shape,
)
from simulate.robots.mesh_cover import shape_points
from simulate.robots.urdf_reader import ReadRobot

__all__ = [
    "FINGERS", "MOUNT", "STAND_OFF_M", "OtherHand", "arm_with", "cup_with_wrist", "links_of",
    "other_hand",
]  # fmt: skip

MOUNT = "made_hand"
"""The link that both kinds begin with, and the frame that is left of it on a welded robot."""
FINGERS = ("made_finger_1_joint", "made_finger_2_joint", "made_finger_3_joint")
"""Joints of three fingers; the first one drives the others."""
STAND_OFF_M = 0.006
"""From a cup's lip to the tool centre point, m: it comes to a stop so far before what it is to
take, and moves on until it seals."""

_CUP_KG, _PALM_KG, _FINGER_KG = 0.15, 0.5, 0.1
_DESCRIBED = (".json", ".toml")
_SPEED_M_S = 0.15
_WIDEST_M = 0.3
_LIFTED_M = 0.004
_SLACK_M = 0.001
_WAYS = 16
"""Directions about the axis of a cup in which the width of its arm's flange is taken."""


@dataclass(frozen=True)
class _Plate:
    """Sizes along z of a hand on its plate, m: of its box, and to the tool centre point."""

    box: float
    tool: float


def other_hand(text: str) -> OtherHand | None:
    """Return the hand of ``suction:RADIUS``, ``three:OPENING`` (m) or a file; None = of jaws.

    Raises
    ------
    RobotError
        The file describes jaws without links, or cannot be read.
    """
    described = Path(text).suffix.lower() in _DESCRIBED
    if not described and text.partition(":")[0] not in ("suction", "three"):
        return None
    try:
        effector = end_effector_named(text)
    except OSError as error:
        raise RobotError(f"gripper {text!r}: {error.strerror}") from error
    except ValueError as error:
        named = str(error) if text in str(error) else f"gripper {text!r}: {error}"
        raise RobotError(named) from error
    if not isinstance(effector, OtherHand):
        raise RobotError(
            f"gripper {text!r} describes jaws without links; an arm takes jaw:STROKE or a URDF file"
        )
    return effector


def links_of(hand: OtherHand) -> ReadRobot:
    """Return the links and joints of a hand on its plate."""
    return _cup(hand) if isinstance(hand, SuctionCup) else _three_fingers(hand)


def arm_with(arm: Arm, hand: OtherHand, wrist_from_mount: Floats) -> Arm:
    """Return an arm that ends in a hand.

    Parameters
    ----------
    arm
        Whose name, side, joints, wrist and home it keeps.
    wrist_from_mount : (4, 4)
        Of the plate in the frame of the wrist link.
    """
    turn, plate = wrist_from_mount[:3, :3], _plate(hand)
    x, y, z = (float(v) for v in wrist_from_mount[:3, 3] + plate.tool * turn[:, 2])
    fingers = () if isinstance(hand, SuctionCup) else FINGERS
    made = replace(
        arm,
        tcp=(x, y, z), approach=_axis(turn[:, 2]), closing=_axis(turn[:, 0]),
        end_effector=hand.name, aliases=(), fingers=fingers, gripper_type=hand.gripper_type,
        max_payload=hand.max_payload, finger_speed=_SPEED_M_S,
    )  # fmt: skip
    if isinstance(hand, SuctionCup):
        return replace(
            made, kind="SuctionCup", grip="suction_cup", cup=hand, mouth=_WIDEST_M,
            finger_range=1.0,
            finger_closed=(), finger_open=(), finger_width=2 * hand.radius,
            finger_length=hand.length, max_force=hand.force, close_effort=0.0, open_effort=0.0,
        )  # fmt: skip
    closed, opened = hand.min_opening / 2, hand.max_opening / 2
    return replace(
        made, kind="ThreeFingerHand", grip="three_fingers", three=hand,
        mouth=hand.max_opening, finger_range=opened,
        finger_closed=(closed,) * 3, finger_open=(opened,) * 3, finger_width=hand.finger_width,
        finger_length=hand.finger_length, max_force=3 * hand.max_force,
        close_effort=3 * hand.max_force, open_effort=3 * hand.max_force,
    )  # fmt: skip


def cup_with_wrist(robot: RobotDescription, arm: Arm) -> SuctionCup:
    """Return the cup of an arm with a box for the link that carries it, as planning takes it.

    A cup may turn about its axis, so that only what is around the axis at any turn counts: the box
    has the section of a round flange as wide as the link in the direction where it is narrowest.
    """
    cup = arm.cup
    assert cup is not None
    approach = np.array(arm.approach)
    lip = np.array(arm.tcp) - STAND_OFF_M * approach
    shapes = [shape_points(shape) for shape in robot.link(arm.wrist).shapes]
    points = np.concatenate([np.zeros((0, 3)), *shapes]) - lip
    depth = -points @ approach
    behind = depth > _LIFTED_M + cup.length + _SLACK_M
    if cup.wrist is not None or not behind.any():
        return cup
    closing = np.array(arm.closing)
    angle = 2 * np.pi * np.arange(_WAYS) / _WAYS
    ways = np.outer(np.cos(angle), closing) + np.outer(np.sin(angle), np.cross(approach, closing))
    radius = float((points[behind] @ ways.T).max(axis=0).min())
    if radius <= 0:  # nothing is around the axis, it is all beside it
        return cup
    return cup.flanged(radius, float(depth[behind].max()) - _LIFTED_M - cup.length)


def _plate(hand: OtherHand) -> _Plate:
    if isinstance(hand, SuctionCup):
        box = 0.0 if hand.wrist is None else hand.wrist[2]
        return _Plate(box, box + hand.length + _LIFTED_M + STAND_OFF_M)
    box = _palm(hand)[2] + (0.0 if hand.wrist is None else hand.wrist[2])
    return _Plate(box, box + hand.finger_length - hand.fingertip)


def _palm(hand: ThreeFingerHand) -> tuple[float, float, float]:
    across = hand.max_opening + 2 * hand.finger_width
    return hand.palm or (across, across, 0.05)


def _cup(cup: SuctionCup) -> ReadRobot:
    radius = 0.8 * cup.radius if cup.stem_radius is None else cup.stem_radius
    box = _plate(cup).box
    stem = Shape("cylinder", (radius, cup.length), Pose((0.0, 0.0, box + cup.length / 2)))
    shapes = (stem,) if cup.wrist is None else (stem, _box(cup.wrist, 0.0))
    return ReadRobot("cup", MOUNT, (Link(MOUNT, _solid(_CUP_KG, stem), shapes),), ())


def _three_fingers(hand: ThreeFingerHand) -> ReadRobot:
    wrist, box = hand.wrist, _plate(hand).box
    low = 0.0 if wrist is None else wrist[2]
    palm = _box(_palm(hand), low)
    shapes = (palm,) if wrist is None else (palm, _box(wrist, 0.0))
    links, joints = [Link(MOUNT, _solid(_PALM_KG, palm), shapes)], []
    half, long = hand.finger_width / 2, hand.finger_length
    for name, way in zip(FINGERS, WAYS, strict=True):
        x, y = (float(v) for v in half * way[:2])
        post = Shape("cylinder", (half, long), Pose((x, y, long / 2)))
        link = name.removesuffix("_joint")
        links.append(Link(link, _solid(_FINGER_KG, post), (post,)))
        joints.append(
            Joint(
                name, MOUNT, link, Pose((0.0, 0.0, box)), _axis(way), "prismatic",
                hand.min_opening / 2, hand.max_opening / 2, 0.2, 3 * hand.max_force,
                None if name == FINGERS[0] else (FINGERS[0], 1.0),
            )
        )  # fmt: skip
    return ReadRobot("three_fingers", MOUNT, tuple(links), tuple(joints))


def _box(size: tuple[float, float, float], low: float) -> Shape:
    return Shape("box", size, Pose((0.0, 0.0, low + size[2] / 2)))


def _solid(mass: float, shape: Shape) -> Inertial:
    """Return the inertia of a link as that of the box around one of its shapes."""
    if shape.kind == "cylinder":
        radius, length = shape.size
        x, y, z = (2 * radius) ** 2, (2 * radius) ** 2, length**2
    else:
        x, y, z = (side**2 for side in shape.size)
    moments = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    return Inertial(mass, shape.pose.xyz, moments)


def _axis(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.round(values, 9))
    return (x, y, z)
