"""Objects measured on a table."""

from __future__ import annotations

import numpy as np
import pytest

from features.tabletop import measure

RNG = np.random.default_rng(5)


def _box(length: float, width: float, height: float, yaw: float, n: int = 4000) -> np.ndarray:
    flat = RNG.uniform(-0.5, 0.5, (n, 2)) * [length, width]
    c, s = np.cos(yaw), np.sin(yaw)
    flat = flat @ np.array([[c, s], [-s, c]]) + [0.15, -0.1]
    return np.column_stack([flat, np.full(n, 0.27 + height)])


def _disc(radius: float, height: float, n: int = 4000) -> np.ndarray:
    r, a = radius * np.sqrt(RNG.random(n)), RNG.uniform(0, 2 * np.pi, n)
    return np.column_stack([0.15 + r * np.cos(a), -0.1 + r * np.sin(a), np.full(n, 0.27 + height)])


@pytest.mark.parametrize("yaw", [0.0, 0.4, np.pi / 2, 2.9])
def test_a_box_is_measured_with_its_direction(yaw: float) -> None:
    shape = measure(_box(0.05, 0.03, 0.04, yaw), 0.27)
    # The trimmed outline of 4,000 random points lies within 1 mm of the true one.
    np.testing.assert_allclose([shape.length, shape.width], [0.05, 0.03], atol=1.5e-3)
    np.testing.assert_allclose(shape.centre, [0.15, -0.1], atol=1e-3)
    assert abs(np.sin(shape.yaw - yaw)) < 0.05
    assert not shape.is_round


def test_a_disc_is_round_and_has_no_direction() -> None:
    shape = measure(_disc(0.018, 0.07), 0.27)
    assert shape.is_round
    assert shape.yaw == 0
    assert shape.length == shape.width == pytest.approx(0.036, abs=1.5e-3)
    assert shape.height == pytest.approx(0.07, abs=1e-6)


def test_a_square_is_not_round() -> None:
    # 2/pi = 0.64 for sharp corners; trimming stray points rounds them.
    assert 0.6 < measure(_box(0.03, 0.03, 0.05, 0.3), 0.27).roundness < 0.78


def test_sensor_noise_and_stray_points_change_little() -> None:
    points = _disc(0.018, 0.07)
    noisy = points + RNG.normal(0, 0.001, points.shape)
    stray = np.column_stack([RNG.uniform(0.1, 0.2, (8, 1)), RNG.uniform(-0.15, -0.05, (8, 1)),
                             np.full((8, 1), 0.30)])  # fmt: skip
    shape = measure(np.concatenate([noisy, stray]), 0.27)
    # Noise of 1 mm widens the outline by about two sigma at each side.
    assert shape.length == pytest.approx(0.036, abs=5e-3)
    np.testing.assert_allclose(shape.centre, [0.15, -0.1], atol=2e-3)


def test_the_object_frame_turns_with_the_object() -> None:
    shape = measure(_box(0.05, 0.03, 0.04, 0.4), 0.27)
    end = shape.frame_from_object() @ np.array([0.025, 0, 0, 1])
    np.testing.assert_allclose(
        end[:2], [0.15 + 0.025 * np.cos(0.4), -0.1 + 0.025 * np.sin(0.4)], atol=2e-3
    )
    assert end[2] == pytest.approx(0.27)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 3)), "at least 12"),
        (np.full((50, 3), np.nan), "0 finite points"),
        (np.zeros((50, 2)), r"shape \(n, 3\)"),
        (np.zeros((50, 3)), "no area"),
    ],
)
def test_what_is_no_shape_is_refused(points: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure(points, 0.27)
