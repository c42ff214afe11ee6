"""Way points respect the limits, are smooth, and begin and end at rest."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.motion.trajectory import Trajectory, join, time_path

VELOCITY = np.array([2.4, 2.2, 2.4, 2.2, 7.0])
ACCELERATION = 12.0


def corners(n, seed):
    steps = np.random.default_rng(seed).normal(0, 0.3, (n, 5))
    return np.cumsum(steps, axis=0)


@pytest.mark.parametrize("n", [2, 3, 5, 9])
@pytest.mark.parametrize("seed", range(5))
def test_limits_hold_everywhere(n, seed):
    way = time_path(corners(n, seed), VELOCITY, ACCELERATION)
    # Limits hold at 120 points of the path; between two of them the curve may pass a little over.
    assert (np.abs(way.velocities) <= VELOCITY * 1.02).all()
    assert np.abs(way.accelerations).max() <= ACCELERATION * 1.25
    assert np.abs(way.velocities[[0, -1]]).max() < 0.05


@pytest.mark.parametrize("n", [2, 4])
def test_velocity_is_the_derivative_of_position(n):
    way = time_path(corners(n, 1), VELOCITY, ACCELERATION)
    between = np.diff(way.positions, axis=0)[:-1] / np.diff(way.times)[:-1, None]
    middle = (way.velocities[:-2] + way.velocities[1:-1]) / 2
    # Second order over 10 ms with at most 15 rad/s^2 changing within it.
    np.testing.assert_allclose(between, middle, atol=0.05)


def test_path_passes_through_its_corners():
    points = corners(5, 2)
    way = time_path(points, VELOCITY)
    for point in points:
        assert np.abs(way.positions - point).max(axis=1).min() < 0.02
    np.testing.assert_allclose(way.positions[0], points[0], atol=1e-9)
    np.testing.assert_allclose(way.positions[-1], points[-1], atol=1e-9)
    assert np.diff(way.times)[:-1] == pytest.approx(0.010)


def test_a_spline_that_collides_is_driven_corner_by_corner():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])

    def on_the_polyline(q):
        return (np.abs(q[:, 1]) < 1e-6) | (np.abs(q[:, 0] - 1) < 1e-6)

    way = time_path(points, np.ones(2), 5.0, on_the_polyline)
    assert on_the_polyline(way.positions).all()
    assert not on_the_polyline(time_path(points, np.ones(2), 5.0).positions).all()


def test_slower_limits_take_longer():
    points = corners(4, 3)
    assert time_path(points, 0.5 * VELOCITY).duration > time_path(points, VELOCITY).duration


def test_one_posture_is_a_trajectory_of_no_length():
    way = time_path(np.zeros((3, 5)), VELOCITY)
    assert way.duration == 0
    np.testing.assert_array_equal(way.at(0.5)[0], np.zeros(5))


def test_joined_parts_follow_one_another():
    first = time_path(np.array([[0.0], [1.0]]), np.ones(1))
    second = time_path(np.array([[1.0], [0.0]]), np.ones(1))
    both = join([first, second])
    assert both.duration == pytest.approx(first.duration + second.duration)
    assert (np.diff(both.times) > 0).all()
    assert both.at(first.duration)[0] == pytest.approx([1.0])


def test_reading_between_way_points_interpolates():
    way = Trajectory(
        np.array([[0.0], [1.0]]), np.array([[0.0], [2.0]]), np.zeros((2, 1)), np.array([0.0, 1.0])
    )
    position, velocity = way.at(0.25)
    assert (position[0], velocity[0]) == (0.25, 0.5)
    assert way.at(2.0)[1][0] == 0.0


def test_wrong_shapes_are_named():
    with pytest.raises(ValueError, match=r"\(3, 5\), \(2,\)"):
        time_path(np.zeros((3, 5)), np.ones(2))
