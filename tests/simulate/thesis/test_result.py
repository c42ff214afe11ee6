"""How figures are compared with a thesis's."""

from __future__ import annotations

import pytest

from simulate.thesis.result import (
    Compared,
    Result,
    Setting,
    counted,
    is_busy,
    overall,
    share_of,
)


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        (Compared("x", 1.0, None), "not compared"),
        (Compared("x", None, 1.0), "not compared"),
        (Compared("x", 1.0, 1.0), "too few to tell"),
        (counted("x", 1.0, 1.0), "reproduced"),
        (counted("x", 1.0, 2.0), "different"),
        (Compared("x", 0.9, 0.8, interval=(0.79, 0.95)), "reproduced"),
        (Compared("x", 0.9, 0.8, tolerance=0.1, reason="noise"), "reproduced"),
        (Compared("x", 0.9, 0.8, interval=(0.85, 0.95), better="higher"), "better"),
        (Compared("x", 0.9, 0.8, interval=(0.85, 0.95), better="lower"), "worse"),
        (Compared("x", 0.9, 0.8), "different"),
    ],
)
def test_a_figure_is_judged_by_interval_then_tolerance_then_direction(
    row: Compared, verdict: str
) -> None:
    assert row.verdict == verdict


def test_a_share_of_few_trials_is_not_called_reproduced() -> None:
    assert share_of("held", 2, 2, 0.9).verdict == "too few to tell"
    assert share_of("held", 95, 100, 0.9).verdict == "reproduced"


def test_a_share_of_no_trial_is_not_compared() -> None:
    assert share_of("held", 0, 0, 0.9).ours is None
    assert share_of("held", 0, 0, 0.9).verdict == "not compared"


def test_a_tolerance_needs_its_reason() -> None:
    with pytest.raises(ValueError, match="needs a reason"):
        Compared("x", 1.0, 2.0, tolerance=1.0)


def test_one_worse_row_makes_the_whole_worse() -> None:
    assert overall(["better", "worse", "reproduced"]) == "worse"
    assert Result((counted("a", 1, 1), Compared("b", 2, None))).verdict == "reproduced"
    assert Result().verdict == "not compared"


def test_a_shrunk_size_is_said_and_a_whole_one_is_not() -> None:
    assert Setting(fast=True).shrunk("trials", 15, 2) == ("trials: 2 instead of 15 (--fast)",)
    assert Setting(fast=False).shrunk("trials", 15, 2) == ()
    assert Setting(fast=True).shrunk("trials", 2, 15) == ()


@pytest.mark.parametrize(("load", "busy"), [(0.3, False), (2.0, False), (2.1, True)])
def test_a_machine_is_busy_where_more_wants_to_run_than_it_has_cores(
    monkeypatch: pytest.MonkeyPatch, load: float, busy: bool
) -> None:
    monkeypatch.setattr("os.getloadavg", lambda: (load, 9.0, 9.0))
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1})
    assert is_busy() is busy
