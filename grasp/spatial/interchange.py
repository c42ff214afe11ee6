"""Grasps from and to HDF5 files in the layout of ACRONYM (Eppner, Mousavian and Fox, ICRA 2021).

Its poses are those of the Panda's hand with z = approach and x = closing direction, whose origin is
the hand's base; here they are those of the tool centre point. Files of
suction cups and of three fingers say so, with the places that fingers touch besides. Only this file
imports h5py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import EndEffector, ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import NOTHING, first_and_last

if TYPE_CHECKING:
    import h5py

__all__ = ["StoredGrasps", "read_grasps", "read_poses", "with_contacts", "write_grasps"]

_TRANSFORMS = "grasps/transforms"
_SUCCESS = "grasps/qualities/flex/object_in_gripper"
_CONFIDENCE = "grasps/qualities/rtask/confidence"
_CONTACTS, _NORMALS = "grasps/contacts/points", "grasps/contacts/normals"
_KIND = "gripper/contact_kind"
_MAX_GRASPS = 1_000_000
_RIGID = 1e-3


@dataclass(frozen=True)
class StoredGrasps:
    """Grasps of one object.

    Parameters
    ----------
    candidates
        In the object's frame, m; ``scores["stored"]`` is the success in the file's own physics
        (0 or 1) or the confidence that was written, where the file says one.
    mesh
        Path of the object's mesh as the file names it; "" = not said.
    scale
        Metres per unit of that mesh.
    """

    candidates: tuple[GraspCandidate, ...]
    mesh: str = ""
    scale: float = 1.0


def read_grasps(path: Path, gripper: ParallelGripper, mesh: Mesh | None = None) -> StoredGrasps:
    """Return the grasps of a file as candidates.

    Parameters
    ----------
    gripper
        That carries them out; the distance of its tool centre point from its parent link says
        where the file's poses lie on it.
    mesh
        Of the object in m: contacts and widths are measured on it, and grasps that miss it are left
        out. None = the width is the stroke.

    Raises
    ------
    ValueError
        The file is not HDF5, holds no grasps of this layout, or those of another kind of hand.
    """
    with _opened(path) as file:
        poses, stored = _placed(file, path)
        kind = _text(file, _KIND) or "jaws"
        name = _text(file, "object/file")
        scale = _array(file, "object/scale", path) if "object/scale" in file else np.ones(())
    _check_kind(kind, gripper, path)
    if scale.shape or not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"{path.name}: object/scale is {scale}, expected a positive number")
    placed = poses @ _hand_from_tool(gripper)
    candidates = [
        GraspCandidate(
            pose, gripper.max_opening, source="recalled", opening=gripper.max_opening,
            scores={} if stored is None else {"stored": float(stored[k])},
        )
        for k, pose in enumerate(placed)
    ]  # fmt: skip
    if mesh is not None:
        candidates = with_contacts(candidates, mesh, gripper)
    return StoredGrasps(tuple(candidates), name, float(scale))


def read_poses(path: Path, hand: EndEffector) -> FloatArray:
    """Return the poses of a file's grasps (n, 4, 4) in the object's frame, m, for any hand.

    Raises
    ------
    ValueError
        The file is not HDF5, holds no grasps of this layout, or those of another kind of hand.
    """
    with _opened(path) as file:
        poses, _ = _placed(file, path)
        kind = _text(file, _KIND) or "jaws"
    _check_kind(kind, hand, path)
    return np.asarray(poses @ _hand_from_tool(hand))


def write_grasps(
    path: Path,
    candidates: Sequence[GraspCandidate],
    gripper: EndEffector,
    mesh: str = "",
    scale: float = 1.0,
) -> None:
    """Write grasps for tools that read ACRONYM's files.

    Parameters
    ----------
    candidates
        In the object's frame, m. Their confidence goes into a data set of its own, and
        ``object_in_gripper``, which tools colour by, tells whether it is at least one half.
    gripper
        Of any kind: ``gripper/contact_kind`` says which. What three fingers touch goes into
        ``grasps/contacts``, (n, 3, 3) each, NaN for a finger that does not.
    mesh, scale
        Name of the object's mesh for the reader, and metres per unit of it.
    """
    import h5py

    tools = np.array([c.frame_from_gripper for c in candidates]).reshape(-1, 4, 4)
    confidence = np.array([c.scores.get("confidence", 0.0) for c in candidates])
    with h5py.File(path, "w") as file:
        file[_TRANSFORMS] = tools @ np.linalg.inv(_hand_from_tool(gripper))
        file[_SUCCESS] = (confidence >= 0.5).astype(np.uint8)
        file[_CONFIDENCE] = confidence
        file["gripper/type"] = gripper.gripper_type
        file[_KIND] = gripper.contact_kind
        if gripper.contact_kind == "three_fingers":
            for name, rows in ((_CONTACTS, [c.contacts for c in candidates]),
                               (_NORMALS, [c.normals for c in candidates])):  # fmt: skip
                file[name] = _padded(rows)
        file["object/file"] = mesh
        file["object/scale"] = float(scale)


def with_contacts(
    candidates: Sequence[GraspCandidate], mesh: Mesh, gripper: ParallelGripper
) -> list[GraspCandidate]:
    """Return the candidates that close on a mesh, with contacts, normals and width."""
    if not candidates:
        return []
    poses = np.stack([c.frame_from_gripper for c in candidates])
    reach = gripper.max_opening / 2
    at, faces = first_and_last(mesh.tree, poses[:, :3, 3], poses[:, :3, 0], reach)
    closing = []
    for candidate, ends, hit in zip(candidates, at, faces, strict=True):
        if NOTHING in hit or ends[1] <= ends[0]:
            continue
        contacts = candidate.centre + ends[:, None] * candidate.closing
        width = float(ends[1] - ends[0])
        closing.append(
            replace(candidate, width=width, contacts=contacts, normals=mesh.normals[hit])
        )
    return closing


def _padded(rows: Sequence[FloatArray | None]) -> FloatArray:
    """Return up to three points of each grasp as one array (n, 3, 3), NaN where there is none."""
    padded = np.full((len(rows), 3, 3), np.nan)
    for k, points in enumerate(rows):
        if points is not None:
            padded[k, : len(points)] = points
    return padded


def _check_kind(kind: str, hand: EndEffector, path: Path) -> None:
    if kind != hand.contact_kind:
        raise ValueError(
            f"{path.name} holds grasps by {kind.replace('_', ' ')}, and {hand.name} holds by "
            f"{hand.contact_kind.replace('_', ' ')}"
        )


def _opened(path: Path) -> h5py.File:
    import h5py

    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise ValueError(f"{path.name} is no HDF5 file: {error}") from error


def _placed(file: h5py.File, path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Return the checked poses (n, 4, 4) of a file, and what it says of each (n,), if it does."""
    poses = _array(file, _TRANSFORMS, path)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) > _MAX_GRASPS:
        raise ValueError(
            f"{path.name}: {_TRANSFORMS} has shape {poses.shape}, expected (n, 4, 4), n at "
            f"most {_MAX_GRASPS:,}"
        )
    turns = poses[:, :3, :3]
    rigid = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0) < _RIGID
    if not (np.isfinite(poses).all() and rigid and (np.linalg.det(turns) > 0).all()):
        raise ValueError(f"{path.name}: {_TRANSFORMS} are not all rigid transforms")
    stored = next((_array(file, key, path) for key in (_CONFIDENCE, _SUCCESS) if key in file), None)
    if stored is not None and stored.shape != (len(poses),):
        raise ValueError(f"{path.name}: {len(poses)} grasps, but {stored.shape} qualities")
    return poses, stored


def _text(file: h5py.File, key: str) -> str:
    """Return a text of a file; "" where it has none."""
    import h5py

    entry = file.get(key)
    value = entry[()] if isinstance(entry, h5py.Dataset) else ""
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def _hand_from_tool(gripper: EndEffector) -> FloatArray:
    """Return where the tool is in a hand whose axes are the gripper's: along its approach."""
    pose = np.eye(4)
    if gripper.parent_from_gripper is not None:
        parent = np.asarray(gripper.parent_from_gripper, dtype=np.float64)
        pose[2, 3] = float(parent[:3, 3] @ parent[:3, 2])
    return pose


def _array(file: h5py.File, key: str, path: Path) -> FloatArray:
    import h5py

    if key not in file or not isinstance(file[key], h5py.Dataset):
        raise ValueError(f"{path.name} holds no {key}: expected a file in ACRONYM's layout")
    # By what the file declares: a few bytes of it can stand for any number of values.
    if file[key].size > 16 * _MAX_GRASPS:
        raise ValueError(
            f"{path.name}: {key} has shape {file[key].shape}, more than {_MAX_GRASPS:,} grasps"
        )
    try:
        return np.asarray(file[key][()], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path.name}: {key} holds no numbers") from error
