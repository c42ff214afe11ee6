"""The factory's promises are fitted over hands that differ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from grasp.spatial.scoring.promises import FactoryMap
from simulate.study.quality.made_hands import made_hand, studied_hand
from simulate.study.quality.promise_fit import fit_promises, tried_grasps
from simulate.study.quality.promise_report import describe_fit

TRUTH = FactoryMap(1.0, 0.7, 0.5, -0.9, 1.2, 0.7)


def _results(offset_std: float, hands: int = 24, objects: int = 40) -> list[dict[str, Any]]:
    """Return outcomes of hands whose own offsets differ."""
    rng = np.random.default_rng(5)
    results = []
    for number in range(hands):
        hand, own = made_hand(3, number), rng.normal(0, offset_std)
        for _ in range(objects):
            score, load = float(rng.uniform(0.02, 0.95)), float(np.exp(rng.uniform(-2.5, -0.2)))
            chance = TRUTH.chance(score, load, hand.max_opening)
            odds = np.log(chance / (1 - chance)) + own
            held = (rng.random(3) < 1 / (1 + np.exp(-odds))).tolist()
            promised = {"lift": score, "carry": score, "load": load}
            results.append({
                "hand": hand.name,
                "rules": {"planned": {"promised": promised, "held": held, "carried": held}},
                "ranked": [{**promised, "held": held[:1], "carried": held[:1]}],
            })  # fmt: skip
    return results


@pytest.mark.parametrize(("offset_std", "least", "most"), [(0.0, 0.0, 0.25), (0.8, 0.35, 1.1)])
def test_the_fit_finds_the_truth_and_how_much_hands_differ(
    offset_std: float, least: float, most: float
) -> None:
    # Slopes take a share of what differs, as most scores lie on one side of .5.
    grasps = tried_grasps(_results(offset_std), "carried", "carry")
    assert len(grasps) == 2 * 24 * 40
    fitted = fit_promises(grasps)
    # Three standard errors of 24 hands, whose mean alone varies by .16 at .8.
    assert np.abs(np.subtract(fitted.factory.numbers, TRUTH.numbers)).max() < 0.5 + offset_std / 2
    assert fitted.factory.numbers[1] == pytest.approx(0.7, abs=0.15)
    assert least <= fitted.offset_std <= most
    assert fitted.likeness < 0.15


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
