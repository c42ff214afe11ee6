"""Fleets with liars, under the same luck: lies cost until they are found out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from rtask.errors import UsageError
from simulate.fleet.trust import COLUMNS, summary_of, trust_rows, trust_study
from simulate.studies import study
from tests.simulate.fleet.tables import figures_of, table_of


def play(**more: Any) -> dict[str, Any]:
    table = table_of([k % 7 for k in range(10)])
    settings = {
        "fleets": 2, "robots": 6, "liars": 1, "on_table": 5, "rounds": 2, "cap": 6, "seed": 1,
        **more,
    }  # fmt: skip
    return figures_of(table, lambda path: trust_study(path, **settings), summary_of)


def test_lies_cost_and_weighing_reports_wins_some_of_it_back() -> None:
    found = play()
    conditions = found["conditions"]
    believed, left_out, weighed = (
        conditions[name]["change"] for name in ("believed", "left out", "weighed")
    )
    assert believed < left_out <= weighed <= 0.0
    assert (found["liars_named"], found["of_liars"]) == (2, 2)
    assert found["truthful_named"] == 0
    assert [len(row) for row in trust_rows(found)] == [len(COLUMNS)] * 6


def test_without_liars_all_conditions_are_the_same() -> None:
    found = play(liars=0, fleets=1)
    assert {one["change"] for one in found["conditions"].values()} == {0.0}
    assert found["weighed_less_left_out"]["change"] == 0.0
    assert found["of_liars"] == 0
    assert found["reports_until_named"] is None


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"liars": 6}, "fewer than"),
        ({"rounds": 0}, "at least 1"),
        ({"on_table": 11}, "the table has 10"),
        ({"lie": "often"}, "flipped, held, random"),
    ],
)
def test_impossible_fleets_are_refused(more: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        play(**more)


def test_the_command_writes_its_report(tmp_path: Path) -> None:
    table = tmp_path / "attempts.json"
    table.write_text(json.dumps(table_of([0, 1, 2])), encoding="utf-8")
    done = CliRunner().invoke(
        study,
        [
            "trust", "--from-attempts", str(table), "--fleets", "1", "--robots", "3", "--liars",
            "1", "--table", "2", "--rounds", "1", "--json", "--workers", "1",
            "--out", str(tmp_path / "out"),
        ],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == json.loads((tmp_path / "out" / "trust.json").read_text())
