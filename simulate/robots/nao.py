"""The NAO H25 V5, built from :mod:`simulate.robots.facts_nao` and our own primitives.

No mesh of the robot may be redistributed, so limbs, torso and head are boxes, spheres and cylinders
of our own choice; the palm follows from the published touch-sensor frames.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from rtask.errors import RobotError
from simulate.robots import facts_nao as facts
from simulate.robots.description import (
    Arm,
    CameraMount,
    Inertial,
    Joint,
    Link,
    Pose,
    RobotDescription,
    Shape,
    Stance,
    Workplace,
)

__all__ = ["GRIPPER_TILT", "LEAN", "PHALANX_MASS", "describe_nao", "head_pitch_limits"]

Legs = Literal["fixed", "joints"]

GRIPPER_TILT = 0.8
"""Angle (rad) of the approach axis below the finger direction: the mouth opens diagonally."""
PHALANX_MASS = 0.002
"""kg; the published 2 mg, against a hand of 185 g, would make iterative solvers unstable."""
LEAN = 0.2
"""rad, lean of ``nao_leaning``, whose hands reach a fifth more of the table."""
LEANS = (0.2, 0.4)
"""rad, leans that an upright Nao tries for objects out of reach."""
CAMERA_MASS = 0.05
CAMERA_TILT = 0.70
"""rad; HeadPitch alone ends at 29.5 deg and would leave the table below the image."""

_DARK = (0.20, 0.21, 0.23, 1.0)
_ORANGE = (0.91, 0.43, 0.12, 1.0)
_ROLL_AND_YAW = ("Roll", "Yaw")


def head_pitch_limits(head_yaw: float) -> tuple[float, float]:
    """Return the lowest and highest HeadPitch (rad) at a HeadYaw (rad) (*Joints* page).

    Examples
    --------
    >>> low, high = head_pitch_limits(0.0)
    >>> round(high, 3)
    0.515
    """
    table = np.radians(np.array(facts.HEAD_PITCH_LIMITS_DEG))
    yaw = abs(head_yaw)
    low = float(np.interp(yaw, table[:, 0], table[:, 1]))
    high = float(np.interp(yaw, table[:, 0], table[:, 2]))
    return low, high


def describe_nao(
    *, legs: Legs = "fixed", symmetric: bool = True, lean: float = 0.0, name: str = "nao"
) -> RobotDescription:
    """Describe the NAO.

    Parameters
    ----------
    legs
        ``fixed`` welds the legs in the standing pose, which halves the time of a simulated grasp;
        ``joints`` lets them move.
    symmetric
        Mirror the left inertia tensors to the right; else use the published right ones, four of
        which differ.
    lean
        Angle (rad) by which the torso leans forward over the standing legs, by both HipPitch.
    name
        Name of the robot in the URDF.
    """
    lowest = facts.LEG_JOINTS["HipPitch"][4]
    if not 0 <= lean <= -lowest:
        raise RobotError(f"lean: {lean:g} rad; the hips allow 0 .. {-lowest:.2f}")
    if lean and legs != "fixed":
        raise RobotError("lean needs fixed legs: who moves the legs leans by them")
    links = [_torso(), _neck(), _head(), _camera()]
    joints = [_row_joint(n, row, "", 1) for n, row in facts.HEAD_JOINTS.items()]
    joints.append(
        Joint("CameraDepth3_fixed", "Head", "CameraDepth3_frame", _CAMERA_POSE, kind="fixed")
    )
    for side in (1, -1):
        links += [*_arm_links(side, symmetric), *_leg_links(side, symmetric)]
        joints += [*_arm_joints(side), *_leg_joints(side, legs, lean)]
    return RobotDescription(
        name=name,
        root="torso",
        links=tuple(links),
        joints=tuple(joints),
        arms={arm.name: arm for arm in (_arm(1), _arm(-1))},
        cameras={"CameraDepth3": _looking_level(_CAMERA, lean)},
        base_from_root=_leaning(lean),
        workplace=_within_reach(lean),
        frames=_frames(),
        model="Aldebaran NAO H25 V5",
        stances={} if lean or legs != "fixed" else _stances(),
        support=_feet(),
    )


def _looking_level(camera: CameraMount, lean: float) -> CameraMount:
    """Return the camera with head angles that compensate the lean."""
    look = {side: (yaw, pitch - lean) for side, (yaw, pitch) in camera.look.items()}
    return replace(camera, look=look)


def _within_reach(lean: float) -> Workplace:
    """Return the workplace, moved forward with the shoulders."""
    place = Workplace()
    above_hips = facts.ARM_JOINTS["ShoulderPitch"][2][2] - facts.LEG_JOINTS["HipYawPitch"][2][2]
    forward = above_hips * math.sin(lean)
    near, far = place.area_x
    return replace(
        place,
        area_x=(near + forward, far + forward),
        box_centre=(place.box_centre[0] + forward, place.box_centre[1]),
    )


def _leaning(lean: float) -> Pose:
    """Return the pose of the torso in the base frame, rotated about the hips."""
    hips = facts.LEG_JOINTS["HipYawPitch"][2][2]
    x, z = -hips * math.sin(lean), facts.TORSO_HEIGHT + hips - hips * math.cos(lean)
    return Pose((x, 0.0, z), (0.0, lean, 0.0))


def _stances() -> dict[str, Stance]:
    """Return the postures that lean forward on flat feet."""
    hips = ("LHipPitch", "RHipPitch")
    return {f"lean {a:g}": Stance(_leaning(a), dict.fromkeys(hips, -a)) for a in LEANS}


def _feet() -> tuple[tuple[float, float], ...]:
    """Return the support polygon that the force sensors of both soles span."""
    half_hip_width = facts.LEG_JOINTS["HipYawPitch"][2][1]
    front = min(facts.FORCE_SENSORS_LEFT_FOOT[name][0] for name in ("FsrFL", "FsrFR"))
    rear = max(facts.FORCE_SENSORS_LEFT_FOOT[name][0] for name in ("FsrRL", "FsrRR"))
    aside = half_hip_width + facts.FORCE_SENSORS_LEFT_FOOT["FsrFL"][1]
    return ((front, aside), (rear, aside), (rear, -aside), (front, -aside))


_CAMERA_POSE = Pose((0.028, 0.0, 0.142), (0.0, CAMERA_TILT, 0.0))
_CAMERA = CameraMount(
    "CameraDepth3",
    "CameraDepth3_frame",
    Pose(),
    look={
        "left": (0.45, 0.42),
        "right": (-0.45, 0.42),
        "ahead": (0.0, 0.50),
        "box_left": (0.70, 0.37),
        "box_right": (-0.70, 0.37),
    },
)


def _capsule(radius: float, length: float, along: str, centre: facts.Vector) -> tuple[Shape, ...]:
    """Return a cylinder closed by two spheres, along x, y or z."""
    axis = "xyz".index(along)
    rpy = {"x": (0.0, math.pi / 2, 0.0), "y": (math.pi / 2, 0.0, 0.0), "z": (0.0, 0.0, 0.0)}[along]
    ends = []
    for sign in (-1, 1):
        end = list(centre)
        end[axis] += sign * length / 2
        ends.append(Shape("sphere", (radius,), Pose((end[0], end[1], end[2]))))
    return (Shape("cylinder", (radius, length), Pose(centre, rpy)), *ends)


def _inertial(link: str, side: int = 1, symmetric: bool = True) -> Inertial:
    mass, (x, y, z), diagonal, (xy, xz, yz) = facts.MASSES[link]
    if side < 0:
        y, xy, yz = -y, -xy, -yz
        if not symmetric and link in facts.RIGHT_INERTIA:
            diagonal, (xy, xz, yz) = facts.RIGHT_INERTIA[link]
    return Inertial(mass, (x, y, z), diagonal, (xy, xz, yz))


def _torso() -> Link:
    shapes = (
        Shape("box", (0.085, 0.115, 0.15), Pose((-0.005, 0.0, 0.045))),
        *_capsule(0.045, 0.03, "y", (0.0, 0.0, 0.1)),
    )
    return Link("torso", _inertial("torso"), shapes)


def _neck() -> Link:
    shape = Shape("cylinder", (0.022, 0.03), Pose((0.0, 0.0, -0.02)))
    return Link("Neck", _inertial("Neck"), (shape,), _DARK)


def _head() -> Link:
    return Link("Head", _inertial("Head"), (Shape("sphere", (0.062,), Pose((0.0, 0.0, 0.062))),))


def _camera() -> Link:
    box = Shape("box", (0.036, 0.17, 0.024), Pose((-0.018, 0.0, 0.0)))
    inertial = Inertial(CAMERA_MASS, (-0.018, 0.0, 0.0), (1.2e-4, 1.0e-5, 1.2e-4))
    return Link("CameraDepth3_frame", inertial, (box,), _DARK)


def _named(link: str, side: int) -> str:
    """Return the published name of a left or right link."""
    if link in ("torso", "Neck", "Head"):
        return link
    if link in ("wrist", "ankle"):
        return ("l_" if side > 0 else "r_") + link
    return ("L" if side > 0 else "R") + link


def _arm_links(side: int, symmetric: bool) -> list[Link]:
    shapes = {
        "Shoulder": (Shape("sphere", (0.036,), Pose((0.0, -0.004 * side, 0.0))),),
        "Bicep": _capsule(0.026, 0.055, "x", (0.05, 0.012 * side, 0.0)),
        "Elbow": (Shape("sphere", (0.025,)),),
        "ForeArm": _capsule(0.0235, 0.030, "x", (0.028, 0.0, 0.0)),
    }
    colours = {"Shoulder": _ORANGE, "Elbow": _DARK}
    links = [
        Link(
            _named(name, side),
            _inertial(name, side, symmetric),
            parts,
            colours.get(name, (0.92, 0.92, 0.93, 1.0)),
        )
        for name, parts in shapes.items()
    ]
    return [*links, _hand(side, symmetric), *(_phalanx(name, side) for name in facts.PHALANGES)]


def _hand(side: int, symmetric: bool) -> Link:
    """Return palm and knuckles, sized by the positions of the touch sensors."""
    palm = Shape("box", (0.050, 0.050, 0.0404), Pose((0.032, 0.0, -0.0002)))
    knuckles = Shape("box", (0.041, 0.050, 0.022), Pose((0.0585, 0.0, 0.014)))
    inertial = _inertial("wrist", side, symmetric)
    mass = inertial.mass - len(facts.PHALANGES) * PHALANX_MASS
    lighter = Inertial(mass, inertial.centre, inertial.diagonal, inertial.off_diagonal)
    return Link(_named("wrist", side), lighter, (palm, knuckles))


def _phalanx(name: str, side: int) -> Link:
    inertial = Inertial(PHALANX_MASS, (0.007, 0.0, 0.0), (4e-7, 4e-7, 4e-7))
    return Link(
        _named(f"{name}_link", side),
        inertial,
        _capsule(0.0062, 0.0125, "x", (0.00625, 0.0, 0.0)),
        _DARK,
    )


def _leg_links(side: int, symmetric: bool) -> list[Link]:
    shapes: dict[str, tuple[Shape, ...]] = {
        "Pelvis": (),
        "Hip": (),
        "Thigh": (Shape("cylinder", (0.034, 0.06), Pose((0.0, 0.0, -0.05))),),
        "Tibia": (Shape("cylinder", (0.031, 0.06), Pose((0.0, 0.0, -0.05))),),
        "AnklePitch": (),
        "ankle": (Shape("box", (0.16, 0.09, 0.030), Pose((0.022, 0.0, -0.0302))),),
    }
    return [
        Link(_named(name, side), _inertial(name, side, symmetric), parts)
        for name, parts in shapes.items()
    ]


def _row_joint(
    name: str,
    row: tuple[str, str, facts.Vector, facts.Vector, float, float, float, float],
    prefix: str,
    side: int,
    kind: Literal["revolute", "fixed"] = "revolute",
) -> Joint:
    """Convert a row of the tables into a joint, mirrored for the right side."""
    parent, child, (x, y, z), (ax, ay, az), lower, upper, velocity, effort = row
    turns_over = name.endswith(_ROLL_AND_YAW)
    if side < 0:
        y = -y
        if turns_over:
            lower, upper = -upper, -lower
        elif ax or az:
            ax, az = -ax, -az
        if name == "AnklePitch":
            lower, upper = facts.RIGHT_ANKLE_PITCH_LIMITS
    mimic = ("LHipYawPitch", 1.0) if prefix == "R" and name == "HipYawPitch" else None
    return Joint(
        prefix + name,
        _named(parent, side),
        _named(child, side),
        Pose((x, y, z)),
        (ax, ay, az),
        kind,
        lower,
        upper,
        velocity,
        effort,
        mimic if kind == "revolute" else None,
    )


def _arm_joints(side: int) -> list[Joint]:
    prefix = "L" if side > 0 else "R"
    joints = [_row_joint(name, row, prefix, side) for name, row in facts.ARM_JOINTS.items()]
    for name, (parent, xyz, rpy) in facts.PHALANGES.items():
        parent_link = "wrist" if parent == "wrist" else f"{parent}_link"
        joints.append(
            Joint(
                prefix + name,
                _named(parent_link, side),
                _named(f"{name}_link", side),
                Pose(xyz, rpy),
                (0.0, 0.0, 1.0),
                "revolute",
                0.0,
                facts.PHALANX_RANGE,
                facts.PHALANX_VELOCITY,
                facts.PHALANX_EFFORT,
            )
        )
    return joints


def _leg_joints(side: int, legs: Legs, lean: float) -> list[Joint]:
    """Return the joints of a leg; a lean rotates the thigh back so that the foot stays flat."""
    prefix = "L" if side > 0 else "R"
    kind: Literal["revolute", "fixed"] = "revolute" if legs == "joints" else "fixed"
    joints = [_row_joint(name, row, prefix, side, kind) for name, row in facts.LEG_JOINTS.items()]
    if kind == "revolute":
        return joints
    leg_pose = Pose((0.0, 0.0, 0.0), (0.0, -lean, 0.0))
    return [replace(j, pose=leg_pose) if j.name.endswith("HipPitch") else j for j in joints]


def _arm(side: int) -> Arm:
    prefix, word = ("L", "left") if side > 0 else ("R", "right")
    cos, sin = math.cos(GRIPPER_TILT), math.sin(GRIPPER_TILT)
    return Arm(
        name="left_arm" if side > 0 else "right_arm",
        side=side,
        joints=tuple(prefix + name for name in facts.ARM_JOINTS),
        wrist=_named("wrist", side),
        tcp=(0.083, 0.0, -0.024),
        approach=(cos, 0.0, -sin),
        closing=(sin, 0.0, cos),
        # Aside, so that it hides nothing of its box from the head.
        home=(-0.04, 1.24 * side, 0.13 * side, -0.62 * side, 0.85 * side),
        end_effector=f"nao_{word}_hand",
        fingers=tuple(prefix + name for name in facts.PHALANGES),
        finger_range=facts.PHALANX_RANGE,
        mouth=0.050,
        max_payload=0.3,
        gripper_type="nao_hand",
        aliases=(f"{prefix}Hand",),
    )


def _frames() -> dict[str, tuple[str, Pose]]:
    frames = {n: (parent, Pose(xyz, rpy)) for n, (parent, xyz, rpy) in facts.SENSOR_FRAMES.items()}
    for prefix, side in (("L", 1), ("R", -1)):
        wrist, foot = _named("wrist", side), _named("ankle", side)
        for name, (xyz, rpy) in facts.HAND_TOUCH_FRAMES.items():
            frames[f"{prefix}{name}_frame"] = (wrist, Pose(xyz, rpy))
        for name, (x, y, z) in facts.FORCE_SENSORS_LEFT_FOOT.items():
            frames[f"{prefix}{name}_frame"] = (foot, Pose((x, y * side, z)))
        low = prefix.lower()
        frames[f"{low}_gripper"] = (wrist, Pose(facts.GRIPPER_FRAME[f"{low}_gripper"]))
        x, y, z = facts.SOLE
        frames[f"{low}_sole"] = (foot, Pose((x, y * side, z)))
    optical = Pose((0.0, 0.0, 0.0), (-math.pi / 2, 0.0, -math.pi / 2))
    frames["camera_depth_optical_frame"] = ("CameraDepth3_frame", optical)
    return frames
