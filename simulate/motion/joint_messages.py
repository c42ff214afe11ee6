"""Trajectories as messages: trajectory_msgs/JointTrajectory and goals of FollowJointTrajectory.

Messages are nested mappings, whatever carries them: rosbridge, or ROS by way of its own classes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rtask.errors import RobotError, UsageError
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = [
    "InvalidJointsError",
    "check_start",
    "goal_message",
    "read_trajectory",
    "seconds_of",
]

_FIRST_POINT_RAD = 0.3
_START_RAD = 0.05
_NS = 1_000_000_000


class InvalidJointsError(UsageError):
    """A trajectory names other joints than those of the arm."""


def read_trajectory(message: Mapping[str, Any], joints: Sequence[str], now: Floats) -> Trajectory:
    """Return a trajectory_msgs/JointTrajectory with the arm's joints in the arm's order.

    Parameters
    ----------
    message
        Times are ``secs`` and ``nsecs``, or ``sec`` and ``nanosec`` as in ROS 2. Velocities are
        computed from the positions.
    joints
        Of the arm.
    now : (dof,) float, rad
        Measured values, from which it starts.

    Raises
    ------
    InvalidJointsError
        Its joints are not those of the arm.
    UsageError
        It has no points, times that do not rise, numbers that are not finite, or starts elsewhere.
    """
    names = [str(name) for name in message.get("joint_names") or ()]
    if sorted(names) != sorted(joints):
        raise InvalidJointsError(
            f"joints {', '.join(names) or 'none'}: expected {', '.join(joints)}"
        )
    points = message.get("points") or ()
    times = np.array([seconds_of(point.get("time_from_start")) for point in points])
    if not len(times) or not times[0] >= 0 or not (np.diff(times) > 0).all():
        raise UsageError("time_from_start: expected at least one point, and rising times")
    positions = _positions(points, len(names))[:, [names.index(name) for name in joints]]
    if times[0] == 0:
        off = float(np.abs(positions[0] - now).max())
        if off > _FIRST_POINT_RAD:
            raise UsageError(f"the first point, at time 0, is {off:.2f} rad from the measured pose")
        times, positions = times[1:], positions[1:]
    times, positions = np.r_[0.0, times], np.vstack([now, positions])
    velocities = np.zeros_like(positions)
    if len(times) > 1:
        velocities[:-1] = np.diff(positions, axis=0) / np.diff(times)[:, None]
    return Trajectory(positions, velocities, np.zeros_like(positions), times)


def _positions(points: Sequence[Mapping[str, Any]], dof: int) -> Floats:
    """Return the positions (n, dof) of points."""
    rows = [point.get("positions") or [] for point in points]
    try:
        rows_read = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        rows_read = np.zeros((0, 0))
    if rows_read.shape != (len(points), dof) or not np.isfinite(rows_read).all():
        raise UsageError(f"positions: expected {dof} finite numbers in each point")
    return rows_read


def seconds_of(duration: Any) -> float:
    """Return a time or duration of ROS in s; NaN, which no time rises from, if it is none."""
    if not isinstance(duration, Mapping):
        return float("nan")
    seconds = duration.get("secs", duration.get("sec", 0))
    nanoseconds = duration.get("nsecs", duration.get("nanosec", 0))
    try:
        return float(seconds) + float(nanoseconds) / _NS
    except (TypeError, ValueError):
        return float("nan")


def goal_message(way: Trajectory, joints: Sequence[str]) -> dict[str, Any]:
    """Return a control_msgs/FollowJointTrajectoryGoal, with the times of ROS 1 and of ROS 2.

    Its first point is the second of the trajectory: drivers start at the measured pose by
    themselves.
    """
    points = [
        {
            "positions": position.tolist(),
            "velocities": velocity.tolist(),
            "accelerations": [],
            "effort": [],
            "time_from_start": _duration(float(time)),
        }
        for position, velocity, time in zip(
            way.positions[1:], way.velocities[1:], way.times[1:], strict=True
        )
    ]
    return {"trajectory": {"joint_names": list(joints), "points": points}}


def _duration(seconds: float) -> dict[str, int]:
    whole, rest = divmod(round(seconds * _NS), _NS)
    return {"secs": whole, "nsecs": rest, "sec": whole, "nanosec": rest}


def check_start(way: Trajectory, joints: Sequence[str], measured: Floats) -> None:
    """Check that an arm is where a trajectory starts.

    Parameters
    ----------
    joints
        Of the arm.
    measured : (dof,) float, rad

    Raises
    ------
    RobotError
        A joint is elsewhere.
    """
    off = np.abs(way.positions[0] - measured)
    worst = int(off.argmax())
    if not off[worst] <= _START_RAD:
        raise RobotError(
            f"{joints[worst]} is {off[worst]:.2f} rad from the start of the trajectory; "
            "bring the arm there first"
        )
