"""Descriptions of robots as data, built in code or read from URDF."""

from __future__ import annotations

import functools
import importlib.metadata
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RobotError, UnknownRobotError, nearest
from simulate.robots.description import (
    Arm,
    CameraMount,
    Joint,
    Link,
    RobotDescription,
    Shape,
    Workplace,
)
from simulate.robots.nao import LEAN, describe_nao
from simulate.robots.panda import describe_panda
from simulate.robots.robot_files import load_robot, robot_names, robots_folder
from simulate.robots.urdf import urdf_text

__all__ = [
    "ROBOTS",
    "Arm",
    "CameraMount",
    "Joint",
    "Link",
    "RobotDescription",
    "Shape",
    "Workplace",
    "check_robot",
    "describe",
    "describe_nao",
    "known_robots",
    "urdf_text",
]

ROBOTS: Mapping[str, Callable[..., RobotDescription]] = {
    "nao": describe_nao,
    "nao_leaning": functools.partial(describe_nao, lean=LEAN, name="nao_leaning"),
    "panda": describe_panda,
}
"""The built-in robots by name."""

_ENTRY_POINTS = "rtask.robots"


def known_robots() -> list[str]:
    """Return the names of all robots: built in, of installed packages, and of the user."""
    return list(dict.fromkeys((*ROBOTS, *sorted(_installed()), *robot_names())))


def check_robot(robot: str) -> None:
    """Refuse a name that no robot has.

    Raises
    ------
    UnknownRobotError
        It names the robots that there are.
    """
    available = known_robots()
    if robot not in available:
        hint = nearest(robot, available) or f"; known: {', '.join(available)}"
        raise UnknownRobotError(
            f"no robot is called {robot!r}{hint}; `rtask robot add FILE.urdf` makes one of a URDF"
        )


def describe(robot: str, **options: Any) -> RobotDescription:
    """Return the description of a robot.

    Parameters
    ----------
    robot
        A built-in robot (:data:`ROBOTS`), one of an installed package (entry-point group
        ``rtask.robots``: a function that returns a :class:`RobotDescription`), or one that `rtask
        robot add` made.
    **options
        Of its own description, such as ``legs``.

    Raises
    ------
    RobotError
        There is no such robot, or it has no such option.

    Examples
    --------
    >>> describe("nao").model
    'Aldebaran NAO H25 V5'
    """
    make = ROBOTS.get(robot)
    if make is None:
        check_robot(robot)
        entry = _installed().get(robot)
        path = robots_folder() / f"{robot}.toml"
        make = entry.load() if entry is not None else functools.partial(load_robot, path)
    try:
        return make(**options)
    except TypeError as error:
        if not options:
            raise
        raise RobotError(f"the {robot} has no option {', '.join(options)}") from error


def _installed() -> dict[str, importlib.metadata.EntryPoint]:
    """Return the robots that installed packages provide."""
    return {entry.name: entry for entry in importlib.metadata.entry_points(group=_ENTRY_POINTS)}
