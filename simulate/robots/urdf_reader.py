"""Reader of URDF files.

Anything that a physics engine would have to guess is rejected: a moving link without mass or
inertia, a physically impossible inertia tensor, a joint without limits.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np

from rtask.errors import RobotError
from simulate.robots.description import Inertial, Joint, Link, Pose, Shape, Vector

__all__ = ["ReadRobot", "read_urdf"]

_KINDS = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ReadRobot:
    """Links and joints of a file; ``root`` is the link without a parent."""

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


def read_urdf(path: Path) -> ReadRobot:
    """Read a robot.

    Parameters
    ----------
    path
        The file; meshes are searched in its folder.

    Raises
    ------
    RobotError
        With file, link or joint, and the problem.
    """
    try:
        tree = ET.parse(path).getroot()
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}") from error
    except ET.ParseError as error:
        raise RobotError(f"{path}: not XML: {error}") from error
    if tree.tag != "robot":
        raise RobotError(f"{path}: expected <robot>, found <{tree.tag}>")
    joints = tuple(_joint(path, element) for element in tree.findall("joint"))
    moved = {joint.child for joint in joints if joint.kind != "fixed"}
    links = tuple(_link(path, element, moved) for element in tree.findall("link"))
    names = {link.name for link in links}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in names:
                raise RobotError(f"{path}: joint {joint.name!r} names no link: {end!r}")
    roots = sorted(names - {joint.child for joint in joints})
    if len(roots) != 1:
        raise RobotError(f"{path}: expected one root link, found {', '.join(roots) or 'none'}")
    return ReadRobot(tree.get("name", path.stem), roots[0], links, joints)


def _numbers(text: str | None, default: Vector = _ZERO) -> Vector:
    if text is None:
        return default
    x, y, z = (float(word) for word in text.split())
    return (x, y, z)


def _pose(element: ET.Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return Pose()
    return Pose(_numbers(origin.get("xyz")), _numbers(origin.get("rpy")))


def _link(path: Path, element: ET.Element, moved: set[str]) -> Link:
    name = element.get("name", "")
    inertial = _inertial(path, name, element, name in moved)
    shapes = tuple(_shape(path, name, part) for part in element.findall("collision"))
    return Link(name, inertial, shapes)


def _inertial(path: Path, name: str, element: ET.Element, moves: bool) -> Inertial:
    where = f"{path}: link {name!r}"
    found = element.find("inertial")
    if found is None:
        if moves:
            raise RobotError(f"{where} moves and has no <inertial>: expected mass and inertia")
        return Inertial(0.0, _ZERO, _ZERO)
    mass_of, tensor = found.find("mass"), found.find("inertia")
    mass = float(mass_of.get("value", "0")) if mass_of is not None else 0.0
    if mass <= 0.0:
        if moves:
            raise RobotError(f"{where} moves and weighs {mass:g} kg: expected a mass above 0")
        return Inertial(0.0, _ZERO, _ZERO)
    if tensor is None:
        raise RobotError(f"{where} has a mass and no <inertia>")
    values = {
        key: float(tensor.get(key, "0")) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    }
    pose = _pose(found)
    inertial = Inertial(
        mass,
        pose.xyz,
        (values["ixx"], values["iyy"], values["izz"]),
        (values["ixy"], values["ixz"], values["iyz"]),
    )
    rotation = pose.matrix[:3, :3]
    rotated = rotation @ inertial.tensor @ rotation.T
    moments = np.linalg.eigvalsh(rotated)
    if moments[0] <= 0 or moments[2] > moments[0] + moments[1] + 1e-9:
        shown = ", ".join(f"{m:.3g}" for m in moments)
        raise RobotError(f"{where}: no body has the principal moments {shown} kg m2")
    off = (float(rotated[0, 1]), float(rotated[0, 2]), float(rotated[1, 2]))
    x, y, z = (float(v) for v in np.diag(rotated))
    return Inertial(mass, pose.xyz, (x, y, z), off)


def _shape(path: Path, name: str, element: ET.Element) -> Shape:
    pose, geometry = _pose(element), element.find("geometry")
    part = geometry[0] if geometry is not None and len(geometry) else None
    if part is not None and part.tag == "box":
        return Shape("box", _numbers(part.get("size")), pose)
    if part is not None and part.tag == "sphere":
        return Shape("sphere", (float(part.get("radius", "0")),), pose)
    if part is not None and part.tag == "cylinder":
        size = (float(part.get("radius", "0")), float(part.get("length", "0")))
        return Shape("cylinder", size, pose)
    if part is not None and part.tag == "mesh":
        file = part.get("filename", "")
        relative = file.removeprefix("package://").removeprefix("file://")
        scale = _numbers(part.get("scale"), (1.0, 1.0, 1.0))
        return Shape("mesh", scale, pose, str((path.parent / relative).resolve()))
    kind = part.tag if part is not None else "nothing"
    raise RobotError(f"{path}: link {name!r}: a shape of {kind!r} cannot be read")


def _joint(path: Path, element: ET.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in _KINDS:
        raise RobotError(f"{path}: joint {name!r} is {kind!r}; expected one of {', '.join(_KINDS)}")
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise RobotError(f"{path}: joint {name!r} has no parent or no child")
    limit, axis = element.find("limit"), element.find("axis")
    if kind != "fixed" and (limit is None or "lower" not in limit.keys()):  # noqa: SIM118
        raise RobotError(f"{path}: joint {name!r} moves and has no <limit>")
    bounds = dict(limit.attrib) if limit is not None else {}
    return Joint(
        name,
        parent.get("link", ""),
        child.get("link", ""),
        _pose(element),
        _numbers(axis.get("xyz")) if axis is not None and kind != "fixed" else (0.0, 0.0, 1.0),
        cast(Literal["revolute", "prismatic", "fixed"], _KINDS[kind]),
        float(bounds.get("lower", "0")),
        float(bounds.get("upper", "0")),
        float(bounds.get("velocity", "0")),
        float(bounds.get("effort", "0")),
    )
