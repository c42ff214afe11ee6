"""The study of remembered paths: both ways meet the same tables, and the rule decides."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import pytest

from rtask.cli import main
from simulate.study.paths.command import summary_of
from simulate.study.paths.trial import run_trial

SETTINGS = {"seed": 5, "robot": "panda", "before": 1, "things": 2}


def row(checks, work, way_s=10.0, *, reached=True):
    return {
        "reached": reached, "way_s": way_s if reached else None, "origins": {"planned": 1},
        "checks": checks, "of_first": checks, "shortening": 0, "work": work, "cpu_s": work / 1e4,
    }  # fmt: skip


def table(anew, recalled):
    return {"kind": "open", "things": [{"anew": anew, "recalled": recalled}]}


@pytest.mark.parametrize(
    ("recalled", "verdict"),
    [
        (row(20, 500), "less work, as much is reached, and ways are as short: used"),
        (row(20, 1000), "no less work for whole plans: not used"),
        (row(20, 500, 12.0), "ways are longer: not used"),
        (row(20, 500, reached=False), "less is reached: not used"),
    ],
)
def test_recalled_paths_are_used_where_the_rule_says_so(recalled, verdict):
    summary = summary_of([table(row(100, 1000), recalled)] * 4)
    assert summary["tables"]["open"]["verdict"] == verdict


def test_things_with_straight_ways_alone_are_not_compared():
    straight = {**row(100, 1000), "origins": {"straight": 3}}
    summary = summary_of([table(straight, straight), table(row(100, 900), row(50, 450))])
    assert summary["tables"]["open"]["searched"] == 1
    assert summary["tables"]["open"]["median_checks"] == [100.0, 50.0]


def test_a_trial_plans_the_same_things_both_ways_and_again():
    first, again = (run_trial(SETTINGS, 1) for _ in range(2))
    assert first["kind"] == "boards"
    assert len(first["things"]) == 2
    for thing, same in zip(first["things"], again["things"], strict=True):
        assert "recalled" not in thing["anew"]["origins"]
        for way in ("anew", "recalled"):
            counted = [{k: v for k, v in t[way].items() if k != "cpu_s"} for t in (thing, same)]
            assert counted[0]["checks"] == counted[1]["checks"]
            assert counted[0]["way_s"] == counted[1]["way_s"]


@pytest.mark.deep
def test_the_command_prints_its_figures_as_json(tmp_path: Path, capsys) -> None:
    options = ["-n", "2", "--before", "1", "--things", "1", "--out", str(tmp_path / "out")]
    with suppress(SystemExit):
        main(["study", "paths", *options, "--json"])
    printed = json.loads(capsys.readouterr().out)
    assert set(printed["tables"]) == {"open", "boards"}
