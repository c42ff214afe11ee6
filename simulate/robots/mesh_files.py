"""Mesh files of a URDF: their paths and their content."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from rtask.errors import RobotError
from rtask.ros_packages import in_packages, workspace_folders

__all__ = ["engine_mesh", "find_mesh", "load_mesh"]

_OF_ENGINE = (".obj", ".dae")
_STL_HEAD, _STL_FACE = 84, 50
"""Bytes of a binary STL before its triangles, the last four their number, and of each."""


def find_mesh(urdf: Path, name: str, within: Path | None = None) -> Path | None:
    """Return the file that a URDF means by a mesh name; None if it is not there.

    Parameters
    ----------
    urdf
        The URDF file.
    name
        A path, relative to the file's folder, or a URI with ``file://``, ``package://`` or
        ``model://``, as written or with its ``%20`` decoded. The package of such a URI is searched
        in the file's folder, in each above it, and in the ROS workspace of this process. A file
        name behind an argument of xacro that was never filled in, ``$(arg meshes)/pad.stl``, is
        searched beside the file and in the folders ``meshes`` there and above.
    within
        The only folder that meshes may lie in, for files of strangers: a package is this folder,
        or one in it. None = anywhere.
    """
    for written in dict.fromkeys((name, unquote(name), name.replace("\\", "/"))):
        for path in (candidate.resolve() for candidate in _candidates(urdf, written, within)):
            if (within is None or path.is_relative_to(within.resolve())) and path.is_file():
                return path
    return None


def _candidates(urdf: Path, name: str, within: Path | None) -> Iterator[Path]:
    inside = name.partition("://")[2].lstrip("/")
    if name.startswith("$("):
        rest = name.rpartition(")")[2].lstrip("/")
        for folder in (".", "meshes", "../meshes"):
            yield urdf.parent / folder / rest
    elif not name.startswith(("package://", "model://")):
        yield urdf.parent / name.removeprefix("file://")
    elif within is not None:
        yield within / inside
        yield within / inside.partition("/")[2]
    else:
        yield from in_packages(inside, workspace_folders(), above=urdf)


def load_mesh(path: Path) -> Any:
    """Return a mesh file (OBJ, STL, PLY, ...) as a trimesh.Trimesh, in its own units.

    A Collada file states the length of its unit, and the physics engine multiplies by it; so its
    vertices come in m here, too, or planning and physics would see two robots.

    Raises
    ------
    RobotError
        The file is missing, of an unknown format, without vertices or with one that is no number.
    """
    import numpy as np
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False, skip_materials=True)
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}; a link's shape is missing") from error
    except (ValueError, NotImplementedError, ImportError) as error:
        raise RobotError(f"{path}: cannot read the mesh: {error}") from error
    if not len(mesh.vertices):
        raise RobotError(f"{path}: the mesh has no vertices{_pointer_hint(path)}")
    if not np.isfinite(mesh.vertices).all():
        raise RobotError(f"{path}: the mesh has vertices that are no numbers")
    if path.suffix.lower() == ".dae" and mesh.units:
        mesh.vertices = mesh.vertices * _metres(mesh.units)
    return mesh


def engine_mesh(path: Path, folder: Path) -> Path:
    """Return a mesh file that the physics engine reads: the same one, or its STL in a folder.

    The engine takes OBJ, Collada and binary STL. Of an STL in text it makes a shape of no size, and
    says so nowhere; over other formats it refuses the whole robot.

    Parameters
    ----------
    path
        Of a mesh file that :func:`load_mesh` reads.
    folder
        In which a converted one is written, named after its path.

    Raises
    ------
    RobotError
        As :func:`load_mesh`.
    """
    suffix = path.suffix.lower()
    if suffix in _OF_ENGINE or (suffix == ".stl" and _is_binary_stl(path)):
        return path
    made = folder / f"{hashlib.sha256(str(path).encode()).hexdigest()[:16]}.stl"
    if not made.exists():
        load_mesh(path).export(made, file_type="stl")
    return made


def _is_binary_stl(path: Path) -> bool:
    """Tell whether a file is as long as its number of triangles says; text never is."""
    try:
        with path.open("rb") as file:
            head, size = file.read(_STL_HEAD), path.stat().st_size
    except OSError:
        return True  # not there: whoever opens it says so
    faces = int.from_bytes(head[-4:], "little") if len(head) == _STL_HEAD else -1
    return size == _STL_HEAD + _STL_FACE * faces


def _metres(unit: str) -> float:
    """Return the length of a unit as trimesh names it for Collada: ``meters``, ``.01 * meters``.

    Examples
    --------
    >>> _metres("0.01 * meters"), _metres("meters")
    (0.01, 1.0)
    """
    factor, _, _ = unit.rpartition("*")
    return float(factor) if factor else 1.0


def _pointer_hint(path: Path) -> str:
    """Return what to do about a file that Git left as a pointer to its content."""
    with path.open("rb") as file:
        is_pointer = file.read(40).startswith(b"version https://git-lfs")
    return ": it is a pointer of Git LFS; git lfs pull brings the file" if is_pointer else ""
