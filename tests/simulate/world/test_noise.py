"""Sensor noise: as large as it says, where it says, and the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from features.geometry import Frame, Intrinsics
from simulate.world.noise import SensorNoise

CAMERA = Intrinsics.from_fov(640, 480, 1.2)
AXIAL_ONLY = SensorNoise(lateral_px=0, disparity_px=0, dropout=0, colour=0)


def _flat(depth_m: float) -> Frame:
    return Frame(np.full((480, 640), depth_m, np.float32), CAMERA)


def _step() -> Frame:
    """A wall at 0.5 m whose left half stands 10 cm nearer."""
    depth = np.full((480, 640), 0.5, np.float32)
    depth[:, :320] = 0.4
    return Frame(depth, CAMERA, np.full((480, 640, 3), 128, np.uint8))


@pytest.mark.parametrize("distance", [0.3, 0.4, 1.5])
def test_axial_noise_grows_with_the_square_of_the_distance(distance: float) -> None:
    noisy = AXIAL_ONLY.apply(_flat(distance), np.random.default_rng(0)).depth_m
    expected = 0.0012 + 0.0019 * (distance - 0.4) ** 2
    # 307,200 samples: the standard deviation is known to 0.13 %.
    assert noisy.std() == pytest.approx(expected, rel=0.01)
    assert noisy.mean() == pytest.approx(distance, abs=2e-5)


def test_depth_comes_in_steps_of_an_eighth_of_a_pixel_of_disparity() -> None:
    noise = SensorNoise(lateral_px=0, axial_base_m=0.002, axial_square=0, dropout=0)
    levels = np.unique(noise.apply(_flat(0.3), np.random.default_rng(0)).depth_m)
    steps = CAMERA.fx * 0.1 / levels.astype(np.float64) * 8
    np.testing.assert_allclose(steps, np.round(steps), atol=2e-3)  # float32 of about 1,250 steps
    assert 30 < len(levels) < 120  # 0.24 mm a step over plus and minus 4.5 sigma


def test_jitter_moves_edges_by_a_pixel_or_two_and_nothing_else() -> None:
    noise = SensorNoise(axial_base_m=0, axial_square=0, disparity_px=0, dropout=0, colour=0)
    changed = noise.apply(_step(), np.random.default_rng(0)).depth_m != _step().depth_m
    columns = np.flatnonzero(changed.any(axis=0))
    assert columns.min() >= 316  # half a pixel's sigma: more than 3 px is 7 sigma
    assert columns.max() <= 323
    assert changed[:, 319].mean() == pytest.approx(0.16, abs=0.06)  # P(shift rounds to >= 1)


def test_pixels_are_lost_at_jumps_of_depth_only() -> None:
    noisy = SensorNoise().apply(_step(), np.random.default_rng(0)).depth_m
    lost = noisy == 0
    assert np.flatnonzero(lost.any(axis=0)).tolist() == [320]
    assert lost[:, 320].mean() == pytest.approx(0.6, abs=0.08)  # 480 draws: sigma 0.022


def test_missing_depth_stays_missing_and_depth_never_appears() -> None:
    frame = _step()
    depth = frame.depth_m.copy()
    depth[100:200, 100:200] = 0
    depth[300, 300] = np.nan
    noisy = SensorNoise().apply(Frame(depth, CAMERA), np.random.default_rng(0)).depth_m
    assert not noisy[100:200, 100:200].any()
    assert noisy[300, 300] == 0
    assert np.isfinite(noisy).all()
    # A pixel whose neighbour is missing keeps its own depth: holes do not grow.
    jitter = SensorNoise(2.0, 0, 0, disparity_px=0, dropout=0, colour=0)
    moved = jitter.apply(Frame(depth, CAMERA), np.random.default_rng(0)).depth_m
    assert np.count_nonzero(moved == 0) == 100 * 100 + 1


def test_the_same_seed_gives_the_same_frame_and_another_one_another() -> None:
    frame = _step()
    first, again, other = (
        SensorNoise().apply(frame, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.depth_m, again.depth_m)
    np.testing.assert_array_equal(first.rgb, again.rgb)
    assert (first.depth_m != other.depth_m).mean() > 0.5


def test_what_a_frame_shows_does_not_change_the_numbers_drawn_after_it() -> None:
    rngs = [np.random.default_rng(3) for _ in range(2)]
    for rng, distance in zip(rngs, (0.3, 0.9), strict=True):
        SensorNoise().apply(_flat(distance), rng)
    assert rngs[0].random() == rngs[1].random()


def test_grain_changes_colour_and_off_means_off() -> None:
    noisy = SensorNoise().apply(_step(), np.random.default_rng(0))
    assert noisy.rgb.astype(float).std() == pytest.approx(2.0, rel=0.05)
    off = SensorNoise(0, 0, 0, 0, dropout=0, colour=0).apply(_step(), np.random.default_rng(0))
    np.testing.assert_array_equal(off.depth_m, _step().depth_m)
    np.testing.assert_array_equal(off.rgb, _step().rgb)
