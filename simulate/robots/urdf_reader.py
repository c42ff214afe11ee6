"""Reader of URDF files.

Many published files leave out what a physics engine needs. The reader fills the gaps and says so, a
warning for each; in strict mode it refuses them: a moving link without mass or inertia, a
physically impossible inertia tensor, a joint without limits, a mesh that is not there.
"""

from __future__ import annotations

import contextlib
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from rtask.errors import RobotError
from simulate.robots.description import Inertial, Joint, Link, Pose, Shape, Vector
from simulate.robots.doctor.axes import doubtful_axes
from simulate.robots.doctor.spelling import without_namespaces, writing_doubts
from simulate.robots.doctor.units import (
    doubtful_limits,
    doubtful_masses,
    doubtful_motions,
    doubtful_places,
    doubtful_turns,
    lost_sources,
)
from simulate.robots.mass import estimated_inertial
from simulate.robots.mesh_cover import mesh_box
from simulate.robots.mesh_files import find_mesh
from simulate.robots.urdf_joints import (
    from_the_root,
    has_shape_below,
    last_sources,
    links_below,
    with_leading_slides,
)

__all__ = ["ReadRobot", "read_urdf"]

_ZERO = (0.0, 0.0, 0.0)
_KINDS: dict[str, Literal["revolute", "prismatic", "fixed"]] = {
    "revolute": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "continuous": "revolute",
    "floating": "fixed",
    "planar": "fixed",
}
_STRICT_KINDS = ("revolute", "prismatic", "fixed")
_EFFORT = {"revolute": 100.0, "prismatic": 10.0}
"""N m and N, of a joint that states none."""
_PREFIX = re.compile(rb"(</?|\s)([A-Za-z]\w*):(?=[\w.-]+[\s=/>])")
_NOT_XML = (ET.ParseError, LookupError, ValueError)
"""The last two of an encoding that does not exist, or that the parser cannot read."""
_SPEED = 1.0
"""rad/s or m/s, of a joint that states none."""
_UNIT_AXIS = 0.01
_SLIDE_M = 0.1
"""Largest limit of a frozen joint that is taken for a slide's."""
_GYRATION_M = 5.0
"""Radius of gyration that no link of a robot has."""


@dataclass(frozen=True)
class ReadRobot:
    """Links and joints of a file, parents before children; ``root`` is the link without a parent.

    ``warnings`` says, one sentence each, what was missing and what was put in its place.
    """

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    warnings: tuple[str, ...] = ()


def read_urdf(
    path: Path, *, strict: bool = True, shapes: bool = True, meshes_in: Path | None = None
) -> ReadRobot:
    """Read a robot.

    Parameters
    ----------
    path
        The file. Meshes are searched in its folder; those of ``package://`` in the folders above
        it, too, and in those of the environment variable ``ROS_PACKAGE_PATH``.
    strict
        Refuse a gap instead of filling it with a warning.
    shapes
        Read the shapes of the links; kinematics does without, and so without meshes.
    meshes_in
        The only folder that meshes may lie in, for files of strangers; None = anywhere.

    Raises
    ------
    RobotError
        With file, link or joint, and the problem.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}") from error
    reader = _Reader(path, strict, shapes, meshes_in)
    tree = without_namespaces(reader.parse(text))
    if tree.tag != "robot":
        raise RobotError(f"{path}: expected <robot>, found <{tree.tag}>")
    return reader.read(tree)


class _Reader:
    """One reading of one file."""

    def __init__(self, path: Path, strict: bool, shapes: bool, meshes_in: Path | None) -> None:
        self._path, self._strict, self._shapes = path, strict, shapes
        self._meshes_in = meshes_in
        self._warnings: list[str] = []
        self._types: dict[str, str] = {}
        self._sources: dict[str, str] = {}
        self._unlimited: set[str] = set()

    def parse(self, text: bytes) -> ET.Element:
        """Return the document; a late declaration or an undeclared prefix is a gap."""
        try:
            return ET.fromstring(text)
        except _NOT_XML as error:
            problem = str(error)
        try:
            tree = ET.fromstring(_PREFIX.sub(rb"\1\2_", text[max(text.find(b"<?xml"), 0) :]))
        except _NOT_XML:
            raise RobotError(f"{self._path}: not XML: {problem}") from None
        self._gap("the file", f"is not XML: {problem}", "read without it")
        return tree

    def read(self, tree: ET.Element) -> ReadRobot:
        stated = [e for e in tree.findall("joint") if e.find("parent") is not None]
        self._types = {e.get("name", ""): e.get("type", "") for e in stated}
        self._sources = last_sources(
            {
                e.get("name", ""): m.get("joint", "")
                for e in stated
                if (m := e.find("mimic")) is not None
            }
        )
        joints = [self._joint(e) for e in stated]
        self._refuse_twins(joints)
        moved = {joint.child for joint in joints if joint.kind != "fixed"}
        elements = {}
        for element in tree.findall("link"):
            name = element.get("name", "")
            if name in elements:
                raise RobotError(f"{self._path}: two links are called {name!r}")
            elements[name] = element
        shapes = {name: self._shapes_of(name, e, "collision") for name, e in elements.items()}
        shapes |= dict(self._seen_instead(elements, shapes, joints))
        links = {
            name: Link(name, self._inertial(name, e, shapes[name], name in moved), shapes[name])
            for name, e in elements.items()
        }
        for joint in joints:
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise RobotError(f"{self._path}: joint {joint.name!r} names no link: {end!r}")
        roots = sorted(set(links) - {joint.child for joint in joints})
        if len(roots) != 1:
            named = ", ".join(roots) or "none"
            raise RobotError(f"{self._path}: expected one root link, found {named}")
        joints = self._with_sources(joints)
        self._warnings += [
            *doubtful_limits(joints), *doubtful_turns(joints), *doubtful_masses(links.values()),
            *doubtful_motions(joints),
        ]  # fmt: skip
        ordered = tuple(from_the_root(self._path, roots[0], joints))
        self._warnings += [*doubtful_places(links.values(), ordered), *doubtful_axes(ordered),
                           *writing_doubts(tree)]  # fmt: skip
        name, warnings = tree.get("name", self._path.stem), tuple(dict.fromkeys(self._warnings))
        return ReadRobot(name, roots[0], tuple(links.values()), ordered, warnings)

    def _refuse_twins(self, joints: Sequence[Joint]) -> None:
        seen: set[str] = set()
        for joint in joints:
            if joint.name in seen:  # the physics engine ends the process over them
                raise RobotError(f"{self._path}: two joints are called {joint.name!r}")
            seen.add(joint.name)

    def _with_sources(self, joints: Sequence[Joint]) -> list[Joint]:
        """Return the joints; those that can follow none move by themselves."""
        reasons = lost_sources(joints)
        for name, reason in reasons.items():
            self._gap(f"joint {name!r}", reason, "moves by itself")
        driven = [replace(j, mimic=None, mimic_offset=0.0) if j.name in reasons else j
                for j in joints]  # fmt: skip
        led, motors = with_leading_slides(driven, self._unlimited)
        for name, motor in motors.items():
            self._gap(
                f"joint {name!r}", f"follows {motor!r}, which has no limits", "moves by itself"
            )
        return led

    def _gap(self, where: str, problem: str, instead: str) -> None:
        """Record a gap that is filled; refuse it in strict mode."""
        if self._strict:
            raise RobotError(f"{self._path}: {where} {problem}")
        self._warnings.append(f"{where} {problem}; {instead}")

    # -- links ------------------------------------------------------------------------------

    def _shapes_of(self, name: str, element: ET.Element, kind: str) -> tuple[Shape, ...]:
        """Return the shapes of a link's ``collision`` or ``visual`` elements."""
        parts = element.findall(kind) if self._shapes else ()
        return tuple(shape for part in parts for shape in self._shape(name, part))

    def _seen_instead(
        self,
        elements: Mapping[str, ET.Element],
        shapes: Mapping[str, tuple[Shape, ...]],
        joints: Sequence[Joint],
    ) -> Iterator[tuple[str, tuple[Shape, ...]]]:
        """Yield the visual shapes of moving branches none of whose links has a collision shape.

        Without them, fingers would pass through all that they close on.
        """
        below: dict[str, list[Joint]] = {}
        for joint in joints:
            below.setdefault(joint.parent, []).append(joint)
        bare = [
            j.child for j in joints if j.kind != "fixed" and not has_shape_below(below, shapes, j)
        ]
        for name in dict.fromkeys(link for child in bare for link in links_below(below, child)):
            element = elements.get(name)
            if self._strict or element is None or element.find("visual") is None:
                continue
            seen = self._shapes_of(name, element, "visual")
            if seen:
                self._gap(f"link {name!r}", "moves without a collision shape", "its visual taken")
                yield name, seen

    def _inertial(
        self, name: str, element: ET.Element, shapes: tuple[Shape, ...], moves: bool
    ) -> Inertial:
        where = f"link {name!r}"
        tag = element.find("inertial")
        mass_of = tag.find("mass") if tag is not None else None
        tensor = tag.find("inertia") if tag is not None else None
        mass = self._number(where, mass_of, "value", 0.0) if mass_of is not None else 0.0
        if mass <= 0.0 or tag is None:
            if not moves:
                if mass < 0.0:
                    self._gap(where, f"weighs {mass:g} kg", "its weight left out, as it is still")
                return Inertial(0.0, _ZERO, _ZERO)
            problem = (
                "moves and has no <inertial>: expected mass and inertia"
                if tag is None
                else f"moves and weighs {mass:g} kg: expected a mass above 0"
            )
            return self._estimated(where, problem, shapes)
        if tensor is None:
            return self._estimated(where, "has a mass and no <inertia>", shapes, mass)
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        xx, yy, zz, xy, xz, yz = (self._number(where, tensor, key, 0.0) for key in keys)
        pose = self._pose(where, tag)
        inertial = Inertial(mass, pose.xyz, (xx, yy, zz), (xy, xz, yz))
        rotation = pose.matrix[:3, :3]
        rotated = rotation @ inertial.tensor @ rotation.T
        moments = np.linalg.eigvalsh(rotated)
        if moments[0] <= 0 or moments[2] > moments[0] + moments[1] + 1e-9:
            if not (moves or self._strict):
                return Inertial(mass, pose.xyz, _ZERO)
            shown = ", ".join(f"{m:.3g}" for m in moments)
            problem = f"has impossible inertia: no body has the principal moments {shown} kg m2"
            return self._estimated(where, problem, shapes, mass)
        if moments[2] > mass * _GYRATION_M**2:
            problem = (
                f"has moments of inertia of {moments[2]:.3g} kg m2 at {mass:g} kg, as of a body "
                "many metres wide: kg mm2?"
            )
            return self._estimated(where, problem, shapes, mass)
        off = (float(rotated[0, 1]), float(rotated[0, 2]), float(rotated[1, 2]))
        x, y, z = (float(v) for v in np.diag(rotated))
        return Inertial(mass, pose.xyz, (x, y, z), off)

    def _estimated(
        self, where: str, problem: str, shapes: tuple[Shape, ...], mass: float | None = None
    ) -> Inertial:
        self._gap(where, problem, "estimated from its collision shape")
        return estimated_inertial(shapes, mass)

    def _shape(self, name: str, element: ET.Element) -> Iterator[Shape]:
        where = f"link {name!r}"
        pose, geometry = self._pose(where, element), element.find("geometry")
        part = geometry[0] if geometry is not None and len(geometry) else None
        kind = part.tag if part is not None else "nothing"
        if part is not None and self._is_empty(where, part):
            return
        if part is not None and kind == "box":
            yield Shape("box", self._vector(where, part, "size"), pose)
        elif part is not None and kind == "sphere":
            yield Shape("sphere", (self._number(where, part, "radius", 0.0),), pose)
        elif part is not None and kind in ("cylinder", "capsule"):
            radius = self._number(where, part, "radius", 0.0)
            length = self._number(where, part, "length", 0.0)
            yield Shape("cylinder", (radius, length), pose)
            for sign in (-1, 1) if kind == "capsule" else ():
                end = pose.matrix @ [0.0, 0.0, sign * length / 2, 1.0]
                yield Shape(
                    "sphere", (radius,), Pose((float(end[0]), float(end[1]), float(end[2])))
                )
        elif part is not None and kind == "mesh":
            yield from self._mesh(where, part, pose)
        else:
            self._gap(where, f"has a shape of {kind!r}, which cannot be read", "left out")

    def _is_empty(self, where: str, part: ET.Element) -> bool:
        """Tell whether a shape has no volume, and note that it is left out."""
        keys = {"box": ("size",), "sphere": ("radius",), "mesh": ("scale",)}
        for key in keys.get(part.tag, ("radius", "length")):
            if key in ("size", "scale"):
                sides: Vector = self._vector(where, part, key, (1.0, 1.0, 1.0))
            else:
                sides = (self._number(where, part, key, 1.0), 1.0, 1.0)
            # A mesh may be mirrored.
            if any(side == 0 or (side < 0 and key != "scale") for side in sides):
                self._gap(where, f"has a {part.tag} of {key} {part.get(key)}", "left out")
                return True
        return False

    def _mesh(self, where: str, part: ET.Element, pose: Pose) -> Iterator[Shape]:
        name = part.get("filename", "")
        scale = self._vector(where, part, "scale", (1.0, 1.0, 1.0))
        mesh_path = find_mesh(self._path, name, self._meshes_in)
        if mesh_path is None:
            self._gap(where, f"has the mesh {name!r}, which is not there", "left out")
            return
        if not self._strict:
            try:
                mesh_box(str(mesh_path), scale)
            except RobotError as error:
                self._gap(where, f"has a mesh that cannot be read ({error})", "left out")
                return
        yield Shape("mesh", scale, pose, str(mesh_path))

    # -- joints -----------------------------------------------------------------------------

    def _joint(self, element: ET.Element) -> Joint:
        name, stated = element.get("name", ""), element.get("type", "")
        where = f"joint {name!r}"
        if stated not in _KINDS:
            raise RobotError(f"{self._path}: {where} is {stated!r}; expected one of {_kinds()}")
        if stated not in _STRICT_KINDS:
            instead = "taken as revolute over +-pi" if stated == "continuous" else "held still"
            self._gap(where, f"is {stated!r}; expected one of {_kinds()}", instead)
        parent, child = element.find("parent"), element.find("child")
        if parent is None or child is None:
            raise RobotError(f"{self._path}: {where} has no parent or no child")
        axis = element.find("axis")
        joint = Joint(
            name,
            parent.get("link", ""),
            child.get("link", ""),
            self._pose(where, element),
            self._vector(where, axis, "xyz", (1.0, 0.0, 0.0)) if axis is not None else (1.0, 0, 0),
            _KINDS[self._thawed(where, element, stated)],
        )
        if joint.kind == "fixed":
            return replace(joint, axis=(0.0, 0.0, 1.0))
        if not any(joint.axis):
            self._gap(where, "moves about the axis 0 0 0", "held still")
            return replace(joint, axis=(0.0, 0.0, 1.0), kind="fixed")
        joint = replace(joint, axis=self._unit_axis(where, joint.axis))
        limited = self._limited(where, joint, element.find("limit"), stated == "continuous")
        return self._following(where, limited, element.find("mimic"))

    def _unit_axis(self, where: str, axis: Vector) -> Vector:
        """Return an axis of length 1, as URDF asks for: along a longer one a slide goes farther."""
        length = math.hypot(*axis)
        if abs(length - 1) > _UNIT_AXIS:
            self._warnings.append(f"{where} has an axis of length {length:.3g}; taken as 1")
        return (axis[0] / length, axis[1] / length, axis[2] / length)

    def _thawed(self, where: str, element: ET.Element, stated: str) -> str:
        """Return the type of a joint: that of the one it follows, where it was frozen.

        Libraries without joints that follow others fix them, and leave axis, range and source. A
        range of some centimetres is a slide's, whatever it follows: no hinge moves so little.
        """
        follows, limit = element.find("mimic"), element.find("limit")
        if self._strict or stated != "fixed" or follows is None or limit is None:
            return stated
        source = self._types.get(self._sources.get(element.get("name", ""), ""), "")
        if source not in ("revolute", "continuous", "prismatic") or element.find("axis") is None:
            return stated
        if limit.get("lower", "0") == limit.get("upper", "0"):
            return stated
        self._gap(where, f"is fixed, but follows {follows.get('joint')!r}", "moves with it")
        ends = (self._number(where, limit, end, 0.0) for end in ("lower", "upper"))
        return "prismatic" if max(map(abs, ends)) <= _SLIDE_M else source

    def _limited(self, where: str, joint: Joint, limit: ET.Element | None, endless: bool) -> Joint:
        if endless:
            self._unlimited.add(joint.name)
        has_range = limit is not None and ("lower" in limit.attrib or "upper" in limit.attrib)
        if not has_range and not endless:
            instead = "held still" if joint.kind == "prismatic" else "taken as +-pi"
            self._gap(where, "moves and has no <limit>", instead)
            if joint.kind == "prismatic":
                return replace(joint, kind="fixed")
            self._unlimited.add(joint.name)
        lower, upper = -math.pi, math.pi
        if limit is not None and has_range and not endless and _is_infinite(limit):
            instead = "held still" if joint.kind == "prismatic" else "taken as +-pi"
            self._gap(where, "has limits without end", instead)
            if joint.kind == "prismatic":
                return replace(joint, kind="fixed")
        elif limit is not None and has_range and not endless:
            lower = self._number(where, limit, "lower", 0.0)
            upper = self._number(where, limit, "upper", 0.0)
        if lower > upper:
            self._gap(where, f"has the limits {lower:g} .. {upper:g}", "exchanged")
            lower, upper = upper, lower
        speed = self._number(where, limit, "velocity", 0.0) if limit is not None else 0.0
        effort = self._number(where, limit, "effort", 0.0) if limit is not None else 0.0
        if not self._strict and (speed <= 0 or effort <= 0):
            default = _EFFORT[joint.kind]
            self._gap(where, "states no speed or effort", f"taken as {_SPEED:g} and {default:g}")
            speed, effort = speed if speed > 0 else _SPEED, effort if effort > 0 else default
        return replace(joint, lower=lower, upper=upper, velocity=speed, effort=effort)

    def _following(self, where: str, joint: Joint, element: ET.Element | None) -> Joint:
        if element is None:
            return joint
        factor = self._number(where, element, "multiplier", 1.0)
        offset = self._number(where, element, "offset", 0.0)
        return replace(joint, mimic=(element.get("joint", ""), factor), mimic_offset=offset)

    # -- values -----------------------------------------------------------------------------

    def _number(self, where: str, element: ET.Element, key: str, default: float) -> float:
        text = element.get(key)
        try:
            value = default if text is None else float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RobotError(
                f"{self._path}: {where}: {key} {text!r} is not a number{_hint(str(text))}"
            )
        return value

    def _vector(self, where: str, element: ET.Element, key: str, default: Vector = _ZERO) -> Vector:
        text = element.get(key)
        if text is None:
            return default
        words = text.split()
        if len(words) == 3 and any("," in word.strip(",") for word in words):
            raise RobotError(
                f"{self._path}: {where}: {key} {text!r} has decimal commas; URDF writes 0.5"
            )
        if not self._strict and (len(words) > 3 or "," in text):
            words = text.replace(",", " ").split()
            self._gap(where, f"has {key} {text!r}", f"taken as {' '.join(words[:3])}")
        try:
            x, y, z = (float(word) for word in words[: 3 if not self._strict else None])
        except ValueError:
            raise RobotError(
                f"{self._path}: {where}: {key} {text!r} is not three numbers{_hint(text)}"
            ) from None
        if not all(math.isfinite(value) for value in (x, y, z)):
            raise RobotError(f"{self._path}: {where}: {key} {text!r} is not finite")
        return (x, y, z)

    def _pose(self, where: str, element: ET.Element) -> Pose:
        origin = element.find("origin")
        if origin is None:
            return Pose()
        return Pose(self._vector(where, origin, "xyz"), self._vector(where, origin, "rpy"))


def _hint(text: str) -> str:
    """Return what to do about a value that a program was to fill in."""
    return "; expand it first: xacro FILE > robot.urdf" if "$" in text else ""


def _is_infinite(limit: ET.Element) -> bool:
    """Tell whether a limit is written as infinity, or as more than any float."""
    for key in ("lower", "upper"):
        with contextlib.suppress(ValueError):
            if math.isinf(float(limit.get(key, "0"))):
                return True
    return False


def _kinds() -> str:
    return ", ".join(_STRICT_KINDS)
