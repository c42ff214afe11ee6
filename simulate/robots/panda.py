"""The Franka Emika Panda with its parallel gripper, from the user's own ``pybullet_data``.

Its URDF and meshes (Apache-2.0) are read where the package is installed, and not copied. The camera
is our addition: it stands opposite the robot and looks steeply down, so that it sees objects from
directions similar to those of other robots: of 18 products stored by a Nao, it recognised 18, and
15 when it was 14 cm further back.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

from rtask.errors import RobotError, UsageError
from simulate.robots.attaching import attach
from simulate.robots.cameras import standing_cameras
from simulate.robots.description import Arm, Pose, RobotDescription, Workplace, transform_from
from simulate.robots.other_hands import arm_with, links_of, other_hand
from simulate.robots.urdf_reader import ReadRobot, read_urdf

__all__ = ["describe_panda"]

_FILE = Path("franka_panda") / "panda.urdf"
_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
_HAND_TURN = -math.pi / 4
_HAND_M, _TARGET_M = 0.107, 0.105
"""Hand beyond link 7, grasp target beyond the hand: panda_joint8 and panda_grasptarget_hand."""

_FLANGE = "panda_link8"
_LINK7_FROM_FLANGE = transform_from((0.0, 0.0, _HAND_M))

_WORKPLACE = Workplace(
    table_height=0.20,
    table_near=0.28,
    table_size=(0.50, 1.00, 0.02),
    box_centre=(0.46, 0.34),
    box_inner=0.20,
    box_height=0.04,
    area_x=(0.40, 0.54),
    area_abs_y=(0.03, 0.18),
    eye=(1.15, -0.70, 0.75),
    target=(0.42, -0.12, 0.25),
)


def describe_panda(*, name: str = "panda", hand: str | None = None) -> RobotDescription:
    """Describe the Panda.

    Parameters
    ----------
    hand
        On its flange instead of its own: ``suction:RADIUS`` or ``three:OPENING``, m, or a file that
        describes one of these; None = its own gripper.

    Raises
    ------
    RobotError
        ``pybullet_data`` is not installed, or its file cannot be read.
    """
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or spec.origin is None:
        raise RobotError("the panda comes with the package pybullet_data, which is not installed")
    read = read_urdf(Path(spec.origin).parent / _FILE)
    other = None if hand is None else other_hand(hand)
    if hand is not None and other is None:
        raise UsageError(f"gripper {hand!r}: the panda takes suction:RADIUS, three:OPENING or FILE")
    if other is not None:
        read, _ = attach(_without_hand(read), links_of(other), _FLANGE)
    bare = RobotDescription(
        name=name, root=read.root, links=read.links, joints=read.joints, arms={}, cameras={}
    ).welded()
    arm = _arm() if other is None else arm_with(_arm(), other, _LINK7_FROM_FLANGE)
    return replace(
        bare,
        arms={
            "panda_arm": _arm() if other is None else arm_with(_arm(), other, _LINK7_FROM_FLANGE)
        },
        cameras=standing_cameras(read.root, _WORKPLACE),
        frames={"panda_grasptarget": (arm.wrist, Pose(arm.tcp))},
        model="Franka Emika Panda",
        base_frame="panda_link0",
        workplace=_WORKPLACE,
    )


def _without_hand(read: ReadRobot) -> ReadRobot:
    """Return the arm up to its flange."""
    behind = {_FLANGE}
    for joint in read.joints:  # parents come first
        if joint.parent in behind:
            behind.add(joint.child)
    behind.discard(_FLANGE)
    return replace(
        read,
        links=tuple(link for link in read.links if link.name not in behind),
        joints=tuple(joint for joint in read.joints if joint.child not in behind),
    )


def _arm() -> Arm:
    # The fingers move along y of the hand, which is turned about z of link 7.
    closing = (-math.sin(_HAND_TURN), math.cos(_HAND_TURN), 0.0)
    return Arm(
        name="panda_arm",
        side=0,
        joints=_JOINTS,
        wrist="panda_link7",
        tcp=(0.0, 0.0, _HAND_M + _TARGET_M),
        approach=(0.0, 0.0, 1.0),
        closing=closing,
        home=(-1.45, -0.95, 0.0, -2.50, 0.0, 1.75, 0.785),
        end_effector="panda_hand",
        fingers=("panda_finger_joint1", "panda_finger_joint2"),
        finger_range=0.04,
        mouth=0.080,
        max_payload=3.0,
        gripper_type="panda_hand",
        finger_width=0.020,
        finger_length=0.045,
        max_force=40.0,
        close_effort=40.0,
        open_effort=20.0,
        finger_speed=0.15,
        grip="parallel_jaws",
        kind="ParallelJawGripper",
    )
