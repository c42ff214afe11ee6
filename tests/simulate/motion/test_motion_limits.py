"""Trajectories are slowed down as the maker's limits of a real arm ask."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.motion.motion_limits import MotionLimits, read_joint_limits, slowed
from simulate.motion.trajectory import time_path
from simulate.robots import describe

JOINTS = ("shoulder", "elbow")
FILE = """
default_velocity_scaling_factor: 0.5
joint_limits:
  shoulder: {has_velocity_limits: true, max_velocity: 2.0, has_acceleration_limits: true,
             max_acceleration: 4.0, has_jerk_limits: true, max_jerk: 100.0}
  elbow: {has_velocity_limits: true, max_velocity: 1.0, has_acceleration_limits: false,
          max_acceleration: 0.0}
"""


def _way():
    return time_path(np.array([[0.0, 0.0], [1.0, -0.4], [0.3, 0.5]]), np.array([3.0, 3.0]))


@pytest.mark.parametrize(
    ("velocity", "acceleration", "jerk"),
    [(0.5, np.inf, np.inf), (np.inf, 2.0, np.inf), (np.inf, np.inf, 50.0), (0.4, 1.0, 20.0)],
)
def test_every_joint_keeps_its_limits_along_the_same_path(velocity, acceleration, jerk):
    way = _way()
    # The second joint is free: the first alone slows both.
    tight = [np.array([limit, np.inf]) for limit in (velocity, acceleration, jerk)]
    slow = slowed(way, MotionLimits(*tight))
    assert slow.duration > way.duration
    np.testing.assert_array_equal(slow.positions, way.positions)
    assert (np.abs(slow.velocities) <= tight[0] + 1e-9).all()
    assert (np.abs(slow.accelerations) <= tight[1] + 1e-9).all()
    rates = np.abs(np.diff(slow.accelerations, axis=0)) / np.diff(slow.times)[:, None]
    assert (rates[:-1] <= tight[2] + 1e-6).all()
    # Velocities are still those of the positions.
    middle = len(slow.times) // 2
    measured = np.gradient(slow.positions, slow.times, axis=0)[middle]
    np.testing.assert_allclose(slow.velocities[middle], measured, atol=0.02)


def test_a_trajectory_within_its_limits_stays_as_it_is():
    way, free = _way(), np.full(2, np.inf)
    assert slowed(way, MotionLimits(free, free, free)) is way


def test_a_file_of_joint_limits_is_read_with_its_scaling_also_as_parameters_of_a_node(tmp_path):
    plain, nested = tmp_path / "joint_limits.yaml", tmp_path / "parameters.yaml"
    plain.write_text(FILE)
    nested.write_text(
        "move_group:\n  ros__parameters:\n    robot_description_planning:\n"
        + "\n".join(f"      {line}" for line in FILE.splitlines())
    )
    limits = read_joint_limits(plain)
    assert limits["shoulder"] == {"velocity": 1.0, "acceleration": 4.0, "jerk": 100.0}
    assert limits["elbow"] == {"velocity": 0.5}
    assert read_joint_limits(nested) == limits


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joint_limits: [", "joint_limits.yaml"),
        ("limits: {}", "expected joint_limits"),
        ("joint_limits: {a: 3}", "a: expected a mapping"),
        ("joint_limits: {a: {max_velocity: -1}}", "max_velocity is -1, expected above 0"),
        ("joint_limits: {a: {max_jerk: .nan}}", "max_jerk is nan"),
        ("joint_limits: {a: {max_acceleration: fast}}", "max_acceleration is 'fast'"),
    ],
)
def test_a_file_that_limits_nothing_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=words):
        read_joint_limits(path)


def test_the_panda_has_its_makers_limits_and_a_nao_cautious_ones_that_are_said():
    panda, nao = describe("panda"), describe("nao")
    joints = panda.arm("panda_arm").joints
    known = MotionLimits.of(panda, joints)
    assert known.assumed == ""
    assert known.acceleration.tolist() == [15, 7.5, 10, 12.5, 15, 20, 20]
    guessed = MotionLimits.of(nao, nao.arm("right").joints)
    assert "maker's limits of nao are not known" in guessed.assumed
    assert (guessed.acceleration == 2.5).all()
    given = {name: {"acceleration": 1.0} for name in joints}
    assert (MotionLimits.of(panda, joints, given).acceleration == 1.0).all()
