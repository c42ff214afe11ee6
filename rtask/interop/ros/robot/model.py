"""The robot's model (URDF): the collision shapes of its links, placed by TF."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from rtask.errors import DataError, UsageError
from rtask.interop.ros.convert import JsonObject
from rtask.interop.ros.robot.meshes import MeshFiles, read_mesh
from rtask.interop.ros.robot.surface import Surface, surface_of_mesh
from rtask.interop.ros.scene.shapes import Floats, Solid

__all__ = ["RobotModel", "checked_solid"]

_DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2}
_LARGEST = 4_000_000
"""Characters of a model."""


@dataclass(frozen=True, eq=False)
class _Shape:
    """A shape of a link: link_from_shape (4, 4), and what a request says of it."""

    pose: Floats
    message: JsonObject


class RobotModel:
    """The collision shapes of a robot's links.

    Parameters
    ----------
    urdf
        The model, as ``robot_description`` has it.
    meshes
        Finds the files of meshes that it names; those of this environment by default.

    Attributes
    ----------
    notes
        What of the body is not known, in words: meshes that are not here, or cannot be read.

    Raises
    ------
    UsageError
        It is no URDF.

    Examples
    --------
    >>> model = RobotModel('<robot name="r"><link name="hand"><collision><geometry>'
    ...     '<sphere radius="0.05"/></geometry></collision></link></robot>')
    >>> shapes, unplaced = model.placed(lambda frame: np.eye(4), "base")
    >>> [(each["kind"], each["size"]) for each in shapes], unplaced
    ([('sphere', [0.05])], [])
    """

    def __init__(self, urdf: str, meshes: MeshFiles | None = None) -> None:
        # ElementTree expands entities without end; a model declares none.
        if len(urdf) > _LARGEST or "<!ENTITY" in urdf:
            raise UsageError("robot_description is too large, or declares entities")
        try:
            root = ElementTree.fromstring(urdf)
        except ElementTree.ParseError as error:
            raise UsageError(f"robot_description is no XML: {error}") from error
        if root.tag != "robot":
            raise UsageError(f"robot_description is no URDF, but <{root.tag}>")
        self.notes: list[str] = []
        self._files = meshes or MeshFiles()
        self._links: dict[str, list[_Shape]] = {}
        for link in root.iterfind("link"):
            name = link.get("name", "")
            for collision in link.iterfind("collision"):
                shape = self._shape_of(collision, name)
                if shape is not None:
                    self._links.setdefault(name, []).append(shape)
        if not self._links and root.find("link") is not None:
            self.notes.append("no link has a collision shape that is known")

    def _shape_of(self, collision: ElementTree.Element, link: str) -> _Shape | None:
        """Return the shape of a ``<collision>``; None where it is not known, which is noted."""
        geometry = collision.find("geometry")
        shape = geometry[0] if geometry is not None and len(geometry) else None
        what = f"robot_description, link {link!r}"
        if shape is None:
            self.notes.append(f"a collision of {link} has no shape")
            return None
        pose = _origin(collision.find("origin"), what)
        if shape.tag != "mesh":
            solid = _solid(shape, pose, what)
            return _Shape(solid.pose, {"kind": solid.kind, "size": list(solid.size)})
        try:
            surface = self._surface(shape, pose, what)
        except (DataError, UsageError) as error:
            self.notes.append(f"the shape of {link} is not known: {error}")
            return None
        size = [surface.radius]
        return _Shape(pose, {"kind": "points", "size": size, "points": surface.as_text()})

    def _surface(self, mesh: ElementTree.Element, pose: Floats, what: str) -> Surface:
        uri = mesh.get("filename", "")
        path = self._files.find(uri)
        if path is None:
            raise DataError(
                f"{uri} is not in this environment; source the workspace of its package"
            )
        scale = np.array(_numbers(mesh.get("scale", "1 1 1"), what))
        if scale.shape != (3,):
            raise UsageError(f"{what}: a scale of {len(scale)} numbers")
        return surface_of_mesh(read_mesh(path, scale), pose)

    def placed(
        self, lookup: Callable[[str], Floats], base: str
    ) -> tuple[list[JsonObject], list[str]]:
        """Return the shapes where TF says their links are, as a request carries them.

        The second list names the links of which it says nothing; their shapes are left out.

        Parameters
        ----------
        lookup
            Returns base_from_frame (4, 4); raises UsageError where it is not known.
        base
            Frame of the robot; what stands before its name stands before those of the links too,
            ``nao1/base_footprint``.
        """
        prefix, slash, _ = base.strip("/").rpartition("/")
        shapes: list[JsonObject] = []
        unplaced: list[str] = []
        for name, parts in self._links.items():
            try:
                base_from_link = lookup(f"{prefix}{slash}{name}")
            except UsageError:
                unplaced.append(name)
                continue
            for part in parts:
                pose = base_from_link @ part.pose
                shapes.append({**part.message, "pose": pose.ravel().tolist()})
        return shapes, unplaced


def _solid(shape: ElementTree.Element, pose: Floats, what: str) -> Solid:
    """Return a shape that is no mesh."""
    if shape.tag == "box":
        size = _numbers(shape.get("size"), what)
    elif shape.tag == "sphere":
        size = _numbers(shape.get("radius"), what)
    else:  # a cylinder; or another tag, which is refused
        size = _numbers(f"{shape.get('length', '')} {shape.get('radius', '')}", what)
    return checked_solid(shape.tag, size, pose, what)


def checked_solid(kind: str, size: tuple[float, ...], pose: Floats, what: str) -> Solid:
    if len(size) != _DIMENSIONS.get(kind, -1) or not all(0 < v < math.inf for v in size):
        raise UsageError(f"{what}: {kind} of {list(size)}; expected a box, sphere or cylinder")
    turn = pose[:3, :3]
    is_pose = np.isfinite(pose).all() and np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
    if not is_pose or not np.allclose(pose[3], (0, 0, 0, 1)):
        raise UsageError(f"{what}: its pose is none")
    return Solid(kind, size, pose)


def _numbers(text: str | None, what: str) -> tuple[float, ...]:
    try:
        return tuple(float(value) for value in (text or "").split())
    except ValueError as error:
        raise UsageError(f"{what}: {error}") from error


def _origin(origin: ElementTree.Element | None, what: str) -> Floats:
    pose = np.eye(4)
    if origin is None:
        return pose
    move = _numbers(origin.get("xyz", "0 0 0"), what)
    angles = _numbers(origin.get("rpy", "0 0 0"), what)
    if len(move) != 3 or len(angles) != 3:
        raise UsageError(f"{what}: an origin of {len(move)} and {len(angles)} numbers")
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = move
    return pose
