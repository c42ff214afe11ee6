"""A motion in pieces goes the same way, rests at the end of each, and keeps the limits."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.motion.horizon import pieces_of
from simulate.motion.motion_limits import MotionLimits, slowed
from simulate.motion.trajectory import time_path


def _way(seed):
    corners = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 5))
    return time_path(corners, np.full(5, 1.5))


def _limits(velocity, acceleration, jerk=np.inf):
    return MotionLimits(*(np.full(5, limit) for limit in (velocity, acceleration, jerk)))


@pytest.mark.parametrize(
    ("horizon_s", "limits"),
    [(0.5, _limits(0.5, 2.5)), (1.0, _limits(0.5, 2.5)), (1.0, _limits(1.5, 12.0, 3000.0))],
)
def test_pieces_rest_at_their_ends_and_keep_the_way_the_time_and_the_limits(horizon_s, limits):
    way = _way(1)
    pieces = pieces_of(way, limits, horizon_s)
    assert len(pieces) > 1
    np.testing.assert_array_equal(pieces[0].positions[0], way.positions[0])
    np.testing.assert_array_equal(pieces[-1].positions[-1], way.positions[-1])
    for piece, following in zip(pieces, [*pieces[1:], None], strict=True):
        assert piece.duration <= horizon_s
        assert np.abs(piece.velocities[[0, -1]]).max() < 1e-9
        assert (np.abs(piece.velocities) <= limits.velocity + 1e-9).all()
        assert (np.abs(piece.accelerations) <= limits.acceleration + 1e-9).all()
        # Between two samples 10 ms apart, a joint goes at most 15 mrad.
        apart = np.abs(piece.positions[:, None] - way.positions[None]).max(axis=2).min(axis=1)
        assert apart.max() < 0.015
        # Velocities are those of the positions, but for a change of acceleration between samples.
        measured = np.gradient(piece.positions, piece.times, axis=0)[1:-1]
        np.testing.assert_allclose(piece.velocities[1:-1], measured, atol=0.15)
        if following is not None:
            np.testing.assert_array_equal(piece.positions[-1], following.positions[0])


def test_half_a_second_at_a_time_takes_no_longer_where_limits_are_cautious():
    limits = _limits(0.5, 2.5)
    ways = [_way(seed) for seed in range(3)]
    whole = sum(slowed(way, limits).duration for way in ways)
    sent = sum(piece.duration for way in ways for piece in pieces_of(way, limits, 0.5))
    assert sent / whole < 1.1


def test_a_motion_within_the_horizon_is_one_piece():
    limits = _limits(9.0, 99.0)
    way = slowed(_way(2), limits)
    assert pieces_of(way, limits, way.duration) == [way]
    with pytest.raises(ValueError, match="expected above 0"):
        pieces_of(way, limits, 0.0)
