"""A parallel gripper read from a URDF: stroke, pads and force from its sliding fingers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.gripper import ParallelGripper

__all__ = ["gripper_from_urdf"]

_MAX_BYTES = 16 * 1024 * 1024
_PAD_M, _OPPOSED, _SNAP = 0.02, -0.99, 0.95
_TIP_SHARE = 0.45
_MIN_STROKE_M = 0.002
_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Finger:
    """A sliding finger in the frame of the link that carries it.

    Parameters
    ----------
    axis : (3,)
        Unit direction of positive motion.
    points : (n, 3), m
        Corners and vertices of its collision shapes at joint value 0.
    """

    joint: str
    link: str
    parent: str
    axis: FloatArray
    lower: float
    upper: float
    effort: float
    points: FloatArray


def gripper_from_urdf(
    path: Path, fingers: tuple[str, str] | None = None, friction: float | None = None
) -> ParallelGripper:
    """Return the gripper of a URDF with two fingers that slide towards each other.

    The parent of both joints is the palm. The stroke is the distance of the inner faces at the
    joints' limits, the pads are what lies within 2 cm of the tips, the force is the joints' effort.

    Parameters
    ----------
    path
        Meshes are looked up beside it, also those of ``package://``.
    fingers
        Names of both joints; None = the only pair of opposed prismatic joints.
    friction
        Between pads and objects, which a URDF does not say; None = the usual one.

    Raises
    ------
    ValueError
        There is no such pair or more than one, a finger has no collision shape, or the file is not
        a URDF.
    """
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path.name} is larger than {_MAX_BYTES // 2**20} MB")
    text = path.read_text("utf-8", errors="replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError(f"{path.name}: a URDF declares no document type or entities")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path.name} is no XML: {error}") from error
    if root.tag != "robot":
        raise ValueError(f"{path.name} is no URDF: its root is <{root.tag}>, expected <robot>")
    links = {str(link.get("name")): link for link in root.findall("link")}
    sliding = [
        _finger(joint, links, path.parent)
        for joint in root.findall("joint")
        if joint.get("type") == "prismatic"
    ]
    first, second = _pair(sliding, fingers, path.name)
    return _measured(first, second, _points(links.get(first.parent), path.parent), friction,
                     str(root.get("name") or path.stem))  # fmt: skip


def _finger(
    joint: ElementTree.Element, links: dict[str, ElementTree.Element], folder: Path
) -> _Finger:
    name = str(joint.get("name"))
    parent, child, limit = joint.find("parent"), joint.find("child"), joint.find("limit")
    if parent is None or child is None or limit is None:
        raise ValueError(f"joint {name!r}: parent, child or limit is missing")
    parent_from_child = _origin(joint)
    axis_tag = joint.find("axis")
    axis = _numbers("1 0 0" if axis_tag is None else str(axis_tag.get("xyz")), 3, name)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise ValueError(f"joint {name!r}: its axis has no direction")
    link = str(child.get("link"))
    points = _points(links.get(link), folder)
    lower, upper, effort = (
        float(_numbers(str(limit.get(key, "0")), 1, name)[0])
        for key in ("lower", "upper", "effort")
    )
    return _Finger(
        name, link, str(parent.get("link")), parent_from_child[:3, :3] @ axis / length, lower,
        upper, effort, points @ parent_from_child[:3, :3].T + parent_from_child[:3, 3],
    )  # fmt: skip


def _pair(
    sliding: Sequence[_Finger], requested: tuple[str, str] | None, name: str
) -> tuple[_Finger, _Finger]:
    """Return the two opposed fingers."""
    if requested is not None:
        named = {finger.joint: finger for finger in sliding}
        for joint in requested:
            if joint not in named:
                raise ValueError(
                    f"{name}: {joint!r} is no prismatic joint; those are "
                    f"{', '.join(named) or 'none'}"
                )
        return named[requested[0]], named[requested[1]]
    pairs = [
        (a, b)
        for a, b in combinations(sliding, 2)
        if a.parent == b.parent and float(a.axis @ b.axis) < _OPPOSED
    ]
    if len(pairs) != 1:
        listing = ", ".join(f"{a.joint} and {b.joint}" for a, b in pairs) or "none"
        raise ValueError(
            f"{name}: expected one pair of opposed prismatic joints on one link, found {listing}; "
            "describe the gripper in a file of its own, or name the joints"
        )
    return pairs[0]


def _measured(
    first: _Finger, second: _Finger, palm: FloatArray, friction: float | None, name: str
) -> ParallelGripper:
    """Return the gripper of two fingers; ``palm`` (n, 3) are points of the link they slide on."""
    for finger in (first, second):
        if not len(finger.points):
            raise ValueError(f"{name}: finger {finger.link!r} has no collision shape to measure")
    middle = (first.points.mean(axis=0) + second.points.mean(axis=0)) / 2
    x = first.axis if float((second.points.mean(axis=0) - middle) @ first.axis) > 0 else -first.axis
    z = _approach(middle, x)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    local = [finger.points @ rotation for finger in (first, second)]
    tip = min(float(points[:, 2].max()) for points in local)
    pads = [points[points[:, 2] > tip - _PAD_M] for points in local]
    gaps = []
    for end in ("lower", "upper"):
        left = pads[0][:, 0].max() + getattr(first, end) * float(first.axis @ x)
        right = pads[1][:, 0].min() + getattr(second, end) * float(second.axis @ x)
        gaps.append(float(right - left))
    low, high = sorted(max(gap, 0.0) for gap in gaps)
    if high - low < _MIN_STROKE_M:
        raise ValueError(
            f"{name}: the fingers' inner faces are {1000 * low:.1f} and {1000 * high:.1f} mm apart "
            "at the limits of their joints: no stroke"
        )
    width = min(float(np.ptp(pad[:, 1])) for pad in pads)
    thickness = max(float(np.ptp(pad[:, 0])) for pad in pads)
    local_palm = palm @ rotation
    root = float(local_palm[:, 2].max()) if len(palm) else min(float(p[:, 2].min()) for p in local)
    size = None
    if len(palm):
        spread = np.ptp(local_palm, axis=0)
        size = (float(spread[0]), float(spread[1]), float(spread[2]))
    length = tip - root
    fingertip = min(_TIP_SHARE * width, 0.4 * length)
    parent_from_gripper = np.eye(4)
    parent_from_gripper[:3, :3] = rotation
    across = float((pads[0][:, 1].mean() + pads[1][:, 1].mean()) / 2)
    centre = float((pads[0][:, 0].max() + pads[1][:, 0].min()) / 2)
    parent_from_gripper[:3, 3] = rotation @ np.array([centre, across, tip - fingertip])
    opens_upwards = gaps[1] > gaps[0]
    limits = (first.lower, first.upper) if opens_upwards else (first.upper, first.lower)
    table = ((low, limits[0]), (high, limits[1])) if limits[1] > limits[0] else ()
    effort = min(first.effort, second.effort)
    force = effort if effort > 0 else ParallelGripper.max_force
    return ParallelGripper(
        name, name, low, high, finger_width=width, finger_length=length,
        finger_thickness=thickness, fingertip=fingertip, palm=size,
        parent_from_gripper=parent_from_gripper, joints=(first.joint, second.joint),
        joint_table=table, max_effort=force, max_force=force,
        friction=ParallelGripper.friction if friction is None else friction,
    )  # fmt: skip


def _approach(middle: FloatArray, x: FloatArray) -> FloatArray:
    """Return the direction from the palm's origin to the fingers, across the closing axis."""
    ahead = middle - float(middle @ x) * x
    length = float(np.linalg.norm(ahead))
    if length < 1e-6:
        raise ValueError("the fingers lie at the palm's origin: no approach direction follows")
    ahead = ahead / length
    axis = int(np.argmax(np.abs(ahead)))
    straight = np.zeros(3)
    straight[axis] = np.sign(ahead[axis])
    if float(ahead @ straight) > _SNAP and abs(float(straight @ x)) < 1e-6:
        return straight
    return np.asarray(ahead)


def _points(link: ElementTree.Element | None, folder: Path) -> FloatArray:
    """Return corners and vertices (n, 3) of a link's collision shapes in its frame, m."""
    parts = [np.empty((0, 3))]
    for collision in () if link is None else link.findall("collision"):
        geometry = collision.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            continue
        pose = _origin(collision)
        parts.append(_corners(shape, folder) @ pose[:3, :3].T + pose[:3, 3])
    return np.vstack(parts)


def _corners(shape: ElementTree.Element, folder: Path) -> FloatArray:
    if shape.tag == "box":
        return _CUBE * _numbers(str(shape.get("size")), 3, "box") / 2
    if shape.tag == "sphere":
        return _CUBE * float(_numbers(str(shape.get("radius")), 1, "sphere")[0])
    if shape.tag == "cylinder":
        radius = float(_numbers(str(shape.get("radius")), 1, "cylinder")[0])
        length = float(_numbers(str(shape.get("length")), 1, "cylinder")[0])
        return _CUBE * (radius, radius, length / 2)
    if shape.tag == "mesh":
        from grasp.spatial.meshes.mesh_files import read_mesh

        scale = _numbers(str(shape.get("scale", "1 1 1")), 3, "mesh")
        return read_mesh(_mesh_path(str(shape.get("filename")), folder)).vertices * scale
    raise ValueError(f"<{shape.tag}> is no shape of a URDF: box, sphere, cylinder, mesh")


def _mesh_path(name: str, folder: Path) -> Path:
    """Return the file of a mesh: beside the URDF, or in a folder above it."""
    relative = name.removeprefix("package://").removeprefix("file://")
    parts = Path(relative).parts
    for base in (folder, *folder.resolve().parents[:3]):
        for skip in (0, 1):  # with and without the package's name
            path = base.joinpath(*parts[skip:])
            if path.is_file():
                return path
    raise ValueError(f"mesh {name!r} is not found beside the URDF")


def _origin(tag: ElementTree.Element) -> FloatArray:
    # Here, because servers import this file at their start and read no URDF.
    from scipy.spatial.transform import Rotation

    origin = tag.find("origin")
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = _numbers(str(origin.get("xyz", "0 0 0")), 3, "origin")
        rpy = _numbers(str(origin.get("rpy", "0 0 0")), 3, "origin")
        pose[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    return pose


def _numbers(text: str, count: int, where: str) -> FloatArray:
    try:
        numbers = np.array([float(word) for word in text.split()], dtype=np.float64)
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"{where}: expected {count} numbers, got {text!r}")
    return numbers
