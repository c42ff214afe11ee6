"""What follows from the declaration of a study: a command, a table, a file and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from simulate import options
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study, Table


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let worker processes import this file as they import any module."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))


def count_up(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return a number that depends on the settings and the trial alone."""
    return {"n": settings["seed"] + number}


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    (folder / "drawn.txt").write_text("a picture")
    total = sum(result["n"] for result in results)
    return Report(
        {"seed": settings["seed"], "total": total},
        [Table("Sums", ("what", "n"), [("total", str(total))])],
        [f"{len(results)} trials"],
        {"results": list(results)},
        pictures=["drawn.txt"],
    )


def _study(trials: int, seed: int) -> Study:
    return Study("sums", "test_study_command:count_up", {"seed": seed}, trials, _describe)


@study_command("sums", with_preset=False)
@options.trials(3, "Numbers.")
@options.seed("every number")
def sums(trials: int, seed: int) -> Study:
    """Add numbers up."""
    return _study(trials, seed)


def _run(*args: str) -> str:
    done = CliRunner().invoke(sums, [*args, "--workers", "1"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_study_is_run_printed_and_kept(tmp_path: Path) -> None:
    out = tmp_path / "run"
    printed = _run("-n", "3", "--seed", "10", "--out", str(out))
    assert all(words in printed for words in ("Sums", "33", "3 trials"))
    assert f"report  {out / 'report.json'}, {out / 'drawn.txt'}" in printed
    kept = json.loads((out / "report.json").read_text())
    assert kept == {"seed": 10, "total": 33, "results": [{"n": 10}, {"n": 11}, {"n": 12}]}


def test_a_study_goes_on_and_prints_its_figures_alone_as_json(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    _run("-n", "2", "--out", out)
    figures = json.loads(_run("-n", "4", "--out", out, "--resume", "--json"))
    assert figures == {"seed": 0, "total": 6}


def test_trials_run_here_are_those_that_run_in_processes(tmp_path: Path) -> None:
    _run("-n", "3", "--seed", "5", "--out", str(tmp_path))
    assert (
        json.loads((tmp_path / "report.json").read_text())["results"] == _study(3, 5).in_process()
    )
