"""The robot's own body in a view: its model (URDF) placed by TF, so that no part is an object.

What the model says to be fixed to the robot, such as the walls of its own bins, is body as well.
After ``robot_body_filter`` of ROS; here the body is taken out of what stands on the table only, so
that a table that is part of the model stays the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import JsonObject
from rtask.interop.ros.scene.shapes import Floats, Solid

__all__ = ["PADDING_M", "RobotModel", "body_of_json", "body_pixels"]

PADDING_M = 0.01
"""How far from a surface of the body a point still belongs to it: joints, calibration and depth
are not exact."""
_DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2}
_LARGEST = 4_000_000
"""Characters of a model."""


class RobotModel:
    """The collision shapes of a robot's links.

    Parameters
    ----------
    urdf
        The model, as ``robot_description`` has it.

    Attributes
    ----------
    notes
        What of it cannot be used, in words: files of meshes are not read.

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

    def __init__(self, urdf: str) -> None:
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
        self._links: dict[str, list[Solid]] = {}
        meshes: list[str] = []
        for link in root.iterfind("link"):
            name = link.get("name", "")
            for collision in link.iterfind("collision"):
                solid = _solid(collision, name)
                if solid is None:
                    meshes.append(name)
                else:
                    self._links.setdefault(name, []).append(solid)
        if meshes:
            names = ", ".join(sorted(set(meshes)))
            self.notes.append(f"the shapes of {names} are meshes, which are not read")

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
        for name, solids in self._links.items():
            try:
                base_from_link = lookup(f"{prefix}{slash}{name}")
            except UsageError:
                unplaced.append(name)
                continue
            for solid in solids:
                pose = base_from_link @ solid.pose
                shapes.append(
                    {"kind": solid.kind, "size": list(solid.size), "pose": pose.ravel().tolist()}
                )
        return shapes, unplaced


def body_of_json(shapes: Sequence[JsonObject]) -> list[Solid]:
    """Return the shapes of a request; poses are base_from_shape.

    Raises
    ------
    UsageError
        One is none.
    """
    solids = []
    for number, shape in enumerate(shapes):
        kind = str(shape.get("kind"))
        try:
            size = tuple(float(value) for value in shape["size"])
            pose = np.array(shape["pose"], dtype=np.float64).reshape(4, 4)
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(f"shape {number} of the body: {error!r}") from error
        solids.append(_checked(kind, size, pose, f"shape {number} of the body"))
    return solids


def body_pixels(
    points: NDArray[np.floating], base_from_camera: Floats, body: Sequence[Solid]
) -> NDArray[np.bool_]:
    """Return which points of a view lie on or in the body.

    Parameters
    ----------
    points : (h, w, 3), m
        In the frame of the camera; NaN where nothing was measured.
    base_from_camera : (4, 4)
    body
        Shapes, posed in the base frame.

    Returns
    -------
    (h, w) bool
    """
    flat = points.reshape(-1, 3)
    on_body = np.zeros(len(flat), dtype=bool)
    used = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if not len(used):
        return on_body.reshape(points.shape[:-1])
    low, high = flat[used].min(axis=0), flat[used].max(axis=0)
    for solid in body:
        shape_from_camera = np.linalg.inv(solid.pose) @ base_from_camera
        middle = np.linalg.inv(shape_from_camera)[:3, 3]
        reach = solid.ball()[1] + PADDING_M
        if (middle + reach < low).any() or (middle - reach > high).any():
            continue
        near = used
        for axis in (2, 0, 1):  # most of a view is far from most shapes
            near = near[np.abs(flat[near, axis] - middle[axis]) <= reach]
        if len(near):
            seen = flat[near].astype(np.float64)
            local = seen @ shape_from_camera[:3, :3].T + shape_from_camera[:3, 3]
            on_body[near[solid.distance(local) <= PADDING_M]] = True
    return on_body.reshape(points.shape[:-1])


def _solid(collision: ElementTree.Element, link: str) -> Solid | None:
    """Return the shape of a ``<collision>``; None for a mesh."""
    geometry = collision.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None or shape.tag == "mesh":
        return None
    what = f"robot_description, link {link!r}"
    if shape.tag == "box":
        size = _numbers(shape.get("size"), what)
    elif shape.tag == "sphere":
        size = _numbers(shape.get("radius"), what)
    else:  # a cylinder; or another tag, which is refused
        size = _numbers(f"{shape.get('length', '')} {shape.get('radius', '')}", what)
    return _checked(shape.tag, size, _origin(collision.find("origin"), what), what)


def _checked(kind: str, size: tuple[float, ...], pose: Floats, what: str) -> Solid:
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
