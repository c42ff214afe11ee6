"""Bayesian logistic regression: against its exact posterior, and when it takes over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasp.learning.logistic import LearnedQuality, LogisticRegression


def test_one_outcome_moves_the_belief_to_the_mode_of_the_posterior() -> None:
    model = LogisticRegression(1, prior_std=1.5)
    model.learn([0.8], True)
    grid = np.linspace(-6, 6, 241)
    w0, w1 = np.meshgrid(grid, grid, indexing="ij")
    log = -(w0**2 + w1**2) / (2 * 1.5**2) - np.log1p(np.exp(-(w0 + 0.8 * w1)))
    best = np.unravel_index(np.argmax(log), log.shape)
    assert model.mean == pytest.approx([grid[best[0]], grid[best[1]]], abs=0.05)  # the grid's step
    # The covariance is the inverse of the negative Hessian there.
    p = 1 / (1 + np.exp(-(model.mean @ [1, 0.8])))
    hessian = np.eye(2) / 1.5**2 + p * (1 - p) * np.outer([1, 0.8], [1, 0.8])
    assert model.covariance @ hessian == pytest.approx(np.eye(2), abs=1e-9)


def test_it_finds_the_weights_that_made_the_outcomes() -> None:
    rng = np.random.default_rng(4)
    true = np.array([0.5, -1.5, 2.0])
    model = LogisticRegression(2)
    for _ in range(1500):
        x = rng.normal(size=2)
        model.learn(x, bool(rng.random() < 1 / (1 + np.exp(-(true[0] + true[1:] @ x)))))
    errors = np.sqrt(np.diag(model.covariance))
    assert (np.abs(model.mean - true) < 4 * errors).all()
    assert errors.max() < 0.2


def test_a_surprising_outcome_does_not_break_the_belief() -> None:
    model = LogisticRegression(1)
    for _ in range(30):
        model.learn([3.0], True)
    sure = model.predict([3.0])[0]
    model.learn([3.0], False)
    assert np.linalg.eigvalsh(model.covariance).min() > 0
    assert 0.8 < model.predict([3.0])[0] < sure
    wide = LogisticRegression(1, prior_std=1e4)
    for success in (True, True, False):
        wide.learn([40.0], success)
    assert np.all(np.isfinite(wide.mean))
    assert np.all(np.isfinite(wide.covariance))


def _life(learned: LearnedQuality, outcomes: int, seed: int, misleading: bool) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(outcomes):
        x = rng.normal()
        chance = 1 / (1 + np.exp(-3 * x))
        quality = 1 - chance if misleading else chance
        learned.learn([x], float(quality), bool(rng.random() < chance))


def test_it_takes_over_from_a_misleading_quality_and_not_earlier() -> None:
    learned = LearnedQuality(1)
    _life(learned, 99, 0, misleading=True)
    assert not learned.in_charge
    assert learned.rate([[1.0]], [0.3]).tolist() == [0.3]
    _life(learned, 30, 1, misleading=True)
    assert learned.in_charge
    quality, model = learned.losses
    assert model < quality
    assert learned.rate([[1.0]], [0.05])[0] > 0.8


def test_a_quality_that_is_right_stays_in_charge() -> None:
    learned = LearnedQuality(1)
    _life(learned, 150, 2, misleading=False)
    assert not learned.in_charge  # nothing predicts better than the chance itself


def test_it_resumes_bit_for_bit(tmp_path: Path) -> None:
    first, second = LearnedQuality(1), LearnedQuality(1)
    _life(first, 120, 3, misleading=True)
    first.save(tmp_path / "quality.npz")
    second.load(tmp_path / "quality.npz")
    for learned in (first, second):
        _life(learned, 40, 5, misleading=False)
    assert (first.model.mean == second.model.mean).all()
    assert first.losses == second.losses
    with pytest.raises(ValueError, match="was learned with"):
        LearnedQuality(2).load(tmp_path / "quality.npz")


def test_what_is_no_number_is_refused() -> None:
    learned = LearnedQuality(1)
    with pytest.raises(ValueError, match="candidate 1"):
        learned.rate([[0.0], [0.0]], [0.5, float("nan")])
    with pytest.raises(ValueError, match="finite features"):
        learned.learn([np.nan], 0.5, True)
    with pytest.raises(ValueError, match="no model"):
        LogisticRegression(0)
