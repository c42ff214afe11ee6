"""Intervals of shares and means: against closed forms, and what is reported with them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulate.study.intervals import bootstrap, mean_interval, share, wilson

_Z = 1.959963984540054
"""97.5 % quantile of the normal distribution."""


@pytest.mark.parametrize(("hits", "n"), [(0, 1), (1, 1), (0, 5), (3, 7), (9, 10), (250, 1000)])
def test_wilson_is_the_closed_form_of_1927(hits: int, n: int) -> None:
    p, z2 = hits / n, _Z * _Z / n
    middle = (p + z2 / 2) / (1 + z2)
    half = _Z / (1 + z2) * math.sqrt(p * (1 - p) / n + z2 / (4 * n))
    expected = (max(0.0, middle - half), min(1.0, middle + half))
    assert wilson(hits, n) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("hits", "n"), [(-1, 3), (4, 3), (1, 0)])
def test_more_hits_than_tries_are_no_share(hits: int, n: int) -> None:
    with pytest.raises(ValueError, match=f"{hits} hits of {n}"):
        wilson(hits, n)


def test_a_share_is_reported_with_four_digits_of_its_interval() -> None:
    assert share(8, 10) == {"hits": 8, "n": 10, "share": 0.8, "interval95": [0.4902, 0.9433]}


def test_a_share_of_nothing_is_not_known() -> None:
    assert share(0, 0) == {"hits": 0, "n": 0, "share": None, "interval95": [0.0, 1.0]}


def test_the_bootstrap_of_a_mean_has_the_width_of_its_standard_error() -> None:
    values = np.random.default_rng(3).normal(2.0, 1.0, 400)
    low, high = bootstrap(lambda i: float(values[i].mean()), 400, draws=4000)
    half = _Z * values.std() / math.sqrt(400)
    # 4,000 draws give the end of an interval to some 4 % of its half width.
    assert low == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert high == pytest.approx(values.mean() + half, abs=0.15 * half)


def test_the_interval_is_of_percentiles_so_that_no_end_lies_outside_what_was_drawn() -> None:
    values = np.random.default_rng(4).exponential(1.0, 40)
    low, high = bootstrap(lambda i: float(values[i].max()), 40)
    assert low < high == values.max()


def test_the_bootstrap_draws_all_indices_anew_as_often_as_asked_and_by_its_seed() -> None:
    seen: list[np.ndarray] = []

    def first(indices: np.ndarray) -> float:
        seen.append(indices)
        return float(indices.mean())

    interval = bootstrap(first, 5, draws=50, seed=1)
    drawn = [tuple(indices) for indices in seen if len(set(indices)) < 5]
    assert {len(indices) for indices in seen} == {5}
    assert set(np.concatenate(seen)) == set(range(5))
    assert 35 <= len(drawn) <= len(seen) <= 55  # 4 % of draws repeat no index
    assert bootstrap(first, 5, draws=50, seed=1) == interval
    assert bootstrap(first, 5, draws=50, seed=2) != interval


def test_of_a_single_value_the_interval_is_the_value() -> None:
    assert bootstrap(lambda i: 7.0 + i[0], 1) == (7.0, 7.0)
    assert mean_interval([1.23456]) == {"mean": 1.2346, "n": 1, "interval95": [1.2346, 1.2346]}


def test_without_values_there_is_no_mean() -> None:
    assert mean_interval([]) == {"mean": None, "n": 0, "interval95": None}


def test_a_mean_is_reported_with_its_bootstrap_of_a_thousand_draws() -> None:
    values = np.random.default_rng(5).random(30)
    report = mean_interval(values)
    low, high = bootstrap(lambda i: float(values[i].mean()), 30, draws=1000, seed=0)
    assert report["mean"] == round(float(values.mean()), 4)
    assert report["n"] == 30
    assert report["interval95"] == [round(low, 4), round(high, 4)]
