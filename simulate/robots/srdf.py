"""Semantic robot descriptions (SRDF), as MoveIt reads them (Gatto 2016, 4.2).

Groups and hands, the home posture, and the pairs of links whose contact means nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from rtask.errors import RobotError
from simulate.robots.description import RobotDescription

__all__ = ["Srdf", "read_srdf", "srdf_text"]

_HOMES = ("home", "ready", "default")


@dataclass(frozen=True)
class Srdf:
    """Semantic description of a robot, from an SRDF file.

    Parameters
    ----------
    homes
        Value of each joint, rad or m, in the states called home, ready or default.
    may_touch
        Pairs of links whose collisions are disabled.
    """

    homes: dict[str, float]
    may_touch: tuple[tuple[str, str], ...]


def read_srdf(path: Path) -> Srdf:
    """Read an SRDF.

    Raises
    ------
    RobotError
        With the file and the problem.
    """
    try:
        tree = ET.parse(path).getroot()
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}") from error
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: of its encoding
        raise RobotError(f"{path}: not XML: {error}") from error
    if tree.tag != "robot":
        raise RobotError(f"{path}: expected <robot>, found <{tree.tag}>")
    homes: dict[str, float] = {}
    for home_name in reversed(_HOMES):
        for state in tree.findall("group_state"):
            if state.get("name") == home_name:
                homes |= dict(_values(path, state))
    pairs = (
        (element.get("link1", ""), element.get("link2", ""))
        for element in tree.findall("disable_collisions")
    )
    return Srdf(homes, tuple(sorted({(min(pair), max(pair)) for pair in pairs})))


def _values(path: Path, state: ET.Element) -> Iterator[tuple[str, float]]:
    for joint in state.findall("joint"):
        name, text = joint.get("name", ""), joint.get("value", "")
        try:
            yield name, float(text.split()[0])
        except (ValueError, IndexError):
            raise RobotError(
                f"{path}: state {state.get('name')!r}, joint {name!r}: {text!r} is not a number"
            ) from None


def srdf_text(robot: RobotDescription) -> str:
    """Return the SRDF of a robot.

    Examples
    --------
    >>> from simulate.robots.nao import describe_nao
    >>> srdf_text(describe_nao()).splitlines()[1]
    '<robot name="nao">'
    """
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    for arm in robot.arms.values():
        group, hand = quoteattr(arm.name), quoteattr(f"{arm.name}_hand")
        lines.append(f"  <group name={group}>")
        lines += [f"    <joint name={quoteattr(name)}/>" for name in arm.joints]
        lines += ["  </group>", f"  <group name={hand}>"]
        lines += [f"    <joint name={quoteattr(name)}/>" for name in arm.fingers]
        lines.append("  </group>")
        lines.append(
            f"  <end_effector name={quoteattr(arm.end_effector)} "
            f"parent_link={quoteattr(arm.wrist)} group={hand} parent_group={group}/>"
        )
        lines += _state("home", arm.name, dict(zip(arm.joints, arm.home, strict=True)))
        lines += _state("open", f"{arm.name}_hand", arm.finger_values(1.0))
        lines += _state("closed", f"{arm.name}_hand", arm.finger_values(0.0))
    for joint in robot.moving_joints():
        lines.append(_disabled(joint.parent, joint.child, "Adjacent"))
    for first, second in robot.may_touch:
        lines.append(_disabled(first, second, "Default"))
    return "\n".join([*lines, "</robot>", ""])


def _state(name: str, group: str, values: dict[str, float]) -> Iterator[str]:
    yield f"  <group_state name={quoteattr(name)} group={quoteattr(group)}>"
    for joint, value in values.items():
        yield f'    <joint name={quoteattr(joint)} value="{value:.6g}"/>'
    yield "  </group_state>"


def _disabled(first: str, second: str, reason: str) -> str:
    pair = f"link1={quoteattr(first)} link2={quoteattr(second)}"
    return f'  <disable_collisions {pair} reason="{reason}"/>'
