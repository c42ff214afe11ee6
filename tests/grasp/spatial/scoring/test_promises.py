"""Promises follow scores, loads and a hand's own outcomes."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.gripper import nao_hand, panda_hand, parallel_jaw
from grasp.spatial.scoring.promises import FACTORY, TRIED, UNTRIED, Promises

OTHER = Promises()


def _scores(score: float, load: float = 0.3) -> dict[str, float]:
    return {"lift": score, "carry": score, "load": load}


@pytest.mark.parametrize("name", ["lift", "carry"])
def test_a_promise_never_falls_with_the_score_nor_rises_with_the_weight(name: str) -> None:
    factory = FACTORY[name]
    scores = np.linspace(0, 1, 101)
    for stroke in (0.01, 0.05, 0.08, 0.3):
        chances = [factory.chance(score, 0.3, stroke) for score in scores]
        assert (np.diff(chances) >= 0).all()
        heavier = [factory.chance(0.6, load, stroke) for load in (0.0, 0.1, 0.3, 0.9)]
        assert (np.diff(heavier) <= 0).all()
    assert 0 <= factory.at_least(0.02) <= factory.at_least(0.5) < factory.at_least(0.98) < 0.98


def test_what_is_carried_was_lifted_so_never_more_is_promised_of_it() -> None:
    # A thing of few grams: by the maps alone, pads that meet it badly carry it nearly always.
    light = {"lift": 0.7, "carry": 0.7, "load": 0.01}
    for hand in (panda_hand(), nao_hand(), parallel_jaw(0.1)):
        before = Promises.by(hand)
        for by in (before, before.after([(light, {"lift": False, "carry": True})] * 30)):
            assert by.of(light)["carry_chance"] <= by.of(light)["lift_chance"]
        # Outcomes of carrying alone say that it was lifted, too.
        carried = before.after([(light, {"carry": True})] * 30).of(light)
        assert carried["lift_chance"] >= carried["carry_chance"] > before.of(light)["carry_chance"]


def test_leaning_pads_are_promised_less_of_carrying_and_no_grasp_everything() -> None:
    by = Promises.by(panda_hand())
    usual = {"lift": 0.98, "carry": 0.5, "load": 0.3}
    chances = [by.of({**usual, "taper": taper})["carry_chance"] for taper in (0, 0.5, 1, 2, 9)]
    assert chances[0] > chances[1] > chances[2] > chances[3] == chances[4] > 0
    assert chances[0] > by.of(usual)["carry_chance"] > chances[1]
    best = by.of({**_scores(1.0, 0.0), "taper": 0.0})
    assert 0.95 < best["carry_chance"] <= 0.98


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
    odds = [np.log(p / (1 - p)) for p in (FACTORY["carry"].chance(s, 0.3) for s in scores)]
    truth = 1 / (1 + np.exp(-(1.8 * (np.array(odds) - 1.5) + 1.5)))
    told = [
        (_scores(score), {"carry": bool(held)})
        for score, held in zip(scores, rng.random(400) < truth, strict=True)
    ]
    after = OTHER.after(told)
    assert after == OTHER.after(told[::-1])
    assert after.own["carry"].slope > 1.2
    assert "lift" not in after.own
    assert after.of({"lift": 0.5}) == OTHER.of({"lift": 0.5})
    gap = [abs(p.of(_scores(s))["carry_chance"] - t).mean() for p in (OTHER, after)
           for s, t in [(0.08, np.interp(0.08, np.sort(scores), np.sort(truth)))]]  # fmt: skip
    assert gap[1] < gap[0]


def test_outcomes_without_the_scores_teach_nothing() -> None:
    assert OTHER.after([({"confidence": 0.5}, {"lift": True})]) == OTHER
    assert OTHER.after([(_scores(0.5), {})]) == OTHER


def test_a_smaller_hand_is_promised_less_for_the_same_score() -> None:
    for score, least in (("lift", 0.02), ("carry", 0.05)):
        scores = {score: 0.5, "load": 0.3}
        small, large = Promises(0.05).of(scores), Promises(0.08).of(scores)
        assert small[f"{score}_chance"] < large[f"{score}_chance"] - least


def test_hands_that_were_tried_have_maps_of_their_own() -> None:
    by = Promises.by(nao_hand())
    assert (by.stroke, by.hand) == (0.05, "nao_hand")
    assert by.maps is TRIED["nao_hand"]
    assert Promises.by(parallel_jaw(0.05)).maps is FACTORY
    assert Promises.by(panda_hand()).maps is TRIED["panda_hand"]
    assert by.after([(_scores(0.5), {"lift": True})]).maps is by.maps


def test_hands_differ_more_in_carrying_than_in_lifting_and_outcomes_count_by_that() -> None:
    after = OTHER.after([(_scores(0.5), {"lift": False, "carry": False})] * 10)
    moved = {name: abs(after.own[name].offset) for name in ("lift", "carry")}
    assert moved["carry"] > moved["lift"] > 0.1
    assert UNTRIED["carry"].variances[0] > UNTRIED["lift"].variances[0]
    assert after.outcomes == 10
