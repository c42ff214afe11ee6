"""The study of the price of asking: the same labs under several rules, and what they cost."""

from __future__ import annotations

import pytest

from simulate.study.asking.command import summary_of
from simulate.study.asking.trial import run_trial

pytestmark = pytest.mark.slow

SETTINGS = {"seed": 4, "things": 2, "goals": 1, "moved": 0.0, "failing": 60.0, "asking": [0.0, 1e6]}


@pytest.mark.deep
def test_a_question_that_costs_too_much_is_never_asked_and_a_free_one_always():
    result = run_trial(SETTINGS, 0)
    assert result["never"]["questions"] == 0
    assert result["1e+06"] == result["never"]
    assert result["always"]["questions"] > 0
    assert result["0"] == result["always"]
    assert all(row["goals"] == 1 for row in result.values())


def test_costs_are_compared_with_the_better_of_the_rules_that_do_not_weigh():
    def row(questions: int, failed: int) -> dict[str, int]:
        return {"goals": 3, "questions": questions, "failed": failed, "reached": 3, "declined": 0}

    lab = {"never": row(0, 4), "always": row(9, 1), "5": row(4, 1), "40": row(0, 4)}
    summary = summary_of([lab] * 3, {"failing": 60.0, "asking": [5.0, 40.0]})
    cheap, dear = summary["prices"]
    assert (cheap["cost"], cheap["never"], cheap["always"]) == (80.0, 240.0, 105.0)
    assert (cheap["better"], cheap["saved"], cheap["questions"]) == ("always", 25.0, 12)
    assert (dear["better"], dear["saved"], dear["saved_95"]) == ("never", 0.0, [0.0, 0.0])
    assert summary["rules"]["never"]["failed"] == 12
