"""Fleets replayed from a table of attempts: an ideal memory wins, an untrue one does not."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest
from click.testing import CliRunner

from rtask.errors import UsageError
from simulate.fleet.replay import COLUMNS, CONDITIONS, replay_rows, replay_study, summary_of
from simulate.fleet.study_commands import sharing
from simulate.study.attempt_table import read_attempts
from tests.simulate.fleet.tables import figures_of, product_with, table_of


def replay(
    table: Mapping[str, Any], fleets: int, on_table: int, cap: int, seed: int
) -> dict[str, Any]:
    return figures_of(
        table, lambda path: replay_study(path, fleets, on_table, cap, seed), summary_of
    )


def test_an_ideal_memory_wins_most_of_the_headroom_and_an_untrue_one_nothing() -> None:
    # The secrets are spread evenly: nothing that one product teaches holds of the others.
    table = table_of(list(range(7)))
    table["products"] += [product_with(10 + k, k, kind="flask") for k in range(7)]
    summary = replay(table, 20, 6, 6, seed=1)
    assert summary["oracle_first_try"] == 1.0
    found = summary["conditions"]
    assert tuple(found) == CONDITIONS
    assert found["shared"]["headroom_won"] >= 0.6
    assert found["shared"]["effect_interval95"][1] < 0
    assert found["shared"]["robot_2"] < found["shared"]["robot_1"]
    for untrue in CONDITIONS[1:]:
        assert found[untrue]["headroom_won"] < 0.2
        assert found[untrue]["effect_interval95"][1] > 0
    rows = replay_rows(summary)
    assert [len(row) for row in rows] == [len(COLUMNS)] * len(CONDITIONS)


def test_reasoning_about_causes_saves_attempts_only_where_something_hides() -> None:
    table = table_of([0, 1, 5, 6] * 2)
    for thing, weak in zip(table["products"], (1, 1, -1, -1) * 2, strict=True):
        for k, arm in enumerate(thing["arms"]):
            arm["held"] = [weak * (k - 3) < -1] * 3  # one end and the middle break
    robot = replay(table, 20, 6, 6, seed=1)["causes"]["robot_1"]
    assert robot["interval95"][1] < 0
    assert robot["change"] == pytest.approx(robot["with"] - robot["without"], abs=1e-3)
    same = replay(table_of([None] * 4), 10, 4, 6, seed=1)["causes"]["robot_1"]
    assert (same["with"], same["without"], same["change"]) == (1.0, 1.0, 0.0)


def test_a_condition_that_the_table_cannot_show_is_left_out() -> None:
    summary = replay(table_of([0, 1, 5, 6]), 3, 4, 6, seed=1)
    assert set(summary["conditions"]) == set(CONDITIONS) - {"another family"}
    assert len(replay_rows(summary)) == len(CONDITIONS) - 1


def test_a_product_that_is_not_recognised_is_met_as_if_alone() -> None:
    """Both meetings have the same luck, so that only the memory tells them apart."""
    table = table_of([0, 1, 5, 6])
    for thing in table["products"]:
        for arm in thing["arms"]:
            arm["held"] = [False] * 3
    found = replay(table, 10, 4, 6, seed=1)["conditions"]
    assert all(one["effect"] == 0.0 and one["robot_2"] == 7.0 for one in found.values())


def test_sharing_changes_nothing_where_any_grasp_holds() -> None:
    found = replay(table_of([None] * 4), 20, 4, 6, seed=1)["conditions"]["shared"]
    assert (found["robot_1"], found["robot_2"], found["effect"]) == (1.0, 1.0, 0.0)


def test_the_seed_decides_the_replay() -> None:
    table = table_of([0, 5, 6, 1])
    assert replay(table, 3, 2, 6, seed=4) == replay(table, 3, 2, 6, seed=4)
    assert replay(table, 3, 2, 6, seed=4) != replay(table, 3, 2, 6, seed=5)


def test_a_table_that_is_too_small_is_refused() -> None:
    with pytest.raises(UsageError, match="a fleet takes 8 products, and the table has 2"):
        replay(table_of([0, 1]), 1, 8, 6, seed=0)
    for fleets, on_table in ((0, 1), (1, 0)):
        with pytest.raises(UsageError, match="--fleets and --table must be at least 1"):
            replay(table_of([0, 1]), fleets, on_table, 6, seed=0)


@pytest.mark.parametrize("settings", [{}, {"hand": "claw"}, {"hand": "none.json"}])
def test_a_table_of_an_unknown_hand_is_refused(tmp_path, settings) -> None:
    path = tmp_path / "attempts.json"
    path.write_text(json.dumps({**table_of([0, 1]), "settings": settings}))
    with pytest.raises(UsageError, match="holds no table of attempts"):
        read_attempts(path)


def test_the_command_replays_atable_of(tmp_path) -> None:
    path = tmp_path / "attempts.json"
    path.write_text(json.dumps(table_of([0, 1, 5, 6])))
    args = ["--fleets", "5", "--from-attempts", str(path), "--out", str(tmp_path / "out")]
    args += ["--workers", "1"]
    done = CliRunner().invoke(sharing, [*args, "--json"], catch_exceptions=False)
    assert json.loads(done.stdout)["fleets"] == 5
    assert (tmp_path / "out" / "replay.json").exists()
    shown = CliRunner().invoke(sharing, [*args, "--resume"], catch_exceptions=False)
    assert "a look-alike" in shown.stdout


def test_a_replay_goes_on_with_its_table_only(tmp_path) -> None:
    path = tmp_path / "attempts.json"
    path.write_text(json.dumps(table_of([0, 1, 5, 6])))
    args = ["--from-attempts", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]
    CliRunner().invoke(sharing, [*args, "--fleets", "1"], catch_exceptions=False)
    path.write_text(json.dumps(table_of([0, 1, 5, 3])))
    done = CliRunner().invoke(sharing, [*args, "--fleets", "2", "--resume"])
    assert isinstance(done.exception, UsageError)
    assert "is of an experiment with sha256" in str(done.exception)


def test_options_that_a_replay_ignores_are_refused(tmp_path) -> None:
    table = tmp_path / "attempts.json"
    table.write_text(json.dumps(table_of([0, 1, 2])), encoding="utf-8")
    done = CliRunner().invoke(
        sharing, ["--from-attempts", str(table), "--robots", "3", "--out", str(tmp_path / "out")]
    )
    assert isinstance(done.exception, UsageError)
    assert "--robots does not concern" in str(done.exception)
    assert not (tmp_path / "out").exists()
