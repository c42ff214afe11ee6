"""Comparison of the robots' own judgements with the truth."""

from __future__ import annotations

from typing import Any

import pytest

from simulate.study.judging import (
    COLUMNS,
    filling_trial,
    judging_rows,
    judging_study,
    judging_trial,
    summarise_judging,
)


def result(held: str, placed: str, truly_held: bool, truly_placed: bool) -> dict[str, Any]:
    return {
        "planned": True, "reason": "ok", "held": held, "placed": placed, "frames": 2,
        "truth": {"held": truly_held, "placed": truly_placed},
    }  # fmt: skip


def test_unknown_is_neither_a_false_yes_nor_a_false_no():
    summary = summarise_judging(
        [
            result("yes", "yes", True, True),
            result("yes", "unknown", True, True),
            result("yes", "yes", False, False),
            result("no", "no", True, False),
            {"planned": False, "reason": "ik"},
        ]
    )
    assert (summary["trials"], summary["attempts"]) == (5, 4)
    assert summary["not_held"]["hits"] == 1
    held, placed = summary["held"], summary["placed"]
    assert (held["right"]["hits"], held["false_yes"]["hits"], held["false_no"]) == (2, 1, 1)
    assert (placed["right"]["hits"], placed["false_yes"]["hits"]) == (2, 1)
    assert (placed["false_no"], placed["unknown"]) == (0, 1)
    assert all(len(row) == len(COLUMNS) for row in judging_rows("nao", summary))


def test_each_attempt_at_a_box_that_is_filled_counts():
    box = {
        "attempts": [
            result("yes", "yes", True, True),
            result("no", "no", False, False),
            {"planned": False, "reason": "ik"},
        ]
    }
    summary = summarise_judging([box, {"attempts": [result("yes", "unknown", True, True)]}])
    assert (summary["trials"], summary["attempts"]) == (2, 3)
    assert summary["placed"]["unknown"] == 1
    assert summary["reasons"] == {"ok": 3, "ik": 1}


@pytest.mark.deep
@pytest.mark.slow
def test_a_box_is_filled_and_only_what_is_in_it_stays():
    study = judging_study(1, seed=5, robot="panda", preset="fast", products="hard")
    assert "difficult" not in study.settings
    trial = filling_trial(study.settings, 0)
    tried = [one for one in trial["attempts"] if one["planned"]]
    assert len(trial["attempts"]) == 4
    assert {one["placed"] for one in tried} <= {"yes", "no", "unknown"}
    assert {one["product"].split("-")[0] for one in trial["attempts"]} <= {"bar", "flask", "carton"}
    assert any(one["truth"]["held"] for one in tried)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, pytest.param(4, marks=pytest.mark.deep)])
def test_a_trial_follows_from_its_seed_and_has_judgement_and_truth(count):
    study = judging_study(count, seed=3, robot="panda", preset="fast", difficult=0.0)
    trials = [judging_trial(study.settings, number) for number in range(count)]
    for trial in trials:
        assert (trial["held"] == "yes") == trial["truth"]["held"]
        assert (trial["placed"] == "yes") == trial["truth"]["placed"]
    # One of 24 easy attempts with this seed fails; which one is not the same on every machine.
    assert sum(trial["truth"]["placed"] for trial in trials) >= count - 1
    again = judging_trial(study.settings, 0)
    assert {**trials[0], "cpu_s": 0.0} == {**again, "cpu_s": 0.0}
