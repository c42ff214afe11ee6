"""Trajectories as messages: what is read, what is refused, and the way back."""

from __future__ import annotations

import numpy as np
import pytest

from rtask.errors import RobotError, UsageError
from simulate.motion.joint_messages import (
    InvalidJointsError,
    check_start,
    goal_message,
    read_trajectory,
)
from simulate.motion.trajectory import time_path

JOINTS = ("shoulder", "elbow")
NOW = np.array([0.1, -0.2])


def message(*points, names=JOINTS):
    return {
        "joint_names": list(names),
        "points": [{"positions": p, "time_from_start": t} for p, t in points],
    }


def test_a_goal_is_read_back_as_the_trajectory_that_it_was_made_from():
    way = time_path(np.array([NOW, [0.5, 0.4], [0.9, 0.1]]), np.array([1.0, 1.0]))
    read = read_trajectory(goal_message(way, JOINTS)["trajectory"], JOINTS, NOW)
    np.testing.assert_allclose(read.positions, way.positions, atol=1e-12)
    np.testing.assert_allclose(read.times, way.times, atol=1e-9)  # whole nanoseconds


@pytest.mark.parametrize("second", [{"secs": 1, "nsecs": 500_000_000}, {"sec": 1, "nanosec": 5e8}])
def test_joints_come_in_any_order_and_times_in_those_of_ros_1_and_2(second):
    read = read_trajectory(message(([0.4, 0.3], second), names=JOINTS[::-1]), JOINTS, NOW)
    assert read.positions.tolist() == [[0.1, -0.2], [0.3, 0.4]]
    assert read.times.tolist() == [0.0, 1.5]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (message(), "at least one point"),
        (message(([0.0, 0.0], {"sec": 2}), ([0.1, 0.0], {"sec": 1})), "rising times"),
        (message(([0.0, 0.0], {"sec": -1})), "rising times"),
        (message(([0.0, 0.0], None)), "rising times"),
        (message(([0.0, 0.0], {"sec": "soon"})), "rising times"),
        (message(([0.0], {"sec": 1})), "expected 2 finite numbers"),
        (message(([0.0, float("nan")], {"sec": 1})), "expected 2 finite numbers"),
        (message((["far", 0.0], {"sec": 1})), "expected 2 finite numbers"),
        (message(([0.9, 0.0], {"sec": 0})), "0.80 rad from the measured pose"),
    ],
)
def test_what_no_arm_can_follow_is_refused_in_words(asked, words):
    with pytest.raises(UsageError, match=words):
        read_trajectory(asked, JOINTS, NOW)


def test_other_joints_are_named():
    with pytest.raises(InvalidJointsError, match="joints wrist: expected shoulder, elbow"):
        read_trajectory(message(([0.0], {"sec": 1}), names=["wrist"]), JOINTS, NOW)


def test_an_arm_that_stands_elsewhere_is_not_moved():
    way = time_path(np.array([NOW, [0.5, 0.4]]), np.array([1.0, 1.0]))
    check_start(way, JOINTS, NOW + 0.04)
    with pytest.raises(RobotError, match=r"elbow is 0\.30 rad from the start"):
        check_start(way, JOINTS, NOW + np.array([0.0, 0.3]))
