"""Measures by hand and the coverage of their intervals."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.learning.metrics import (
    NEVER,
    Life,
    attempts,
    bootstrap,
    difference,
    first_try,
    regret,
)


def _life(*needed: int) -> Life:
    return Life(np.arange(len(needed)), np.array(needed), 0.5 * (np.array(needed) - 1))


def test_measures_by_hand() -> None:
    life = _life(1, 3, 1, NEVER)
    assert attempts(life).tolist() == [1, 3, 1, 13]
    assert first_try(life).tolist() == [1, 0, 1, 0]
    assert regret(life).tolist() == [0, 1, 1, 7]
    assert life.part(slice(1, 3)).attempts.tolist() == [3, 1]
    assert bootstrap([life, _life(1, 1, 1, 1)], first_try).value == 0.75


def test_an_interval_holds_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    held = 0
    for k in range(100):
        lives = [_life(*rng.geometric(0.5, 20).clip(1, NEVER)) for _ in range(8)]
        measure = bootstrap(lives, draws=100, seed=k)
        held += measure.low <= 2.0 <= measure.high
    # Drawing lives and objects is a little wide; 95 of 100 at least within four standard errors.
    assert held >= 87


def test_a_difference_is_taken_object_by_object() -> None:
    first = Life(np.array([2, 0, 1]), np.array([3, 1, 2]), np.zeros(3))
    second = Life(np.array([0, 1, 2]), np.array([2, 3, 4]), np.zeros(3))
    measure = difference([first], [second])
    assert (measure.value, measure.low, measure.high) == (-1.0, -1.0, -1.0)


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1\.\.13"):
        _life(0, 1)
    with pytest.raises(ValueError, match="one length"):
        Life(np.arange(2), np.ones(2, dtype=int), np.zeros(3))
    with pytest.raises(ValueError, match="nothing to measure"):
        bootstrap([])
    with pytest.raises(ValueError, match="same objects"):
        difference([_life(1, 1)], [_life(1, 1, 1)])
