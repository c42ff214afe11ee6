"""The study of tasks: random goals, an event in each, and what is counted."""

from __future__ import annotations

import json

import pytest

from rtask.cli import main
from simulate.study.tasks.command import summary_of
from simulate.study.tasks.trial import EVENTS, run_trial

pytestmark = pytest.mark.slow

SETTINGS = {"seed": 5, "things": 3, "slip": 0.1}
RESULT = {
    "goal": "g", "event": "", "result": "reached", "robots": 2, "steps": 4, "repairs": 1,
    "possible": True,
    "deeds": 4, "lost": 0, "wrong": 0, "twice": 0, "repair_s": 0.1,
}  # fmt: skip


@pytest.mark.parametrize("event", EVENTS)
def test_each_event_ends_as_it_can_and_nothing_is_lost_or_done_twice(event):
    result = run_trial({**SETTINGS, "events": [event]}, 0)
    ends = {"declined": "declined", "taken_away": "given_up"}
    expected = ends.get(event, "reached" if result["possible"] else "given_up")
    assert (result["event"], result["result"]) == (event, expected)
    assert (result["lost"], result["wrong"], result["twice"]) == (0, 0, 0)


def test_a_trial_is_determined_by_its_seed():
    settings = {**SETTINGS, "events": ["moved"]}
    first, again = (run_trial(settings, 3) for _ in range(2))
    assert {**first, "repair_s": 0} == {**again, "repair_s": 0}


def test_goals_that_nobody_could_reach_are_counted_apart():
    summary = summary_of(
        [
            RESULT,
            {**RESULT, "result": "given_up"},
            {**RESULT, "event": "declined", "result": "declined"},
            {**RESULT, "event": "taken_away", "result": "given_up", "robots": 1, "possible": False},
        ]
    )
    assert (summary["goals"], summary["possible"], summary["reached"]) == (4, 2, 1)
    assert summary["handovers"] == 3
    assert summary["by_event"]["taken_away"]["given up"] == 1


def test_the_command_writes_a_report(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["study", "tasks", "-n", "1", "--things", "3", "--no-events", "--slip", "0",
              "--workers", "1", "--out", str(tmp_path), "--json"])  # fmt: skip
    assert not ended.value.code
    summary = json.loads(capsys.readouterr().out)
    assert (summary["goals"], summary["reached"]) == (1, 1)
    assert json.loads((tmp_path / "report.json").read_text()) == summary
