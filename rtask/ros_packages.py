"""Files that ``package://`` names: in a ROS workspace, and beside the file that names them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

__all__ = ["in_packages", "workspace_folders"]


def workspace_folders(variables: Mapping[str, str] | None = None) -> tuple[Path, ...]:
    """Return the folders that hold ROS packages, of ROS 2 before those of ROS 1.

    Parameters
    ----------
    variables
        Of the environment; those of this process by default.

    Examples
    --------
    >>> [str(folder) for folder in workspace_folders({"AMENT_PREFIX_PATH": "/opt/ros/jazzy"})]
    ['/opt/ros/jazzy/share']
    """
    given = os.environ if variables is None else variables

    def listed(name: str) -> list[Path]:
        return [Path(path) for path in given.get(name, "").split(os.pathsep) if path]

    prefixes = [*listed("AMENT_PREFIX_PATH"), *listed("CMAKE_PREFIX_PATH")]
    shares = [prefix / "share" for prefix in prefixes]
    return tuple(dict.fromkeys([*shares, *listed("ROS_PACKAGE_PATH")]))


def in_packages(
    inside: str, folders: tuple[Path, ...] = (), *, above: Path | None = None
) -> Iterator[Path]:
    """Yield where a file of a package may lie, whether or not it is there.

    Parameters
    ----------
    inside
        What follows ``package://``: the package, a slash, and the path in it.
    folders
        Of packages, or packages themselves: ``ROS_PACKAGE_PATH`` may list either.
    above
        The file that names it: packages are searched in each folder above it first, since a
        checkout that nobody installed is in no list.
    """
    package, _, rest = inside.partition("/")
    parents = above.resolve().parents if above is not None else ()
    for folder in chain(parents, folders):
        yield folder / inside
        if folder.name == package:
            yield folder / rest
