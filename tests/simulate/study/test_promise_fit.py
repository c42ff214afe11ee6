"""The factory's promises are fitted over hands that differ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from grasp.spatial.scoring.promises import FactoryMap, factory_chance
from simulate.study.quality.made_hands import made_hand, studied_hand
from simulate.study.quality.promise_fit import fit_promises, tried_grasps
from simulate.study.quality.promise_report import describe_fit

TRUTH = {
    "lift": FactoryMap(2.0, 0.7, 0.5, 0.0, 0.0, 0.8, 0.9, -0.2, 0.0, 0.7),
    "carry": FactoryMap(2.5, 0.5, 0.6, -1.5, 0.0, 1.0, 1.0, -0.3, -0.3, 0.7),
}


def _results(offset_std: float, hands: int = 24, objects: int = 40) -> list[dict[str, Any]]:
    """Return outcomes of hands whose own offsets in lifting differ."""
    rng = np.random.default_rng(5)
    results = []
    for number in range(hands):
        hand, own = made_hand(3, number), rng.normal(0, offset_std)
        for _ in range(objects):
            score, load = float(rng.uniform(0.02, 0.95)), float(np.exp(rng.uniform(-2.5, -0.2)))
            patch, taper, lever = np.exp(rng.uniform(np.log(0.03), np.log(0.4), 3)).tolist()
            promised = {
                "lift": score, "carry": score * rng.uniform(0.3, 1.0), "load": load,
                "patch": patch, "taper": taper, "lever": lever * hand.max_opening,
            }  # fmt: skip
            lift = factory_chance(TRUTH, "lift", promised, hand.max_opening)
            kept = factory_chance(TRUTH, "carry", promised, hand.max_opening) / lift
            odds = np.log(lift / (1 - lift)) + own
            held = rng.random(3) < 1 / (1 + np.exp(-odds))
            carried = (held & (rng.random(3) < kept)).tolist()
            results.append({
                "hand": hand.name,
                "rules": {
                    "planned": {"promised": promised, "held": held.tolist(), "carried": carried}
                },
                "ranked": [{**promised, "held": held[:1].tolist(), "carried": carried[:1]}],
            })  # fmt: skip
    return results


@pytest.mark.parametrize(("offset_std", "least", "most"), [(0.0, 0.0, 0.25), (0.8, 0.35, 1.1)])
def test_the_fit_finds_the_truth_and_how_much_hands_differ(
    offset_std: float, least: float, most: float
) -> None:
    grasps = tried_grasps(_results(offset_std))
    assert len(grasps) == 2 * 24 * 40
    fitted = fit_promises(grasps)
    for name, one in fitted.items():
        told = [
            (factory_chance({k: f.factory for k, f in fitted.items()}, name, g.scores, size),
             factory_chance(TRUTH, name, g.scores, size))
            for g in grasps for size in [g.hand.max_opening]
        ]  # fmt: skip
        error = np.abs(np.subtract(*np.transpose(told))).mean()
        # The mean of 24 hands alone varies by .16 in the log odds, .04 in the chance, at .8.
        assert error < 0.03 + 0.05 * offset_std, name
        assert one.likeness < 0.15
    assert least <= fitted["lift"].offset_std <= most


def test_what_is_not_lifted_is_promised_not_to_be_carried() -> None:
    fitted = fit_promises(tried_grasps(_results(0.4, 6, 20)))
    maps = {name: one.factory for name, one in fitted.items()}
    assert set(fitted["lift"].by_hand) == {f"made:3:{k}" for k in range(6)}
    for load in (0.02, 0.2, 0.8):
        scores = {"lift": 0.6, "carry": 0.6, "load": load}
        lift, carry = (factory_chance(maps, name, scores, 0.08) for name in maps)
        assert carry < lift


def test_a_hand_of_the_study_is_found_again_by_its_name() -> None:
    hand = made_hand(3, 7)
    assert studied_hand(hand.name) == hand
    assert studied_hand("panda").max_opening == 0.08
    strokes = [made_hand(3, k).max_opening for k in range(40)]
    assert 0.04 <= min(strokes) < 0.05 < 0.12 < max(strokes) <= 0.14


def test_a_run_too_small_for_a_fit_says_so(tmp_path) -> None:
    report = describe_fit(_results(0.0, 1, 3), {"seed": 1}, tmp_path)
    assert "nothing was fitted" in report.lines[0]
    whole = describe_fit(_results(0.3, 6, 12), {"seed": 1}, tmp_path)
    assert set(whole.figures["fits"]) == {"lift", "carry"}
    assert whole.tables[0].rows[0][0] == "offset"
