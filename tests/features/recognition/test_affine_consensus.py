"""The affine map that most matches agree on, however often the same agreement is reached."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from features.recognition.verify import (
    _affine_consensus,
    _agreeing,
    _least_squares_affine,
)

Matches = tuple[NDArray[np.float64], NDArray[np.float64]]
_REACH_PX, _TURN, _LOG_SCALE = 9.0, np.deg2rad(30.0), np.log(1.6)


def _matches(rng: np.random.Generator, rounded: bool) -> Matches:
    """Return keypoints of which a part moved by one affine map, with noise."""
    count = int(rng.integers(3, 60))
    view = np.column_stack([rng.uniform(0, 300, (count, 2)), rng.uniform(3, 20, count),
                            rng.uniform(0, 360, count)])  # fmt: skip
    angle, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.0)
    turned = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = turned @ [[1.0, rng.uniform(-0.3, 0.3)], [0.0, rng.uniform(0.7, 1.3)]]
    query = view.copy()
    query[:, :2] = view[:, :2] @ turned.T + rng.normal(0, rng.choice([0.0, 1.0, 4.0]), (count, 2))
    query[:, 2] *= scale * np.exp(rng.normal(0, 0.1, count))
    query[:, 3] += np.rad2deg(angle) + rng.normal(0, 5, count)
    wrong = rng.random(count) > rng.uniform(0, 1)
    query[wrong, :2] = rng.uniform(0, 300, (int(wrong.sum()), 2))
    return (query.round(), view.round()) if rounded else (query, view)


def _followed_from_each(query: NDArray[np.float64], view: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return who agrees with the best map when every match's map is refined to its end."""
    turn = np.deg2rad(query[:, 3] - view[:, 3])
    log_scale = np.log(np.maximum(query[:, 2], 1e-3) / np.maximum(view[:, 2], 1e-3))
    best, best_count, best_error = np.zeros(len(query), bool), 0, np.inf
    for i in range(len(query)):
        size = np.exp(log_scale[i])
        c, d = size * np.cos(turn[i]), size * np.sin(turn[i])
        x = query[i, 0] - c * view[i, 0] + d * view[i, 1]
        y = query[i, 1] - d * view[i, 0] - c * view[i, 1]
        current = np.array([[c, -d, x], [d, c, y]])
        for step, factor in enumerate((3.0, 1.5, 1.0, 1.0)):
            found, count, error = _agreeing(
                current, query, view, turn, log_scale, factor * _REACH_PX, _TURN, _LOG_SCALE
            )
            if step >= 2 and (count, -error) > (best_count, 1e-9 - best_error):
                best, best_count, best_error = found, count, error
            if count < 3 or step == 3:
                break
            current, is_good = _least_squares_affine(query, view, found)
            if not is_good:
                break
    return best


@pytest.mark.parametrize("rounded", [False, True])
def test_no_agreement_is_lost_by_following_each_one_once(rounded: bool) -> None:
    rng = np.random.default_rng(3)
    several = 0
    for _ in range(150):
        query, view = _matches(rng, rounded)
        expected = _followed_from_each(query, view)
        _, found = _affine_consensus(query, view, _REACH_PX, _TURN, _LOG_SCALE)
        # Who lies right on the border may depend on a last digit; to lose an agreement costs more.
        assert abs(int(found.sum()) - int(expected.sum())) <= 1
        several += found.sum() >= 10
    assert several > 20
