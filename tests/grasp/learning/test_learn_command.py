"""``rtask learn benchmark`` on a few objects."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.errors import UsageError

_SMALL = ("learn", "benchmark", "--seeds", "2", "--objects", "8", "--worlds", "1", "--workers", "1")


@pytest.mark.slow
def test_learners_side_by_side_with_their_curves(tmp_path: Path) -> None:
    plot = tmp_path / "curves.svg"
    found = CliRunner().invoke(
        cli, [*_SMALL, "--only", "oracle", "--save-plot", str(plot)], catch_exceptions=False
    )
    assert found.exit_code == 0
    lines = found.output.splitlines()
    assert [line.split()[0] for line in lines] == [
        "quadrants", "oracle", "oracle,", "candidates", "oracle", "wrote",
    ]  # fmt: skip
    assert "1.00 / 1.00" in lines[4]  # attempts of the oracle, ours and as measured earlier
    assert plot.read_text("utf-8").startswith("<svg")


def test_learners_as_json() -> None:
    found = CliRunner().invoke(
        cli, [*_SMALL, "--only", "candidates oracle", "--json"], catch_exceptions=False
    )
    (row,) = json.loads(found.output)
    assert row["name"] == "oracle"
    assert row["attempts"]["value"] < 1.2


def test_a_name_that_nobody_has_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no learner's name contains 'magic'"):
        CliRunner().invoke(cli, [*_SMALL, "--only", "magic"], catch_exceptions=False)
    plot = tmp_path / "missing" / "curves.svg"
    with pytest.raises(UsageError, match="No such file"):
        CliRunner().invoke(
            cli,
            [*_SMALL, "--only", "candidates oracle", "--save-plot", str(plot)],
            catch_exceptions=False,
        )
