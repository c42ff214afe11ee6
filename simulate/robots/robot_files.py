"""Robots described by a file of settings beside a URDF, to be edited by people.

The URDF has the links and joints; the settings (TOML) name the arms, hands and cameras, the joints
that stay still, the table, and pairs of links that may touch.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand
from rtask.errors import RobotError, UnknownRobotError
from simulate.robots.attaching import attach, gripper_of, hold_still
from simulate.robots.description import (
    Arm,
    CameraMount,
    Pose,
    RobotDescription,
    Workplace,
)
from simulate.robots.doctor.units import oversized, with_scale
from simulate.robots.jaw_shapes import with_open_mouths
from simulate.robots.other_hands import MOUNT, OtherHand, other_hand
from simulate.robots.urdf_reader import read_urdf

__all__ = [
    "bare_robot",
    "load_robot",
    "restore_settings",
    "robot_from",
    "robot_names",
    "robots_folder",
    "save_robot",
    "set_aside",
    "settings_of",
]

_ARM_FIELDS = {field.name: field for field in fields(Arm) if field.name not in ("cup", "three")}
_SIZED = ("jaw", "suction", "three")
"""Grippers that one length describes, m."""
_SIZES = {"suction_cup": "suction = RADIUS", "three_fingers": "three = OPENING"}
_PLACE_FIELDS = {field.name for field in fields(Workplace)}


def robots_folder() -> Path:
    """Return the folder of the user's robots: ``RTASK_ROBOTS``, else below ``XDG_DATA_HOME``."""
    named = os.environ.get("RTASK_ROBOTS")
    if named:
        return Path(named)
    data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(data) / "rtask" / "robots"


def robot_names() -> list[str]:
    """Return the names of the user's robots."""
    return sorted(path.stem for path in robots_folder().glob("*.toml"))


def set_aside(path: Path) -> None:
    """Move the settings of a robot to where :func:`restore_settings` finds them."""
    path.replace(path.with_suffix(".removed"))


def restore_settings(path: Path) -> None:
    """Bring the settings back that were set aside last; the present ones are set aside instead.

    Raises
    ------
    UnknownRobotError
        None were set aside.
    """
    aside = path.with_suffix(".removed")
    if not aside.exists():
        raise UnknownRobotError(
            f"no robot {path.stem!r} was removed or replaced; see `rtask robot list`"
        )
    present = path.read_bytes() if path.exists() else None
    aside.replace(path)
    # The two change places, so that a restoration can itself be taken back.
    if present is not None:
        aside.write_bytes(present)


def bare_robot(
    urdf: Path,
    *,
    name: str,
    strict: bool = False,
    gripper: str | None = None,
    on: str | None = None,
    rest: Mapping[str, float] | None = None,
    scale: float | None = None,
) -> tuple[RobotDescription, tuple[str, ...]]:
    """Return the links and joints of a URDF, welded, without arms, and the reader's warnings.

    Parameters
    ----------
    urdf
        The file.
    name
        Of the robot.
    strict
        Refuse gaps in the file instead of filling them.
    gripper
        A hand to hang on, as of :func:`~simulate.robots.attaching.gripper_of`; None = none.
    on
        Link that carries it; None = ``tool0``, else the end of the longest chain.
    rest
        Joints that stay still, and their values, rad or m.
    scale
        Factor for shapes far larger than the robot, whose file has them in another unit than m;
        None = they are kept, with a warning.
    """
    read = read_urdf(urdf, strict=strict)
    warnings = read.warnings
    try:
        if scale is not None:
            read = replace(read, links=with_scale(read.links, read.joints, scale))
        warnings = (*warnings, *map(str, oversized(read.links, read.joints)))
    except RobotError as error:
        raise RobotError(f"{urdf}: {error}") from error
    if gripper is not None:
        read, more = attach(read, gripper_of(gripper, strict), on)
        warnings = (*warnings, *more)
    made = any(link.name == MOUNT for link in read.links)
    robot = RobotDescription(
        name=name, root=read.root, links=read.links, joints=read.joints, arms={}, cameras={},
        frames={MOUNT: (MOUNT, Pose())} if made else {},
    )  # fmt: skip
    return hold_still(robot, rest or {}), warnings


def load_robot(path: Path) -> RobotDescription:
    """Return the robot of a settings file.

    Raises
    ------
    RobotError
        With the file, the key, and the problem.
    """
    try:
        settings = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: not TOML: {error}") from error
    return robot_from(settings, path)


def robot_from(settings: Mapping[str, Any], path: Path) -> RobotDescription:
    """Return the robot of settings.

    Parameters
    ----------
    settings
        As read from TOML.
    path
        Of their file, which names the robot; paths in the settings are relative to its folder.

    Raises
    ------
    RobotError
        As :func:`load_robot`.
    """
    try:
        return _robot(path, settings)
    except KeyError as error:
        raise RobotError(f"{path}: {error.args[0]} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise RobotError(f"{path}: {error}") from error


def _robot(path: Path, settings: Mapping[str, Any]) -> RobotDescription:
    urdf = (path.parent / str(settings["urdf"])).resolve()
    gripper = settings.get("gripper", {})
    text = _gripper_from(path, gripper)
    robot, _ = bare_robot(
        urdf,
        name=path.stem,
        strict=bool(settings.get("strict", False)),
        gripper=text,
        on=gripper.get("on"),
        rest=settings.get("rest", {}),
        scale=settings.get("scale"),
    )
    cup = other_hand(text) if text is not None else None
    arms = {name: _arm(path, name, table, cup) for name, table in settings["arms"].items()}
    cameras = {n: _camera(path, n, t) for n, t in settings.get("cameras", {}).items()}
    made = replace(
        robot,
        arms=arms,
        cameras=cameras,
        model=str(settings.get("model", "")),
        base_frame=str(settings.get("base_frame", robot.root)),
        base_from_root=_pose(settings.get("base", {})),
        workplace=_workplace(path, settings["workplace"]),
        may_touch=tuple((str(a), str(b)) for a, b in settings.get("may_touch", [])),
    )
    _check(path, made)
    return with_open_mouths(made)


def _gripper_from(path: Path, table: Mapping[str, Any]) -> str | None:
    for kind in _SIZED:
        if kind in table:
            return f"{kind}:{float(table[kind]):g}"
    for kind in ("urdf", "file"):
        if kind in table:
            return str((path.parent / str(table[kind])).resolve())
    return None


def _arm(path: Path, name: str, table: Mapping[str, Any], hand: OtherHand | None) -> Arm:
    _check_keys(path, f"arms.{name}", table, _ARM_FIELDS)
    arm = Arm(**{"name": name, **{key: _frozen(value) for key, value in table.items()}})
    if arm.grip == "suction_cup" and isinstance(hand, SuctionCup):
        return replace(arm, cup=hand)
    if arm.grip == "three_fingers" and isinstance(hand, ThreeFingerHand):
        return replace(arm, three=hand)
    if arm.grip in _SIZES:
        raise RobotError(
            f"{path}: arms.{name}: a {arm.grip} needs its size: {_SIZES[arm.grip]} (m), or file = "
            f"FILE, under [gripper]"
        )
    return arm


def _camera(path: Path, name: str, table: Mapping[str, Any]) -> CameraMount:
    fields = {"parent", "xyz", "rpy", "frame_id", "size", "horizontal_fov", "depth_range", "look"}
    _check_keys(path, f"cameras.{name}", table, fields)
    rest = {k: _frozen(v) for k, v in table.items() if k not in ("parent", "xyz", "rpy", "look")}
    look = {side: tuple(values) for side, values in table.get("look", {}).items()}
    return CameraMount(name, str(table["parent"]), _pose(table), look=look, **rest)


def _workplace(path: Path, table: Mapping[str, Any]) -> Workplace:
    _check_keys(path, "workplace", table, _PLACE_FIELDS)
    return Workplace(**{key: _frozen(value) for key, value in table.items()})


def _pose(table: Mapping[str, Any]) -> Pose:
    x, y, z = (float(v) for v in table.get("xyz", (0, 0, 0)))
    roll, pitch, yaw = (float(v) for v in table.get("rpy", (0, 0, 0)))
    return Pose((x, y, z), (roll, pitch, yaw))


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _check_keys(path: Path, where: str, table: Mapping[str, Any], allowed: Iterable[str]) -> None:
    for key in table:
        if key not in allowed:
            raise RobotError(f"{path}: {where} has no {key!r}; it has {', '.join(sorted(allowed))}")


def _check(path: Path, robot: RobotDescription) -> None:
    """Refuse settings that name links or joints which the URDF does not have."""
    try:
        for arm in robot.arms.values():
            robot.link(arm.wrist)
            for name in (*arm.joints, *arm.fingers):
                robot.joint(name)
            if len(arm.home) != len(arm.joints):
                raise RobotError(f"arm {arm.name!r}: home has not one value for each joint")
            for ends in (arm.finger_closed, arm.finger_open):
                if ends and len(ends) != len(arm.fingers):
                    raise RobotError(f"arm {arm.name!r}: fingers and their ends differ in number")
            # A joint of the way that no list names would be planned as still, and move in the
            # physics.
            chain = [j.name for j in robot.path(arm.wrist)]
            if chain != list(arm.joints):
                raise RobotError(
                    f"arm {arm.name!r}: joints must be those from the root to {arm.wrist!r}, "
                    f"{', '.join(chain)}; others that move stay still under [rest]"
                )
        for mount in robot.cameras.values():
            robot.link(mount.parent)
    except RobotError as error:
        raise RobotError(f"{path}: {error}") from error


def settings_of(
    robot: RobotDescription,
    urdf: Path,
    *,
    gripper: str | None = None,
    on: str | None = None,
    rest: Mapping[str, float] | None = None,
    strict: bool = False,
    scale: float | None = None,
) -> dict[str, Any]:
    """Return the settings from which :func:`load_robot` makes the same robot."""
    held: dict[str, Any] = {}
    if gripper is not None:
        kind, _, size = gripper.partition(":")
        described = "urdf" if gripper.lower().endswith(".urdf") else "file"
        held = {kind: float(size)} if kind in _SIZED else {described: str(Path(gripper).resolve())}
        held |= {"on": on} if on else {}
    return {
        "urdf": str(urdf.resolve()),
        "model": robot.model,
        "base_frame": robot.base_frame,
        "strict": strict,
        **({} if scale is None else {"scale": scale}),
        "may_touch": [list(pair) for pair in robot.may_touch],
        "base": _pose_table(robot.base_from_root),
        **({"gripper": held} if held else {}),
        **({"rest": dict(rest)} if rest else {}),
        "arms": {name: _arm_table(arm) for name, arm in robot.arms.items()},
        "cameras": {name: _camera_table(mount) for name, mount in robot.cameras.items()},
        "workplace": {key: _plain(getattr(robot.workplace, key)) for key in sorted(_PLACE_FIELDS)},
    }


def _arm_table(arm: Arm) -> dict[str, Any]:
    return {key: _plain(getattr(arm, key)) for key in _ARM_FIELDS if key != "name"}


def _camera_table(mount: CameraMount) -> dict[str, Any]:
    return {
        "parent": mount.parent,
        **_pose_table(mount.pose),
        "frame_id": mount.frame_id,
        "size": list(mount.size),
        "horizontal_fov": mount.horizontal_fov,
        "depth_range": list(mount.depth_range),
        "look": {side: list(values) for side, values in mount.look.items()},
    }


def _pose_table(pose: Pose) -> dict[str, Any]:
    return {"xyz": [round(v, 9) for v in pose.xyz], "rpy": [round(v, 9) for v in pose.rpy]}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return round(value, 9) if isinstance(value, float | np.floating) else value


def save_robot(settings: Mapping[str, Any], guessed: Iterable[str], path: Path) -> None:
    """Write the settings of a robot, wholly or not at all.

    Parameters
    ----------
    settings
        From :func:`settings_of`.
    guessed
        Keys such as ``arms.arm.mouth`` whose lines get the comment "guessed".
    path
        The file; its folder is made.
    """
    import tomlkit

    marked = set(guessed)
    document = tomlkit.document()

    def fill(table: Any, values: Mapping[str, Any], where: str) -> None:
        for key, value in values.items():
            if isinstance(value, Mapping):
                inner = tomlkit.table()
                fill(inner, value, f"{where}{key}.")
                table.add(key, inner)
                continue
            item = tomlkit.item(value)
            # People edit the file: they see which numbers nobody measured.
            if f"{where}{key}" in marked:
                item.comment("guessed")
            table.add(key, item)

    fill(document, settings, "")
    path.parent.mkdir(parents=True, exist_ok=True)
    # Replaced at once: a robot that is being added must never leave half a file where one was.
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(tomlkit.dumps(document), encoding="utf-8")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
