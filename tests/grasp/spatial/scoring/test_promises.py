"""Promises follow scores, loads and a hand's own outcomes."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.gripper import panda_hand
from grasp.spatial.scoring.promises import FACTORY, Promises

OTHER = Promises("some_hand")


def _scores(score: float, load: float = 0.3) -> dict[str, float]:
    return {"lift": score, "carry": score, "load": load}


@pytest.mark.parametrize("name", ["lift", "carry"])
def test_a_promise_never_falls_with_the_score_nor_rises_with_the_weight(name: str) -> None:
    factory = FACTORY[name]
    scores = np.linspace(0, 1, 101)
    for hand in ("panda_hand", "nao_hand", "another"):
        chances = [factory.chance(score, 0.3, hand) for score in scores]
        assert (np.diff(chances) >= 0).all()
        heavier = [factory.chance(0.6, load, hand) for load in (0.0, 0.1, 0.3, 0.9)]
        assert (np.diff(heavier) <= 0).all()
    assert 0 <= factory.at_least(0.02) <= factory.at_least(0.5) < factory.at_least(0.98) < 0.98


def test_poor_grasps_are_promised_little_whatever_their_rank() -> None:
    # The logit was cut at .02, so that grasps a hundred times worse were promised as much.
    poor = [FACTORY["carry"].chance(score, 0.4) for score in (0.02, 0.005, 0.001)]
    assert poor[0] > 1.5 * poor[1] > 1.5**2 * poor[2]


def test_scores_that_are_missing_are_not_promised_and_a_usual_load_is_assumed() -> None:
    promised = OTHER.of({"carry": 0.5})
    assert set(promised) == {"carry_chance", "carry_at_least"}
    assert OTHER.of({"carry": 0.5, "load": 0.05})["carry_chance"] > promised["carry_chance"]
    assert OTHER.of({}) == {}


def test_outcomes_move_offset_and_slope_and_come_in_any_order() -> None:
    rng = np.random.default_rng(4)
    scores = rng.uniform(0.05, 0.95, 400)
    # A hand whose good grasps are better and whose poor ones are worse than the factory's.
    odds = [np.log(p / (1 - p)) for p in (FACTORY["lift"].chance(s, 0.3) for s in scores)]
    truth = 1 / (1 + np.exp(-(1.8 * (np.array(odds) - 1.5) + 1.5)))
    told = [
        (_scores(score), {"lift": bool(held)})
        for score, held in zip(scores, rng.random(400) < truth, strict=True)
    ]
    after = OTHER.after(told)
    assert after == OTHER.after(told[::-1])
    assert after.own["lift"].slope > 1.2
    assert "carry" not in after.own
    assert after.of(_scores(0.5))["carry_chance"] == OTHER.of(_scores(0.5))["carry_chance"]
    gap = [abs(p.of(_scores(s))["lift_chance"] - t).mean() for p in (OTHER, after)
           for s, t in [(0.08, np.interp(0.08, np.sort(scores), np.sort(truth)))]]  # fmt: skip
    assert gap[1] < gap[0]


def test_outcomes_without_the_scores_teach_nothing() -> None:
    assert OTHER.after([({"confidence": 0.5}, {"lift": True})]) == OTHER
    assert OTHER.after([(_scores(0.5), {})]) == OTHER


def test_the_hands_of_the_fit_have_their_own_offsets() -> None:
    assert Promises.by(panda_hand()).hand == "panda_hand"
    at = {hand: FACTORY["carry"].chance(0.5, 0.3, hand) for hand in ("panda_hand", "nao_hand", "")}
    assert at["nao_hand"] < at[""] < at["panda_hand"]
