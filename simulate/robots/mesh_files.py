"""Mesh files of a URDF: their paths and their content."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rtask.errors import RobotError

__all__ = ["find_mesh", "load_mesh"]


def find_mesh(urdf: Path, name: str, within: Path | None = None) -> Path | None:
    """Return the file that a URDF means by a mesh name; None if it is not there.

    Parameters
    ----------
    urdf
        The URDF file.
    name
        A path, relative to the file's folder, or a URI with ``file://``, ``package://`` or
        ``model://``. The package of such a URI is searched in the file's folder, in each above it,
        and in those of ``ROS_PACKAGE_PATH``.
    within
        The only folder that meshes may lie in, for files of strangers: a package is this folder,
        or one in it. None = anywhere.
    """
    inside = name.partition("://")[2]
    is_packaged = name.startswith(("package://", "model://"))
    if not is_packaged:
        candidates = iter([urdf.parent / name.removeprefix("file://")])
    elif within is not None:
        candidates = iter([within / inside, within / inside.partition("/")[2]])
    else:
        candidates = _in_packages(urdf, inside)
    for path in (candidate.resolve() for candidate in candidates):
        if (within is None or path.is_relative_to(within.resolve())) and path.is_file():
            return path
    return None


def load_mesh(path: Path) -> Any:
    """Return a mesh file (OBJ, STL, PLY, ...) as a trimesh.Trimesh, in its own units.

    Raises
    ------
    RobotError
        The file is missing, of an unknown format or without vertices.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False, skip_materials=True)
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}; a link's shape is missing") from error
    except (ValueError, NotImplementedError, ImportError) as error:
        raise RobotError(f"{path}: cannot read the mesh: {error}") from error
    if not len(mesh.vertices):
        raise RobotError(f"{path}: the mesh has no vertices")
    return mesh


def _in_packages(urdf: Path, inside: str) -> Iterator[Path]:
    package, _, rest = inside.partition("/")
    for folder in urdf.resolve().parents:
        yield folder / inside
        if folder.name == package:
            yield folder / rest
    for listed in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(listed) / inside
        if Path(listed).name == package:
            yield Path(listed) / rest
