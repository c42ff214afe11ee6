"""Limits of a real arm's motion: velocity, acceleration and jerk of each joint.

Trajectories are planned with one acceleration for all joints, which suits simulated arms. Before
one is sent to a real arm, it is slowed down as a whole until every joint keeps the maker's limits:
the path, which is free of collisions, stays the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rtask.errors import UsageError
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats, RobotDescription

__all__ = ["MotionLimits", "read_joint_limits", "slowed"]

_CAUTIOUS_RAD_S, _CAUTIOUS_RAD_S2 = 0.5, 2.5
_SAMPLE_S = 0.01
_ROUNDING = 1e-6

_MAKERS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "panda": {
        f"panda_joint{k}": limits
        for k, limits in enumerate(
            [(15.0, 7500.0), (7.5, 3750.0), (10.0, 5000.0), (12.5, 6250.0), (15.0, 7500.0),
             (20.0, 10_000.0), (20.0, 10_000.0)], 1)
    },
}  # fmt: skip
"""Largest acceleration (rad/s^2) and jerk (rad/s^3): Franka Control Interface, "Robot and interface
specifications", Panda."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Largest velocity (rad/s), acceleration (rad/s^2) and jerk (rad/s^3) of joints; each (dof,).

    Parameters
    ----------
    assumed
        What was not known, and is a cautious guess; empty if nothing.
    """

    velocity: Floats
    acceleration: Floats
    jerk: Floats
    assumed: str = ""

    @classmethod
    def of(
        cls,
        robot: RobotDescription,
        joints: Sequence[str],
        given: Mapping[str, Mapping[str, float]] | None = None,
    ) -> MotionLimits:
        """Return the limits of joints: as given, by the maker, from the model, or cautious ones.

        Parameters
        ----------
        given
            Of :func:`read_joint_limits`.
        """
        given, by_maker = given or {}, _MAKERS.get(robot.name, {})
        modelled = {joint.name: joint.velocity for joint in robot.joints}
        rows, unknown = [], []
        for name in joints:
            acceleration, jerk = by_maker.get(name, (0.0, 0.0))
            row = {"velocity": modelled.get(name, 0.0), "acceleration": acceleration, "jerk": jerk}
            row |= given.get(name, {})
            for kind, cautious in (
                ("velocity", _CAUTIOUS_RAD_S), ("acceleration", _CAUTIOUS_RAD_S2)
            ):  # fmt: skip
                if not row[kind] > 0:
                    row[kind] = cautious
                    unknown.append(f"{kind} of {name}")
            rows.append((row["velocity"], row["acceleration"], row["jerk"] or np.inf))
        table = np.array(rows).reshape(-1, 3)
        return cls(table[:, 0], table[:, 1], table[:, 2], _said(unknown, robot.name))


def _said(unknown: Sequence[str], robot: str) -> str:
    if not unknown:
        return ""
    some = f"{unknown[0]} and {len(unknown) - 1} more" if len(unknown) > 1 else unknown[0]
    return (
        f"the maker's limits of {robot} are not known ({some}): {_CAUTIOUS_RAD_S:g} rad/s and "
        f"{_CAUTIOUS_RAD_S2:g} rad/s2 are kept; give the robot's joint_limits.yaml by --limits"
    )


def read_joint_limits(path: Path) -> dict[str, dict[str, float]]:
    """Read a ``joint_limits.yaml`` as MoveIt has it.

    Returns
    -------
    dict
        For each joint, those of ``velocity``, ``acceleration`` and ``jerk`` that it limits; scaling
        factors of the file are applied.

    Raises
    ------
    UsageError
        It has no such limits, or one that is not positive.
    """
    import yaml  # type: ignore[import-untyped]  # its stubs are a package of their own

    try:
        read = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UsageError(f"{path}: {error}") from error
    # In ROS 2 it may be a file of parameters: node, ros__parameters, robot_description_planning.
    planning = _planning_of(read)
    if not planning:
        raise UsageError(f"{path}: expected joint_limits with has_velocity_limits, max_velocity, …")
    table = planning["joint_limits"].items()
    return {str(name): _limits_of(path, str(name), about, planning) for name, about in table}


def _planning_of(read: Any) -> Mapping[str, Any] | None:
    """Return the mapping that has ``joint_limits``, and the scaling factors beside it."""
    if not isinstance(read, Mapping):
        return None
    if isinstance(read.get("joint_limits"), Mapping):
        return read
    return next(filter(None, map(_planning_of, read.values())), None)


def _limits_of(path: Path, joint: str, about: Any, read: Mapping[str, Any]) -> dict[str, float]:
    if not isinstance(about, Mapping):
        raise UsageError(f"{path}, {joint}: expected a mapping")
    limits = {}
    for kind in ("velocity", "acceleration", "jerk"):
        value = about.get(f"max_{kind}")
        if value is None or about.get(f"has_{kind}_limits", True) is False:
            continue
        scale = read.get(f"default_{kind}_scaling_factor", 1.0)
        try:
            limit = float(value) * float(scale)
        except (TypeError, ValueError):
            limit = float("nan")
        if not 0 < limit < np.inf:
            raise UsageError(f"{path}, {joint}: max_{kind} is {value!r}, expected above 0")
        limits[kind] = limit
    return limits


def slowed(way: Trajectory, limits: MotionLimits) -> Trajectory:
    """Return a trajectory along the same path, as much slower as the limits of its joints ask.

    Jerk is that between samples.

    Examples
    --------
    >>> from simulate.motion.trajectory import time_path
    >>> way = time_path(np.array([[0.0], [1.0]]), np.array([2.0]))
    >>> tight = MotionLimits(np.array([2.0]), np.array([3.0]), np.array([np.inf]))
    >>> bool(abs(slowed(way, tight).accelerations).max() <= 3.0 + 1e-9)
    True
    """
    if len(way.times) < 2:
        return way
    spans = np.maximum(np.diff(way.times), _SAMPLE_S)[:, None]
    jerk = np.abs(np.diff(way.accelerations, axis=0)) / spans
    factor = max(
        1.0,
        float((np.abs(way.velocities) / limits.velocity).max()),
        float((np.abs(way.accelerations) / limits.acceleration).max()) ** (1 / 2),
        float((jerk / limits.jerk).max()) ** (1 / 3),
    )
    if factor <= 1.0 + _ROUNDING:
        return way
    return Trajectory(
        way.positions, way.velocities / factor, way.accelerations / factor**2, way.times * factor
    )
