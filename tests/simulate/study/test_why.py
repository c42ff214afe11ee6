"""The study of causes: failures are injected, the question asked, the change carried out."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.study.why.command import summary_of
from simulate.study.why.trial import run_trial
from simulate.study.why.truth import KINDS, OPEN_KINDS, Deed, Truth

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", [4, 7])
def test_a_trial_tells_the_cause_from_the_truth_and_is_determined_by_its_seed(number):
    first = run_trial({"seed": 1}, number)
    assert first["kind"] == KINDS[number]
    assert first["is_right"] == (first["says"] == first["kind"])
    again = run_trial({"seed": 1}, number)
    assert {**first, "asked_s": 0} == {**again, "asked_s": 0}


def test_what_was_injected_makes_the_same_fail_again_and_its_cure_hold():
    truth = Truth("collision", "nao-1", np.random.default_rng(0))
    same = [truth.outcome(Deed("nao-1", 0.1), is_occasion=True)[0] for _ in range(50)]
    cured = [truth.outcome(Deed("nao-1", 0.1, before="clear"), is_occasion=True)[0]
             for _ in range(50)]  # fmt: skip
    assert sum(same) == 0
    assert sum(cured) >= 40  # one in twenty fails without a cause


@pytest.mark.parametrize("kind", OPEN_KINDS)
def test_nothing_mends_what_no_hypothesis_is_about_and_other_occasions_hold(kind):
    truth = Truth(kind, "nao-1", np.random.default_rng(0))
    for robot in ("nao-1", "panda-1"):
        for before in ("", "look", "recognise", "clear", "earlier", "ask", "grasp", "hand"):
            assert truth.fails(Deed(robot, 0.2, before=before), is_occasion=True)
        assert not truth.fails(Deed(robot, 0.2), is_occasion=False)


def test_the_right_answer_to_what_no_hypothesis_is_about_is_that_it_is_unknown():
    result = run_trial({"seed": 1, "is_open": True}, 1)
    assert result["kind"] == OPEN_KINDS[1]
    assert result["is_right"] == (result["says"] == "unknown")
    assert (result["holds"], result["again_holds"]) == (False, False)


def test_figures_count_causes_and_changes():
    result = {
        "kind": "late", "is_right": True, "is_among_three": True, "holds": False,
        "again_holds": False, "asked_s": 0.5, "mends": True,
    }  # fmt: skip
    summary = summary_of([result, {**result, "holds": True, "is_right": False}])
    assert (summary["right"], summary["held"], summary["again"]) == (1, 1, 0)
    assert (summary["said"], summary["said_held"]) == (2, 1)
    assert summary["by_kind"]["late"]["of these mended"] == 1
    assert summary["by_kind"]["late"]["failures"] == 2
