"""The course of a control_msgs/FollowJointTrajectory goal: its start, its tolerances, its end.

The rules are those of the message and of ros2_control's controller: a header without time starts
now, one in the future then, and of one in the past the rest is followed. A tolerance of 0 is the
usual one, a negative one is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rtask.errors import UsageError
from simulate.motion.joint_messages import read_trajectory, seconds_of
from simulate.robots.description import Floats

__all__ = [
    "GOAL_TOLERANCE",
    "INVALID_GOAL",
    "INVALID_JOINTS",
    "OLD_STAMP",
    "PATH_TOLERANCE",
    "GoalCourse",
    "OldStampError",
    "named",
]

INVALID_GOAL, INVALID_JOINTS, OLD_STAMP, PATH_TOLERANCE, GOAL_TOLERANCE = -1, -2, -3, -4, -5
_NAMES = {
    INVALID_GOAL: "INVALID_GOAL",
    INVALID_JOINTS: "INVALID_JOINTS",
    OLD_STAMP: "OLD_HEADER_TIMESTAMP",
    PATH_TOLERANCE: "PATH_TOLERANCE_VIOLATED",
    GOAL_TOLERANCE: "GOAL_TOLERANCE_VIOLATED",
}
"""Names of the codes of control_msgs/FollowJointTrajectoryResult."""
_TOLERANCE_RAD = 0.05
_SETTLE_S = 0.3
_MOST_WAIT_S = 3600.0


def named(code: object) -> str:
    """Return a code with its name, where it has one.

    >>> named(-4), named(-99)
    ('-4 (PATH_TOLERANCE_VIOLATED)', '-99')
    """
    name = _NAMES.get(code) if isinstance(code, int) else None
    return f"{code} ({name})" if name else str(code)


class OldStampError(UsageError):
    """A trajectory was over before it came."""


class GoalCourse:
    """What a goal asks of an arm at each time since it started.

    Parameters
    ----------
    goal
        As a mapping.
    joints
        Of the arm.
    measured : (dof,) float, rad
        Values of the joints, from which it starts.
    now_s
        Time of the clock that stamps the header, s.

    Raises
    ------
    InvalidJointsError
        Its joints are not those of the arm.
    OldStampError
        All of it lies in the past.
    UsageError
        It cannot be followed, or a tolerance is of a joint that the arm does not have.
    """

    def __init__(
        self, goal: Mapping[str, Any], joints: Sequence[str], measured: Floats, now_s: float
    ) -> None:
        trajectory = goal.get("trajectory")
        if not isinstance(trajectory, Mapping):
            raise UsageError("trajectory: expected a trajectory_msgs/JointTrajectory")
        late_s = _late(trajectory, now_s)
        self._joints, self._start_s = tuple(joints), now_s - late_s
        self._way = read_trajectory(_rest(trajectory, late_s), joints, measured)
        self._path = _allowed(goal, "path_tolerance", joints, math.inf)
        self._goal = _allowed(goal, "goal_tolerance", joints, _TOLERANCE_RAD)
        spare_s = seconds_of(goal.get("goal_time_tolerance") or {})
        if not 0 <= spare_s < math.inf:
            raise UsageError(f"goal_time_tolerance: expected a duration, got {spare_s} s")
        self._spare_s = max(spare_s, _SETTLE_S)

    def is_early(self, now_s: float) -> bool:
        """Return whether its start is yet to come; until then the arm stays where it is."""
        return now_s < self._start_s

    def desired(self, elapsed: float) -> tuple[Floats, Floats]:
        """Return position and velocity (dof,) at a time since its start, or its coming, s."""
        return self._way.at(elapsed)

    def ending(self, elapsed: float, measured: Floats) -> tuple[int, str] | None:
        """Return the code and the words with which it ends at a time; None if it goes on."""
        if elapsed < self._way.duration:
            words = self._off(self.desired(elapsed)[0], measured, self._path, "is", "its path")
            return (PATH_TOLERANCE, words) if words else None
        if elapsed < self._way.duration + _SETTLE_S:
            return None
        words = self._off(self._way.positions[-1], measured, self._goal, "ended", "its goal")
        if not words:
            return 0, ""
        return (GOAL_TOLERANCE, words) if elapsed >= self._way.duration + self._spare_s else None

    def _off(self, target: Floats, measured: Floats, allowed: Floats, verb: str, what: str) -> str:
        """Return which joint is too far from where it should be; empty if none is."""
        # Where there is no limit, only NaN is beyond it.
        for name, off, most in zip(self._joints, np.abs(measured - target), allowed, strict=True):
            if not off <= most:
                return f"{name} {verb} {off:.3g} rad from {what}"
        return ""


def _late(trajectory: Mapping[str, Any], now_s: float) -> float:
    """Return since when a trajectory runs, s; negative before its start, 0 without a time."""
    header = trajectory.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    start_s = seconds_of(stamp) if stamp is not None else 0.0
    if not math.isfinite(start_s):
        raise UsageError("trajectory.header.stamp: expected a time")
    if start_s - now_s > _MOST_WAIT_S:
        raise UsageError(
            f"trajectory.header.stamp: it starts in {start_s - now_s:.0f} s; is it of this clock?"
        )
    return now_s - start_s if start_s > 0 else 0.0


def _rest(trajectory: Mapping[str, Any], late_s: float) -> Mapping[str, Any]:
    """Return what of a trajectory is still to come, its times from now on."""
    points = trajectory.get("points") or ()
    if late_s <= 0 or not points:
        return trajectory
    times = [seconds_of(point.get("time_from_start")) for point in points]
    if not times[-1] > late_s:
        raise OldStampError(
            f"trajectory.header.stamp: it started {late_s:.3f} s ago and takes {times[-1]:.3f} s"
        )
    rest = [
        {**point, "time_from_start": {"secs": 0, "nsecs": (time - late_s) * 1e9}}
        for point, time in zip(points, times, strict=True)
        if not time <= late_s
    ]
    return {**trajectory, "points": rest}


def _allowed(goal: Mapping[str, Any], name: str, joints: Sequence[str], usual: float) -> Floats:
    """Return how far each joint (dof,) may be off, rad."""
    allowed = dict.fromkeys(joints, usual)
    for tolerance in goal.get(name) or ():
        joint = tolerance.get("name") if isinstance(tolerance, Mapping) else None
        if joint not in allowed:
            raise UsageError(f"{name}: {joint!r} is no joint of the arm ({', '.join(joints)})")
        position = tolerance.get("position", 0.0)
        if not isinstance(position, int | float) or not math.isfinite(position):
            raise UsageError(f"{name}: {joint}: expected a number of rad, got {position!r}")
        if position:
            allowed[joint] = float(position) if position > 0 else math.inf
    return np.array(list(allowed.values()))
