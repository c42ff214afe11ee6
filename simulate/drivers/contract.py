"""Contract of every driver of a real arm: what starts a motion, and what counts as its end.

A motion starts only from joint states that are recent, complete, finite, within the limits and at
rest. It has succeeded only when the controller's terminal status says so and fresh joint states
show the arm at the goal.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from typing import Literal

import numpy as np

from rtask.errors import RobotError
from simulate.motion.joint_messages import check_start
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = [
    "ARRIVED_RAD",
    "RosVersion",
    "check_arrival",
    "check_at_goal",
    "check_ending",
    "check_motion_start",
    "goal_id",
]

RosVersion = Literal[1, 2]

_SUCCEEDED: dict[RosVersion, int] = {1: 3, 2: 4}
_ENDINGS: dict[RosVersion, dict[int, str]] = {
    1: {2: "preempted", 3: "succeeded", 4: "aborted", 5: "rejected", 8: "recalled", 9: "lost"},
    2: {4: "succeeded", 5: "canceled", 6: "aborted"},
}
"""actionlib_msgs/GoalStatus and action_msgs/GoalStatus: 4 is a failure in one, a success in the
other."""

ARRIVED_RAD = 0.05
"""How far a joint may be from its goal."""
_SAME_RAD = 0.05
_MOVED_RAD = 0.02
"""From here on, an arm that has moved differs from one that has not, in spite of noise."""


def goal_id() -> str:
    """Return a goal id that no other program on the same bridge uses."""
    return f"rtask-{uuid.uuid4().hex}"


def check_ending(ros: RosVersion, status: object, action: str, words: str = "") -> None:
    """Check the terminal status of a goal, by the table of its protocol.

    Parameters
    ----------
    ros
        Version of ROS whose GoalStatus it is.
    status
        As the controller sent it; anything unknown is a failure.

    Raises
    ------
    RobotError
        The goal did not succeed.

    Examples
    --------
    >>> check_ending(2, 4, "/arm")
    >>> check_ending(1, 4, "/arm")
    Traceback (most recent call last):
    ...
    rtask.errors.RobotError: /arm ended: aborted (status 4 of ROS 1)
    """
    # Not a bool, which Python counts as 1: a driver that says True has said nothing.
    if type(status) is int and status == _SUCCEEDED[ros]:
        return
    name = _ENDINGS[ros].get(status, "unknown") if type(status) is int else "unknown"
    tail = f": {words}" if words else ""
    raise RobotError(f"{action} ended: {name} (status {status} of ROS {ros}){tail}")


def check_motion_start(way: Trajectory, joints: Sequence[str], measured: Floats) -> None:
    """Check that an arm is where a trajectory starts.

    Raises
    ------
    RobotError
        A joint is elsewhere; values that fit in another order of the joints are recognised.
    """
    try:
        check_start(way, joints, measured)
    except RobotError as error:
        apart = np.abs(np.sort(measured) - np.sort(way.positions[0]))
        # Some drivers sort names and not positions; the values then fit in another order.
        if len(joints) > 1 and (apart <= _SAME_RAD).all():
            raise RobotError(
                f"{error}; the measured values fit in another order of the joints: "
                "check that the driver's names belong to its positions"
            ) from error
        raise


def check_arrival(
    way: Trajectory,
    joints: Sequence[str],
    measured: Floats,
    start: Floats,
    tolerance_rad: float = ARRIVED_RAD,
) -> None:
    """Check that an arm, as measured after a motion, is at the end of a trajectory.

    Parameters
    ----------
    measured, start : (dof,) float, rad
        Measured after the motion, and before it.
    tolerance_rad
        How far a joint may be off. Where that is more than the way itself, the arm has to have gone
        half of it: one that stayed is not there.

    Raises
    ------
    RobotError
        A joint is elsewhere, whatever the controller said.
    """
    check_at_goal(way, joints, measured, tolerance_rad)
    asked = way.positions[-1] - start
    most = int(np.abs(asked).argmax())
    # The tolerance alone would pass a short motion that never took place.
    if abs(asked[most]) > _MOVED_RAD and (measured - start)[most] / asked[most] < 0.5:
        raise RobotError(
            f"{joints[most]} stayed where it was, "
            f"{abs(measured - way.positions[-1])[most]:.3f} rad from its goal, although the "
            "controller reported success"
        )


def check_at_goal(
    way: Trajectory,
    joints: Sequence[str],
    measured: Floats,
    tolerance_rad: float = ARRIVED_RAD,
) -> None:
    """Check that measured joints (dof,), rad, are near the end of a trajectory.

    Raises
    ------
    RobotError
        A joint is elsewhere, whatever the controller said.
    """
    off = np.abs(measured - way.positions[-1])
    worst = int(off.argmax())
    # Written so that NaN fails.
    if not off[worst] <= tolerance_rad:
        raise RobotError(
            f"{joints[worst]} ended {off[worst]:.2f} rad from its goal, although the controller "
            "reported success; something is in the way, or it did not move"
        )
