"""Causes that cannot be seen, inferred from attempts."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.learning.causes import hidden_share

ALONG = np.linspace(-0.4, 0.4, 9)
HALF_FINGER = 0.1


def after(*tries: tuple[float, bool], weight: float = 1.0) -> np.ndarray:
    """Return the shares after attempts: place and whether it held."""
    tried = np.array([place for place, _ in tries])
    held = np.array([float(success) for _, success in tries])
    return hidden_share(ALONG, HALF_FINGER, tried, held, np.full(len(tries), weight))


def test_nothing_is_assumed_to_hide_before_anything_was_tried() -> None:
    assert after().tolist() == [1.0] * len(ALONG)


def test_a_failure_in_the_middle_points_to_both_ends_alike() -> None:
    share = after((0.0, False))
    np.testing.assert_allclose(share, share[::-1])
    assert share[0] > 0.95
    assert share[4] == share.min() < 0.7


def test_failures_in_the_middle_and_at_one_end_point_to_the_other_end() -> None:
    share = after((0.0, False), (-0.3, False))
    assert ALONG[share.argmax()] >= 0.2
    assert share[ALONG < -0.15].max() < 0.6


def test_a_success_holds_its_neighbours_up_and_says_less_of_the_far_end() -> None:
    share = after((0.0, False), (0.3, True))
    assert ALONG[share.argmax()] == pytest.approx(0.3, abs=0.11)
    assert share[0] < 0.6


def test_what_is_doubtful_counts_less_and_what_weighs_nothing_not_at_all() -> None:
    sure, doubtful = after((0.0, False)), after((0.0, False), weight=0.3)
    assert sure[4] < doubtful[4] < 1.0
    assert after((0.0, False), weight=0.0).tolist() == [1.0] * len(ALONG)


def test_where_all_grasps_are_in_one_place_nothing_follows() -> None:
    share = hidden_share(np.zeros(5), 0.3, np.zeros(4), np.zeros(4), np.ones(4))
    assert share.tolist() == [1.0] * 5
    assert hidden_share(np.zeros(0), 0.3, np.zeros(4), np.zeros(4), np.ones(4)).shape == (0,)


def test_the_order_of_attempts_does_not_matter() -> None:
    tries = [(0.0, False), (-0.3, False), (0.2, True)]
    assert after(*tries).tolist() == after(*tries[::-1]).tolist()
