"""Studies as programs call them: standard output holds JSON, whatever Bullet writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from simulate.studies import study
from simulate.study.quality.hands import summarise_hands
from tests.commands import run_command

pytestmark = pytest.mark.slow


def _told(*words: str) -> Any:
    """Run a study and return what it prints as JSON, and nothing else."""
    done = run_command("study", *words, "--json", timeout=800)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("words", "counted"),
    [
        (("attempts", "-n", "1", "--grasps", "2", "--tries", "3"), {"products": 1, "attempts": 6}),
        pytest.param(
            ("asking-price", "-n", "1", "--things", "2", "--goals", "1"),
            {"labs": 1},
            marks=pytest.mark.deep,
        ),
        pytest.param(
            ("judging", "-n", "1", "--preset", "fast"), {"trials": 1}, marks=pytest.mark.deep
        ),
        pytest.param(
            ("piles", "-n", "1", "--objects", "2", "--preset", "fast"),
            {"piles": 1},
            marks=pytest.mark.deep,
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_study_prints_json_and_nothing_else(
    words: tuple[str, ...], counted: dict[str, int], tmp_path: Path
) -> None:
    told = _told(*words, "--workers", "1", "--out", str(tmp_path / "out"))
    assert {name: told[name] for name in counted} == counted


@pytest.mark.deep
def test_families_that_no_cause_explains_are_printed_as_json(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    told = _told("unforeseen", "-n", "3", "--fleets", "1", "--workers", "2", "--out", out)
    assert {name for name, family in told["families"].items() if family["known"]} == {
        "one end breaks", "mass at one end",
    }  # fmt: skip
    assert all(family["products"] == 3 for family in told["families"].values())


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        pytest.param(
            ("table4", "--objects", "1", "--repeats", "1"),
            {"object 1": 5.531},
            marks=pytest.mark.deep,
        ),
        pytest.param(
            ("table5", "--repeats", "1", "--preset", "fast"),
            {"pen": 10.501, "ball": 15.285, "bottle": 18.235, "can": 12.101},
            marks=pytest.mark.deep,
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_table_of_the_thesis_prints_json_and_nothing_else(
    words: tuple[str, ...], rows: dict[str, float], tmp_path: Path
) -> None:
    told = _told(*words, "--out", str(tmp_path / "out"))
    assert {row["object"]: row["thesis_s"] for row in told["rows"]} == rows


def test_a_robot_that_there_is_not_starts_no_trial(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    asked = ["judging", "--robot", "foo", "-n", "3", "--out", str(folder)]
    done = CliRunner().invoke(study, asked)
    assert "no robot is called 'foo'" in str(done.exception)
    assert not folder.exists()


@pytest.mark.deep
def test_the_study_of_hands_compares_one_view_with_the_mesh(tmp_path: Path) -> None:
    asked = ("hands", "--hand", "three", "--objects", "1", "--seed", "2611", "--workers", "1")
    summary = _told(*asked, "--out", str(tmp_path / "out"))
    assert summary["objects"] == 1
    for name in ("lifted", "carried"):
        row = summary[name]
        assert row["difference"] == pytest.approx(row["view"] - row["mesh"])
        assert 0 <= row["mesh"] <= 1


def test_an_object_without_a_planned_grasp_counts_as_not_held() -> None:
    shares = np.array([[[1.0, 0.5], [np.nan, np.nan]], [[1.0, 1.0], [1.0, 0.0]]])
    summary = summarise_hands(shares)
    assert summary["without_a_grasp"] == {"mesh": 0, "view": 1}
    assert summary["lifted"]["view"] == 0.5
    assert summary["carried"]["difference"] == -0.75
