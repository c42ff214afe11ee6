"""One trial of each experiment in real physics, coarse to be quick."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from simulate.grasping.record import UNREACHABLE, phase_of
from simulate.study.grasping import grasping_trial
from simulate.study.grasping_report import (
    COLUMNS,
    grasping_rows,
    grasping_study,
    summarise_grasping,
)
from simulate.study.learning import outcomes
from simulate.study.learning.outcomes import outcome_trial
from simulate.study.learning.report import outcome_study


@pytest.mark.slow
@pytest.mark.deep
def test_a_trial_is_the_same_in_any_process_and_the_command_prints_nothing_but_figures(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "-m", "rtask", "study", "grasping", "-n", "1", "--seed", "6"]
    command += ["--preset", "fast", "--json", "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=200)
    summary = json.loads(done.stdout)
    assert summary["groups"]["all"]["held"]["n"] == 1
    assert (tmp_path / "run" / "held.png").stat().st_size > 1000
    (kept,) = json.loads((tmp_path / "run" / "report.json").read_text())["results"]
    here = grasping_trial(grasping_study(1, 6, preset="fast").settings, 0)
    assert json.loads(json.dumps(here)) == kept
    assert kept["perceived"]["centre_mm"] < 8
    assert kept["tries"] >= 1


@pytest.mark.slow
@pytest.mark.deep  # ten seconds; its small sibling has the arms without the physics
def test_every_grasp_of_an_object_has_its_outcome_from_the_same_start() -> None:
    study = outcome_study(1, 3, proposed=1, blind=1, preset="fast")
    result = outcome_trial(study.settings, 1)
    geometry = [arm for arm in result["arms"] if arm["source"] == "geometry"]
    assert sum(arm["reason"] != UNREACHABLE for arm in geometry) <= 1
    assert {arm["source"] for arm in result["arms"]} == {"geometry", "blind"}
    assert len(result["look"]) == 256
    assert any(result["look"])
    assert all(0 <= arm["quality"] <= 1 for arm in result["arms"])
    assert json.dumps(result)


@pytest.mark.slow
def test_grasps_are_tried_until_one_holds_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    ends = iter([UNREACHABLE, "missed", "ok", "missed", "ok"])
    monkeypatch.setattr(outcomes._Bench, "_outcome", lambda *_: {"reason": next(ends)})
    study = outcome_study(1, 3, proposed=1, blind=1, preset="fast")
    result = outcome_trial(study.settings, 1)
    assert [(arm["source"], arm["reason"]) for arm in result["arms"]] == [
        ("geometry", UNREACHABLE), ("geometry", "missed"), ("geometry", "ok"),
        ("blind", "missed"), ("blind", "ok"),
    ]  # fmt: skip
    assert result["says"].endswith(": 2 of 4 held")
    assert (len(result["look"]), any(result["look"])) == (256, True)
    assert all(0 <= arm["quality"] <= 1 for arm in result["arms"])
    assert json.dumps(result)


def _result(kind: str, held: bool, reason: str, place: str = "ok") -> dict[str, Any]:
    attempt = {"reason": "ok" if held else reason, "held": held, "placed": place == "ok",
               "place_reason": place if held else "", "physical": reason != "ik"}  # fmt: skip
    return {
        "kind": kind, "arm": "left", "in_reach": reason != "ik", "perceived": {},
        "attempts": [attempt], "held": held, "held_first": held, "reason": reason,
        "placed_first": attempt["placed"] if held else None,
        "tries_to_success": 1 if held else None,
    }  # fmt: skip


def test_what_failed_is_counted_by_the_phase_of_its_reason() -> None:
    summary = summarise_grasping(
        [
            _result("can", True, "ok"),
            _result("can", True, "ok", "drop_outside"),
            _result("pen", False, "slip_lift"),
            _result("pen", False, "ik"),
        ]
    )
    whole = summary["groups"]["all"]
    assert (whole["held"]["hits"], whole["held"]["n"]) == (2, 4)
    assert (whole["held_in_reach"]["hits"], whole["held_in_reach"]["n"]) == (2, 3)
    assert (whole["placed_of_held"]["hits"], whole["placed_of_held"]["n"]) == (1, 2)
    assert summary["reasons_of_objects_not_held"] == {"plan": {"ik": 1}, "lift": {"slip_lift": 1}}
    assert summary["reasons_not_placed"] == {"place": {"drop_outside": 1}, "ok": {"ok": 1}}
    assert {len(row) for row in grasping_rows(summary)} == {len(COLUMNS)}
    assert phase_of("rrt_time") == "plan"
