"""``rtask rules`` and ``rtask load`` of files with rules."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import rtask
from rtask.cli import cli

TEXT = (
    "# What is on something is above it.\nCONSTRUCT { ?a <urn:above> ?b } WHERE { ?a <urn:on> ?b }"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:on> <urn:b> }")
    (tmp_path / "on-above.rq").write_text(TEXT)
    return tmp_path


def run(folder: Path, *arguments: str, text: str | None = None) -> Result:
    given = [*arguments, "--data", str(folder / "kb")]
    return CliRunner().invoke(cli, given, input=text, env={"RTASK_DATA": ""})


@pytest.mark.slow
def test_rules_are_added_listed_shown_and_removed(folder: Path) -> None:
    done = run(folder, "rules", "add", str(folder / "on-above.rq"))
    assert done.output == "1 rule added, 1 statements derived\n", done.output
    assert run(folder, "rules", "list").output.startswith("on-above  ")
    (listed,) = json.loads(run(folder, "rules", "list", "--json").output)
    assert listed["comment"] == "What is on something is above it."
    assert TEXT in run(folder, "rules", "show", "on-above").output
    assert run(folder, "explain", "<urn:a>", "<urn:above>", "<urn:b>").output.startswith(
        "<urn:a> <urn:above> <urn:b> "
    )
    removed = json.loads(run(folder, "rules", "remove", "on-above", "--json").output)
    assert (removed["removed"], removed["withdrawn"]) == (["on-above"], 1)
    assert run(folder, "rules", "list").exit_code == 1


@pytest.mark.slow
def test_load_takes_a_file_of_rules(folder: Path) -> None:
    (report,) = json.loads(run(folder, "load", str(folder / "on-above.rq"), "--json").output)
    assert (report["files"][0]["format"], report["files"][0]["derived"]) == ("rules", 1)
    dry = run(folder, "load", str(folder / "on-above.rq"), "--dry-run")
    assert dry.exit_code == 0


@pytest.mark.slow
def test_a_rule_comes_from_standard_input_with_a_label(folder: Path) -> None:
    assert "needs --label" in str(run(folder, "rules", "add", "-", text=TEXT).exception)
    done = run(folder, "rules", "add", "-", "--label", "stacking", "--json", text=TEXT)
    assert done.exception is None, done.exception
    assert json.loads(done.output)["rules"] == ["stacking"]


@pytest.mark.slow
def test_a_robot_may_not_add_rules(folder: Path) -> None:
    done = run(folder, "rules", "add", str(folder / "on-above.rq"), "--agent", "nao-1")
    assert "right of its own" in str(done.exception)
    assert run(folder, "rules", "list").exit_code == 1


@pytest.mark.slow
def test_a_faulty_file_is_told_with_its_line(folder: Path) -> None:
    (folder / "bad.rq").write_text(TEXT.replace("WHERE", "\nWERE"))
    done = run(folder, "rules", "add", str(folder / "bad.rq"))
    assert "rule 'bad' 3:1: unknown word 'WERE'; did you mean 'WHERE'?" in str(done.exception)
