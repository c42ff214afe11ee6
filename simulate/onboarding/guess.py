"""A robot from a URDF: everything that the file does not say is guessed, and marked as guessed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rtask.errors import RobotError
from simulate.motion.collision import link_poses
from simulate.onboarding.arms import arm_from
from simulate.onboarding.closing import points_of
from simulate.onboarding.hands import (
    MIN_ARM_JOINTS,
    arm_ends,
    find_hands,
    hand_between,
    mounted_hand,
    shapeless_fingers,
)
from simulate.onboarding.measured_hand import MeasuredHand
from simulate.onboarding.touching import SelfContacts, without_contacts
from simulate.onboarding.workplace import home_postures, place_robot
from simulate.robots.description import (
    Arm,
    CameraMount,
    Floats,
    Joint,
    Pose,
    RobotDescription,
)
from simulate.robots.doctor.units import oversized
from simulate.robots.jaw_shapes import with_open_mouths
from simulate.robots.other_hands import MOUNT, OtherHand, arm_with, other_hand
from simulate.robots.robot_files import bare_robot, robot_from, settings_of
from simulate.robots.srdf import Srdf, read_srdf
from simulate.robots.urdf_reader import read_urdf

__all__ = ["GuessedRobot", "NoHandError", "guess_robot"]

_OPTICAL = "optical_frame"
_MOUNT_FROM_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_MAX_HOMES = 24


@dataclass(frozen=True)
class GuessedRobot:
    """A robot made from a URDF.

    Parameters
    ----------
    robot
        Its description.
    settings
        For :func:`simulate.robots.robot_files.save_robot`.
    guessed
        Keys of the settings that the file does not state.
    warnings
        What the URDF lacks and what was taken instead, one sentence each.
    share
        Share of the table in reach, 0..1.
    limits
        What the robot cannot do for want of joints or fingers, one sentence each.
    """

    robot: RobotDescription
    settings: Mapping[str, Any]
    guessed: tuple[str, ...]
    warnings: tuple[str, ...]
    share: float
    limits: tuple[str, ...] = ()


def guess_robot(
    urdf: Path,
    name: str,
    *,
    gripper: str | None = None,
    on: str | None = None,
    jaws: tuple[str, str] | None = None,
    srdf: Path | None = None,
    strict: bool = False,
    scale: float | None = None,
    seed: int = 0,
) -> GuessedRobot:
    """Return the robot of a URDF, with arms, hands, cameras and a workplace.

    Parameters
    ----------
    urdf
        The file.
    name
        Of the robot.
    gripper, on, strict, scale
        As of :func:`~simulate.robots.robot_files.bare_robot`.
    jaws
        Two links that close on each other, where no hand would be found; None = hands are found.
    srdf
        A semantic description: its home postures are tried first, and the links whose collisions
        it disables may touch; None = home and overlaps are guessed.
    seed
        Of the postures tried.

    Raises
    ------
    NoHandError
        It shows an arm, but no hand.
    RobotError
        The file cannot be read, its shapes are far larger than the robot, or it shows no arm; the
        message says what to do.
    """
    semantic = read_srdf(srdf) if srdf is not None else Srdf({}, ())
    read = partial(bare_robot, urdf, name=name, strict=strict, gripper=gripper, on=on, scale=scale)
    whole, warnings = read()
    large = oversized(whole.links, whole.joints)
    if large:
        raise RobotError(f"{urdf}: {large[0]}" + f" (and {len(large) - 1} more)" * (len(large) > 1))
    other = other_hand(gripper) if gripper is not None else None
    hands = _hands(whole, other, jaws)
    if not hands:
        raise _no_hand(whole, urdf, warnings)
    # What no arm uses is held still at rest, so the model is read twice: the first look says what
    # to hold.
    folded = {name: value for hand in hands for name, value in hand.rest.items()}
    rest = {joint.name: _neutral(joint) for joint in _unused(whole, hands)} | folded
    robot, _ = read(rest=rest)
    mounted = _hands(robot, other, jaws)
    if not mounted:
        raise _no_hand(robot, urdf, warnings)
    robot = replace(robot, base_from_root=_standing(robot), cameras=_own_cameras(urdf, robot))
    arms = dict(_arms(robot, mounted, other))
    robot = with_open_mouths(replace(robot, arms=arms, model=whole.name))
    try:
        placed = place_robot(robot, seed)
        robot = without_contacts(placed.robot, seed)
        allowed = {pair for pair in semantic.may_touch if _are_links(robot, pair)}
        robot = replace(robot, may_touch=tuple(sorted({*robot.may_touch, *allowed})))
        robot = _at_home(robot, semantic.homes, seed)
    except RobotError as error:
        # What was doubted of the file is likelier the cause than the arm.
        raise RobotError(f"{error}{_doubts(warnings)}") from error
    settings = settings_of(
        robot, urdf, gripper=gripper, on=on, rest=rest, strict=strict, scale=scale
    )
    made = robot_from(settings, Path(f"{name}.toml").resolve())
    limits = tuple(_limits(made, hands))
    return GuessedRobot(made, settings, tuple(_guessed(settings)), warnings, placed.share, limits)


def _doubts(warnings: Sequence[str]) -> str:
    """Return what was said of a file, as an end of an error's sentence."""
    if not warnings:
        return ""
    more = f" (and {len(warnings) - 1} more)" if len(warnings) > 1 else ""
    return f"; of the file: {warnings[0]}{more}"


def _limits(robot: RobotDescription, hands: Sequence[MeasuredHand]) -> Iterator[str]:
    """Yield what the arms and hands of a robot cannot do."""
    for arm in robot.arms.values():
        count = len(arm.joints)
        if count < 5:
            yield (
                f"{arm.name} has {count} joints: the hand points where they leave it, and does not "
                f"choose its closing direction; long objects are grasped only as they happen to lie"
            )
        elif count == 5:
            yield f"{arm.name} has 5 joints: the hand comes from above, not at every angle"
        if arm.has_single_jaw:
            yield f"{arm.name}: a single jaw moves, and draws what it takes to the other"
    for hand in hands:
        if hand.rest:
            held = ", ".join(sorted(hand.rest))
            yield f"{hand.wrist} grasps with one pair of fingers; held still: {held}"


class NoHandError(RobotError):
    """An arm was found and no hand; ``links`` are those that could be its jaws."""

    def __init__(self, message: str, links: Sequence[str]) -> None:
        super().__init__(message)
        self.links = tuple(links)


def _no_hand(robot: RobotDescription, urdf: Path, warnings: Sequence[str]) -> RobotError:
    ends = arm_ends(robot)
    if not ends:
        alone = [hand.wrist for hand in find_hands(robot)]
        hint = f": {alone[0]!r} is a gripper of its own, for --gripper {urdf}" if alone else ""
        return RobotError(f"{urdf}: no arm: no chain of three or more moving joints{hint}")
    triple = [hand.wrist for hand in find_hands(robot) if hand.is_triple]
    links = [link.name for link in robot.links if len(robot.path(link.name)) >= MIN_ARM_JOINTS]
    if triple:
        return NoHandError(
            f"{urdf}: {triple[0]!r} carries three equal fingers that close about an axis, which "
            f"are no pair of jaws: --jaws LINK LINK grasps with two of them, --gripper three:0.1 "
            f"hangs on plain ones",
            links,
        )
    bare = shapeless_fingers(robot)
    if bare:
        gaps = [w for w in warnings if any(w.startswith(f"link {name!r} ") for name in bare)]
        return RobotError(
            f"{urdf}: no hand: {', '.join(bare)} may be fingers, but without collision shapes "
            f"nothing tells where they meet ({gaps[-1] if gaps else 'the file gives them none'})"
        )
    return NoHandError(
        f"{urdf}: no hand: no link behind three moving joints carries fingers that open; name both "
        f"jaws with --jaws LINK LINK, or give a hand with --gripper FILE or --gripper jaw:0.085 "
        f"(arms end at {', '.join(ends[:4])})",
        links,
    )


def _hands(
    robot: RobotDescription, other: OtherHand | None, jaws: tuple[str, str] | None
) -> list[MeasuredHand]:
    """Return the hands to use: the one that was hung on if it is none of jaws, else those found."""
    if jaws is not None:
        hand = hand_between(robot, jaws)
        if len(hand.joints) < MIN_ARM_JOINTS:
            raise RobotError(f"--jaws: {hand.wrist!r} has no arm of three or more moving joints")
        return [hand]
    if other is None:
        hands = find_hands(robot)
        return _chosen([h for h in hands if len(h.joints) >= MIN_ARM_JOINTS and not h.is_triple])
    wrist, _ = robot.frames[MOUNT]
    hand_made = mounted_hand(robot, wrist)
    return [hand_made] if hand_made is not None else []


def _chosen(hands: Sequence[MeasuredHand]) -> list[MeasuredHand]:
    """Return the hand with the most joints behind it, and another if it has an arm of its own."""
    ordered = sorted(hands, key=lambda hand: -len(hand.joints))
    for other in ordered[1:]:
        shared = {j.name for j in ordered[0].joints} & {j.name for j in other.joints}
        # Two hands on one arm, as of a tool changer, share nearly all joints: they are no second
        # arm.
        if min(len(ordered[0].joints), len(other.joints)) - len(shared) >= 3:
            return [ordered[0], other]
    return ordered[:1]


def _unused(robot: RobotDescription, hands: Sequence[MeasuredHand]) -> list[Joint]:
    """Return the joints that no arm or hand moves: bases, torsos, heads, legs, other hands."""
    chains = [{joint.name for joint in hand.joints} for hand in hands]
    shared = set.intersection(*chains) if len(chains) > 1 else set()
    # What both arms share, such as a torso, would move the one while the other works.
    used = set.union(*chains) - shared | {j.name for hand in hands for j in hand.fingers}
    return [joint for joint in robot.joints if joint.name not in used]


def _neutral(joint: Joint) -> float:
    return 0.0 if joint.lower <= 0.0 <= joint.upper else round((joint.lower + joint.upper) / 2, 6)


def _standing(robot: RobotDescription) -> Pose:
    """Return the pose of the root at which the lowest point of its shapes is on the floor."""
    middle = {joint.name: _neutral(joint) for joint in robot.joints}
    poses = {robot.root: np.eye(4), **link_poses(robot.root, robot.joints, middle)}
    moved = {joint.child for joint in robot.joints}
    still = [link.name for link in robot.links if link.name not in moved]
    clouds = [points_of(robot, name, poses[name]) for name in still]
    lowest = min((float(c[:, 2].min()) for c in clouds if len(c)), default=0.0)
    return Pose((0.0, 0.0, round(max(-lowest, 0.0), 6)))


def _arms(
    robot: RobotDescription, hands: Sequence[MeasuredHand], other: OtherHand | None
) -> Iterator[tuple[str, Arm]]:
    """Yield the arms by name: ``arm``, or ``left_arm`` and ``right_arm``."""
    two = len(hands) == 2
    # y points to the left of a robot (REP 103), whatever its links are called.
    ordered = sorted(hands, key=lambda hand: -_shoulder_y(robot, hand))
    for hand, side in zip(ordered, (1, -1) if two else (0,), strict=True):
        name = {1: "left_arm", -1: "right_arm", 0: "arm"}[side]
        middle = np.array([(joint.lower + joint.upper) / 2 for joint in hand.joints])
        if other is None:
            yield name, arm_from(hand, name, side, hand.joints, middle)
        else:
            yield name, _arm_to(robot, hand, name, middle, other)


def _arm_to(
    robot: RobotDescription, hand: MeasuredHand, name: str, middle: Floats, other: OtherHand
) -> Arm:
    """Return the arm that carries a suction cup or a hand with three fingers."""
    bare = Arm(
        name=name, side=0, joints=tuple(joint.name for joint in hand.joints), wrist=hand.wrist,
        tcp=hand.tcp, approach=hand.approach, closing=hand.closing,
        home=tuple(round(float(v), 4) for v in middle), end_effector=other.name, fingers=(),
        finger_range=1.0, mouth=0.0, max_payload=0.0,
    )  # fmt: skip
    return arm_with(bare, other, robot.frames[MOUNT][1].matrix)


def _shoulder_y(robot: RobotDescription, hand: MeasuredHand) -> float:
    poses = link_poses(robot.root, robot.joints, {})
    return float(poses[hand.joints[0].child][1, 3])


def _own_cameras(urdf: Path, robot: RobotDescription) -> dict[str, CameraMount]:
    """Return the cameras of the file's optical frames that are fixed to the root."""
    try:
        read = read_urdf(urdf, strict=False)
    except RobotError:
        return {}
    names = [link.name for link in read.links if link.name.endswith(_OPTICAL)]
    tree = RobotDescription(
        name=read.name, root=read.root, links=read.links, joints=read.joints, arms={}, cameras={}
    )
    mounts = {}
    # Grasps are planned on depth: of a camera with several frames its depth frame comes first.
    for frame in sorted(names, key=lambda name: ("depth" not in name, name)):
        path = tree.path(frame)
        if any(joint.kind != "fixed" for joint in path):
            continue
        optical = link_poses(read.root, path, {})[frame]
        pose = Pose.of(optical @ np.linalg.inv(_MOUNT_FROM_OPTICAL))
        name = frame.removesuffix(f"_{_OPTICAL}")
        look: dict[str, tuple[float, ...]] = {"left": (), "right": (), "ahead": ()}
        mounts[name] = CameraMount(name, robot.root, pose, frame, look=look)
    return mounts


def _are_links(robot: RobotDescription, pair: tuple[str, str]) -> bool:
    """Tell whether both names are still links; those on fixed joints are part of their parents."""
    return set(pair) <= {link.name for link in robot.links}


def _at_home(robot: RobotDescription, stated: Mapping[str, float], seed: int) -> RobotDescription:
    """Return the robot with every arm at home beside the table, touching nothing.

    Raises
    ------
    RobotError
        An arm has no such posture among those tried.
    """
    homes: dict[str, Floats] = {}
    with SelfContacts(robot) as contacts:
        for arm in robot.arms.values():
            tried = 0
            # A posture that the maker states is tried before any that is sought.
            first = [[stated[j] for j in arm.joints]] if set(arm.joints) <= set(stated) else []
            postures = itertools.chain(
                map(np.array, first), home_postures(_alone(robot, arm, homes), arm, seed)
            )
            for posture in postures:
                tried += 1
                if not contacts.touching({**homes, arm.name: posture}):
                    homes[arm.name] = posture
                    break
                if tried >= _MAX_HOMES:
                    break
            if arm.name not in homes:
                raise RobotError(
                    f"{robot.name}: no posture of {arm.name!r} beside the table, hand down, is "
                    f"free of collisions ({tried} tried); the arm may not reach down at all"
                )
    arms = {
        name: replace(arm, home=tuple(round(float(v), 4) for v in homes[name]))
        for name, arm in robot.arms.items()
    }
    return replace(robot, arms=arms)


def _alone(robot: RobotDescription, arm: Arm, homes: Mapping[str, Floats]) -> RobotDescription:
    """Return the robot with the arms at home that have one, and without the others' shapes."""
    waiting = [
        other_arm
        for other_arm in robot.arms.values()
        if other_arm is not arm and other_arm.name not in homes
    ]
    moving = {name for other_arm in waiting for name in (*other_arm.joints, *other_arm.fingers)}
    # Where the arms that wait will be is not known yet: they must not block the one that is placed.
    bare = {joint.child for joint in robot.joints if joint.name in moving}
    arms = {
        name: replace(other_arm, home=tuple(float(v) for v in homes[name]))
        if name in homes
        else other_arm
        for name, other_arm in robot.arms.items()
    }
    links = tuple(replace(link, shapes=()) if link.name in bare else link for link in robot.links)
    return replace(robot, arms=arms, links=links)


_STATED = {"urdf", "strict", "scale", "model", "base_frame", "gripper", "name"}


def _guessed(settings: Mapping[str, Any], where: str = "") -> Iterator[str]:
    """Yield the keys of everything that the user did not state."""
    for key, value in settings.items():
        if not where and key in _STATED:
            continue
        if isinstance(value, Mapping):
            yield from _guessed(value, f"{where}{key}.")
        elif not (where.startswith("arms.") and key in ("joints", "fingers", "wrist")):
            yield f"{where}{key}"
