"""Grippers as data: from a short name, a file of their dimensions, or a robot's URDF."""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.gripper import ParallelGripper, nao_hand, panda_hand, parallel_jaw
from grasp.spatial.gripper_urdf import gripper_from_urdf
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand

__all__ = [
    "OtherHand",
    "end_effector_from_data",
    "end_effector_named",
    "end_effector_to_data",
    "gripper_from_data",
    "gripper_named",
    "gripper_to_data",
    "read_end_effector",
    "read_gripper",
]

OtherHand = SuctionCup | ThreeFingerHand
"""Hands that are no jaws."""

_ENDINGS = (".json", ".toml", ".urdf")
_MAX_BYTES = 1_000_000
_PAIRS = {"approach": 2, "retreat": 2, "palm": 3, "wrist": 3}
_LENGTHS = ("approach", "retreat", "palm", "wrist", "finger_thickness", "stem_radius")
_TEXTS = ("name", "gripper_type", "joint")
_OPTIONAL = (
    "palm", "wrist", "finger_thickness", "parent_from_gripper", "compliance", "stem_radius",
)  # fmt: skip
_KINDS = {
    "parallel": (ParallelGripper, "a gripper"),
    "suction": (SuctionCup, "a suction cup"),
    "three-finger": (ThreeFingerHand, "a three-finger hand"),
}
_NAMED = {"nao": nao_hand, "panda": panda_hand}


def end_effector_named(text: str) -> ParallelGripper | SuctionCup | ThreeFingerHand:
    """Return the gripper, suction cup or three-finger hand of a short text.

    Parameters
    ----------
    text
        As for :func:`gripper_named`, or ``suction:RADIUS`` or ``three:OPENING`` (m); a file may
        describe any.

    Raises
    ------
    ValueError
        Naming what is possible.

    Examples
    --------
    >>> end_effector_named("suction:0.02").radius
    0.02
    """
    if Path(text).suffix.lower() in _ENDINGS:
        return read_end_effector(Path(text))
    kind, _, size = text.partition(":")
    if kind == "jaw" or text in _NAMED:
        return gripper_named(text)
    if kind not in ("suction", "three"):
        raise ValueError(f"{_unknown(text)}, suction:RADIUS or three:OPENING in m")
    try:
        if kind == "suction":
            return SuctionCup("suction_cup", radius=float(size))
        return ThreeFingerHand("three_finger_hand", max_opening=float(size))
    except ValueError as error:
        expected = "a radius in m, as in suction:0.015" if kind == "suction" else (
            "an opening in m, as in three:0.1"
        )  # fmt: skip
        raise ValueError(f"gripper {text!r}: expected {expected}") from error


def gripper_named(text: str) -> ParallelGripper:
    """Return the gripper of a short text.

    Parameters
    ----------
    text
        ``nao``, ``panda``, ``jaw:STROKE`` (m), or a file that :func:`read_gripper` reads.

    Raises
    ------
    ValueError
        Naming what is possible.

    Examples
    --------
    >>> gripper_named("jaw:0.06").max_opening
    0.06
    """
    if Path(text).suffix.lower() in _ENDINGS:
        return read_gripper(Path(text))
    kind, _, stroke = text.partition(":")
    if kind == "jaw":
        try:
            return parallel_jaw(float(stroke))
        except ValueError as error:
            raise ValueError(f"gripper {text!r}: expected a stroke in m, as in jaw:0.08") from error
    if kind in ("suction", "three"):
        raise ValueError(f"gripper {text!r}: two jaws are wanted here: nao, panda or jaw:STROKE")
    if text not in _NAMED:
        raise ValueError(_unknown(text))
    return _NAMED[text]()


def _unknown(text: str) -> str:
    return (
        f"unknown gripper {text!r}: {', '.join(_NAMED)}, a file ({', '.join(_ENDINGS)}), "
        "jaw:STROKE with a stroke in m"
    )


def read_gripper(path: Path) -> ParallelGripper:
    """Return the gripper with two jaws that a file describes; see :func:`read_end_effector`.

    Raises
    ------
    ValueError
        As there; or the file describes another kind.
    OSError
        The file cannot be read.
    """
    end_effector = read_end_effector(path)
    if not isinstance(end_effector, ParallelGripper):
        what = "a suction cup" if isinstance(end_effector, SuctionCup) else "a three-finger hand"
        raise ValueError(f"{path.name} describes {what}; two jaws are needed here")
    return end_effector


def read_end_effector(path: Path) -> ParallelGripper | SuctionCup | ThreeFingerHand:
    """Return the end effector that a file describes.

    Parameters
    ----------
    path
        JSON or TOML with the fields of :class:`~grasp.spatial.gripper.ParallelGripper` (``name``
        and ``max_opening`` at least) or, with ``kind = "suction"``, those of
        :class:`~grasp.spatial.suction_cup.SuctionCup` (``name`` at least) or, with ``kind =
        "three-finger"``, of :class:`~grasp.spatial.three_finger.hand.ThreeFingerHand` (``name`` and
        ``max_opening``), lengths in m, forces in N, pressures in Pa; or a URDF with two fingers
        that slide towards each other.

    Raises
    ------
    ValueError
        The file is none of these, or a field is unknown or of the wrong kind.
    OSError
        The file cannot be read.
    """
    ending = path.suffix.lower()
    if ending == ".urdf":
        return gripper_from_urdf(path)
    if ending not in _ENDINGS:
        raise ValueError(f"{path.name}: a gripper's file ends in {', '.join(_ENDINGS)}")
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path.name} is larger than {_MAX_BYTES // 1_000_000} MB")
    try:
        text = path.read_text("utf-8")
        data = json.loads(text) if ending == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # the decoders' errors are ValueErrors
        raise ValueError(f"{path.name} is no {ending[1:].upper()}: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path.name}: expected an object with the fields of a gripper")
    try:
        return end_effector_from_data(data)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error


def end_effector_from_data(
    data: Mapping[str, Any],
) -> ParallelGripper | SuctionCup | ThreeFingerHand:
    """Return the end effector of the fields of a file.

    ``kind`` is ``parallel`` (the default), ``suction`` or ``three-finger``.

    Examples
    --------
    >>> end_effector_from_data({"kind": "suction", "name": "vac", "radius": 0.01}).radius
    0.01
    """
    kind = data.get("kind", "parallel")
    if kind not in _KINDS:
        raise ValueError(f"kind: expected {', '.join(_KINDS)}, got {kind!r}")
    rest = {name: value for name, value in data.items() if name != "kind"}
    if kind == "parallel":
        return gripper_from_data(rest)
    made, what = _KINDS[kind]
    end_effector: SuctionCup | ThreeFingerHand = made(**_values(made, rest, what))
    return end_effector


def gripper_from_data(data: Mapping[str, Any]) -> ParallelGripper:
    """Return the gripper of the fields of a file.

    Examples
    --------
    >>> gripper_from_data({"name": "wide", "max_opening": 0.14, "max_force": 60}).max_force
    60.0
    """
    given = {"gripper_type": data.get("name"), "min_opening": 0.0, **data}
    return ParallelGripper(**_values(ParallelGripper, given, "a gripper"))


def _values(kind: type, given: Mapping[str, Any], what: str) -> dict[str, Any]:
    """Return the checked fields of a dataclass."""
    declared = {declaration.name: declaration for declaration in fields(kind)}
    for name in given:
        if name not in declared:
            close = difflib.get_close_matches(name, declared, 1)
            hint = f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(declared)}"
            raise ValueError(f"unknown field {name!r} of {what}{hint}")
    for name, declaration in declared.items():
        needed = declaration.default is MISSING and declaration.default_factory is MISSING
        if needed and given.get(name) is None:
            raise ValueError(f"{name} is missing")
    return {name: _value(name, value) for name, value in given.items()}


def gripper_to_data(gripper: ParallelGripper) -> dict[str, Any]:
    """Return the fields of a gripper as JSON data, which :func:`gripper_from_data` reads.

    >>> gripper_from_data(gripper_to_data(panda_hand())) == panda_hand()
    True
    """
    return _to_data(gripper)


def _to_data(gripper: ParallelGripper | OtherHand) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for item in fields(gripper):
        value = getattr(gripper, item.name)
        if value is not None and not (isinstance(value, str) and not value):
            data[item.name] = np.asarray(value).tolist() if item.name in _NESTED else value
    return data


def end_effector_to_data(hand: ParallelGripper | OtherHand) -> dict[str, Any]:
    """Return the fields of an end effector, which :func:`end_effector_from_data` reads.

    >>> cup = end_effector_named("suction:0.02")
    >>> end_effector_from_data(end_effector_to_data(cup)) == cup
    True
    """
    kind = next(name for name, (made, _) in _KINDS.items() if isinstance(hand, made))
    return {"kind": kind, **_to_data(hand)}


_NESTED = (*_PAIRS, "parent_from_gripper", "joints", "joint_table")


def _value(name: str, value: Any) -> Any:
    """Return the value of a field as the gripper takes it."""
    if value is None and name in _OPTIONAL:
        return None
    if name in _TEXTS:
        if not isinstance(value, str) or not value:
            raise ValueError(f"{name}: expected a text, got {value!r}")
        return value
    if name == "symmetric":
        if not isinstance(value, bool):
            raise ValueError(f"symmetric: expected true or false, got {value!r}")
        return value
    if name == "joints":
        if not (isinstance(value, list) and all(isinstance(entry, str) for entry in value)):
            raise ValueError(f"joints: expected a list of names, got {value!r}")
        return tuple(value)
    if name == "parent_from_gripper":
        return _rigid(name, value)
    if name == "joint_table":
        rows = len(value) if isinstance(value, list) else 0
        return tuple((float(a), float(b)) for a, b in _numbers(name, value, (rows, 2)))
    shape = (_PAIRS[name],) if name in _PAIRS else ()
    numbers = _numbers(name, value, shape)
    if name in _LENGTHS and np.any(numbers < 0):
        raise ValueError(f"{name}: expected lengths of at least 0 m, got {value!r}")
    return tuple(float(v) for v in numbers) if shape else float(numbers)


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return finite numbers of just that shape; () is a single one."""
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.full((), np.nan)
    # numpy would read "0.1" and true as numbers, which nobody means.
    if isinstance(value, bool | str) or numbers.shape != shape or not np.isfinite(numbers).all():
        expected = "a number" if not shape else f"numbers of shape {shape}"
        raise ValueError(f"{name}: expected {expected}, got {value!r}")
    return numbers


def _rigid(name: str, value: Any) -> NDArray[np.float64]:
    """Return a transform (4, 4) without scale or mirror.

    Within a thousandth: files keep some digits of a rotation.
    """
    numbers = _numbers(name, value, (4, 4))
    turn = numbers[:3, :3]
    is_rotation = np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) and np.linalg.det(turn) > 0
    if not (is_rotation and np.array_equal(numbers[3], [0, 0, 0, 1])):
        raise ValueError(f"{name}: expected a rigid transform, got {value!r}")
    return numbers
