"""Descriptions of robots as data, built in code or read from URDF."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import RobotError, nearest
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
    "describe",
    "describe_nao",
    "urdf_text",
]

ROBOTS: Mapping[str, Callable[..., RobotDescription]] = {
    "nao": describe_nao,
    "nao_leaning": functools.partial(describe_nao, lean=LEAN, name="nao_leaning"),
    "panda": describe_panda,
}
"""The robots by name."""


def describe(robot: str, **options: Any) -> RobotDescription:
    """Return the description of a robot.

    Parameters
    ----------
    robot
        A name of :data:`ROBOTS`.
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
    if robot not in ROBOTS:
        known = list(ROBOTS)
        hint = nearest(robot, known) or f"; known: {', '.join(known)}"
        raise RobotError(f"no robot is called {robot!r}{hint}")
    try:
        return ROBOTS[robot](**options)
    except TypeError as error:
        raise RobotError(f"the {robot} has no option {', '.join(options)}") from error
