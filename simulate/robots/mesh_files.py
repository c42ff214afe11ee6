"""Where the mesh files of a URDF are."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["find_mesh"]


def find_mesh(urdf: Path, name: str) -> Path | None:
    """Return the file that a URDF means by a mesh name; None if it is not there.

    Parameters
    ----------
    urdf
        The URDF file.
    name
        A path, relative to the file's folder, or a URI with ``file://``, ``package://`` or
        ``model://``. The package of such a URI is searched in the file's folder, in each above it,
        and in those of ``ROS_PACKAGE_PATH``.
    """
    if name.startswith(("package://", "model://")):
        inside = name.partition("://")[2]
        candidates = _in_packages(urdf, inside)
    else:
        candidates = iter([urdf.parent / name.removeprefix("file://")])
    return next((path.resolve() for path in candidates if path.is_file()), None)


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
