"""The study of a day: what robots remember of it is judged by a log that the graph never sees."""

from __future__ import annotations

import json

import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from simulate.study.day import happenings, questions
from simulate.study.day.command import summary_of
from simulate.study.day.lab import Lab, Place
from simulate.study.day.robots import BASE, Robot
from simulate.study.day.trial import run_trial
from simulate.world.seeds import stream

pytestmark = pytest.mark.slow

SETTINGS = {"seed": 3, "hours": 0.4, "things": 9, "questions": 48, "samples": 30}


@pytest.fixture(scope="module")
def result():
    return run_trial(SETTINGS, 0)


def test_a_day_is_remembered_and_nothing_is_at_two_places(result):
    asked = list(result["verdicts"].values())
    assert sum(sum(counts.values()) for counts in asked) == SETTINGS["questions"]
    right, wrong = (sum(counts[verdict] for counts in asked) for verdict in ("right", "wrong"))
    assert right > 2 * SETTINGS["questions"] / 3
    assert wrong <= 2
    assert (result["two_places"], result["taken_for_another"]) == (0, 0)
    assert result["things_in_graph"] >= SETTINGS["things"] - 2
    assert result["newcomer"]["found_at_first_look"] >= result["newcomer"]["looked_for"] - 1
    assert result["deeds"]["looks"] > 10


def test_answers_that_contradict_the_truth_count_as_wrong(monkeypatch):
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        day = happenings.live_day(engine, {**SETTINGS, "hours": 0.2, "samples": 0})
        for thing in day.lab.items:
            thing.log[:] = [Place("on", "table-a", place.since_s - 5000.0, "nobody", (99.0, 9.0))
                            for place in thing.log[:1]]  # fmt: skip
        monkeypatch.setattr(questions, "SURE", 0.0)
        asked = questions.ask_all(day, 24, stream(1, 1))
    of_places = [one for one in asked if one.kind == "where"]
    assert any(one.verdict == "wrong" for one in of_places)
    assert not any(one.verdict == "right" for one in of_places)


def test_the_truth_knows_where_a_thing_was_and_until_when():
    lab = Lab.made(stream(1, 2), 9, 100.0)
    assert (len(lab.items), len(lab.pairs), len(lab.single)) == (9, 1, 7)
    thing = lab.single[0]
    first = thing.now
    lab.move(thing, Place("in", "left box", 200.0, "nao-1"))
    assert (thing.at(150.0), thing.at(250.0), thing.at(50.0)) == (first, thing.now, None)
    assert (thing.until(first), thing.until(thing.now)) == (200.0, None)
    other = lab.single[1]
    lab.nudge(other, 300.0)
    assert len(other.log) == 1, "a nudge is no move"
    for _ in range(200):
        lab.nudge(other, 400.0)
    assert other.now.since_s == 400.0, "but many are"
    assert other.now.mover == ""


def test_several_days_are_summed(result):
    summary = summary_of([result, result])
    assert summary["questions"] == 2 * SETTINGS["questions"]
    shares = [summary[verdict] for verdict in ("right", "not known", "wrong")]
    assert sum(shares) == pytest.approx(1.0)
    assert summary["calibration"]["all"]["samples"] == 2 * result["calibration"]["all"]["samples"]


def test_the_command_writes_a_report(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["study", "day", "--hours", "0.1", "--things", "4", "--questions", "6", "--samples",
              "5", "--workers", "1", "--out", str(tmp_path), "--json"])  # fmt: skip
    assert not ended.value.code
    summary = json.loads(capsys.readouterr().out)
    assert summary["questions"] <= 6
    assert json.loads((tmp_path / "report.json").read_text()) == summary


def test_things_are_named_in_the_order_of_the_lab_whatever_their_new_iris():
    lab = Lab.made(stream(1, 2), 4, 0.0)
    identified = {f"urn:{9 - number}": item for number, item in enumerate(lab.items)}
    robot = Robot("nao-1", None, lab, stream(1, 3), "table-a", identified)
    assert robot._in_order(sorted(identified)) == list(identified)
