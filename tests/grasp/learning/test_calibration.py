"""A robot's own map from scores to chances: where it starts, how it moves, how it is rebuilt."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.learning.calibration import IDENTITY, ScoreMap, band_margin, fit_map


def _outcomes(n: int, offset: float, slope: float, seed: int = 0) -> list[tuple[float, bool]]:
    rng = np.random.default_rng(seed)
    scores = rng.uniform(0.05, 0.95, n)
    chance = 1 / (1 + np.exp(-(offset + slope * np.log(scores / (1 - scores)))))
    return [(float(s), bool(h)) for s, h in zip(scores, rng.random(n) < chance, strict=True)]


def test_without_outcomes_scores_are_believed() -> None:
    assert fit_map([]) is IDENTITY
    for score in (0.1, 0.5, 0.9):
        assert IDENTITY.chance(score) == pytest.approx(score)
    assert IDENTITY.chance(1.0) == pytest.approx(0.98)
    assert IDENTITY.chance(0.0) == pytest.approx(0.02)


def test_the_map_does_not_depend_on_the_order_of_outcomes() -> None:
    told = _outcomes(60, -1.0, 0.7)
    shuffled = [told[i] for i in np.random.default_rng(1).permutation(60)]
    assert fit_map(told) == fit_map(shuffled)


@pytest.mark.parametrize("score", [float("nan"), float("inf")])
def test_a_score_that_is_not_finite_does_not_count(score: float) -> None:
    told = _outcomes(50, -0.5, 0.8)
    assert fit_map([(score, True), *told]) == fit_map(told)
    assert fit_map([(score, True)]) is IDENTITY


def test_many_outcomes_find_what_scores_are_worth() -> None:
    found = fit_map(_outcomes(20_000, -1.0, 0.7))
    # Standard errors at 20,000 outcomes are below .02.
    assert found.offset == pytest.approx(-1.0, abs=0.06)
    assert found.slope == pytest.approx(0.7, abs=0.06)
    assert found.outcomes == 20_000


def test_few_outcomes_move_it_little_and_make_it_surer() -> None:
    few, more = fit_map(_outcomes(5, -1.0, 0.7)), fit_map(_outcomes(200, -1.0, 0.7))
    assert abs(few.offset) < abs(more.offset)
    assert more.variances[0] < few.variances[0] < IDENTITY.variances[0]
    gaps = [m.chance(0.7) - m.lower(0.7) for m in (IDENTITY, few, more)]
    assert gaps[0] > gaps[1] > gaps[2] > 0


def test_a_better_score_never_means_a_smaller_chance() -> None:
    upside_down = fit_map([(0.9, False), (0.1, True)] * 300)
    assert upside_down.slope == 0.0
    assert upside_down.chance(0.9) == upside_down.chance(0.1) == pytest.approx(0.5, abs=0.01)


def test_all_held_and_none_held_stay_finite() -> None:
    always, never = fit_map([(0.9, True)] * 500), fit_map([(0.9, False)] * 500)
    assert 0.95 < always.chance(0.9) < 1
    assert 0 < never.chance(0.9) < 0.05
    assert np.isfinite([*always.variances, always.covariance, never.offset]).all()


def test_a_prior_is_where_it_starts() -> None:
    factory = ScoreMap(-0.5, 0.8, (0.25, 0.04))
    assert fit_map([], factory) is factory
    assert fit_map([(0.5, True), (0.5, False)], factory).offset == pytest.approx(-0.5, abs=0.15)


def test_nine_of_ten_new_objects_hold_at_least_what_the_band_says() -> None:
    rng = np.random.default_rng(4)
    covered = []
    for _ in range(200):
        chances = rng.uniform(0.5, 1.0, 200)
        # Promises that are wrong in a way that no map mends: shares scatter around something else.
        shares = np.clip(rng.normal(0.9 * chances - 0.1, 0.15), 0, 1)
        margin = band_margin(chances[:100], shares[:100])
        covered.append(float((shares[100:] >= chances[100:] - margin).mean()))
    # The mean of 200 coverages of 100 objects each has a standard deviation of about .003.
    assert np.mean(covered) == pytest.approx(0.9, abs=0.015)


def test_a_band_from_too_few_objects_is_refused() -> None:
    assert band_margin(np.full(9, 0.5), np.linspace(0.1, 0.9, 9)) == pytest.approx(0.4)
    with pytest.raises(ValueError, match="8 objects are too few"):
        band_margin(np.full(8, 0.5), np.full(8, 0.5))


def test_an_outcome_of_weight_two_counts_as_two_and_one_of_weight_nothing_not_at_all():
    told = _outcomes(40, -0.5, 1.2)
    twice = fit_map([*told, *told])
    weighed = fit_map([*told, (0.9, False)], weights=[2.0] * len(told) + [0.0])
    assert weighed.offset == pytest.approx(twice.offset, abs=1e-9)
    assert weighed.slope == pytest.approx(twice.slope, abs=1e-9)
    assert weighed.variances == pytest.approx(twice.variances, abs=1e-9)
    with pytest.raises(ValueError, match="zip"):
        fit_map(told, weights=[1.0])
