"""The figures that the page about speed shows are those of the documentation."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from endpoint.pages.benchmarks import figures

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "docs" / "benchmarks"
INDEX = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
DOCUMENT = "\n".join(page.read_text(encoding="utf-8") for page in sorted(FOLDER.glob("*.md")))
ROUNDED = 0.05
"""Ratios are of unrounded figures; those shown have two digits or three."""


def _section(title: str) -> str:
    """Return the text below a heading, which no two pages share, up to the next one."""
    _, rest = re.split(rf"^#+ {re.escape(title)}$", DOCUMENT, flags=re.MULTILINE)
    return re.split(r"^#+ ", rest, flags=re.MULTILINE)[0]


def _line(section: str, what: str, figure: str) -> str:
    """Return the row of a table that has a first cell and a figure."""
    rows = [line for line in section.splitlines() if line.startswith(f"| {what} |")]
    (found,) = [row for row in rows if figure in row]
    return found


def _number(text: str) -> float:
    match = re.match(r"[\d,.]+", text)
    assert match is not None
    return float(match.group().replace(",", ""))


@pytest.mark.parametrize("row", figures()["row"], ids=lambda row: row["what"][:30])
def test_each_figure_stands_in_the_documentation_with_its_command(row: dict[str, Any]):
    section = _section(row["section"])
    ours = _line(section, row["what"], row["ours"])
    peer = _line(section, row["peer_what"], row["peer"]) if "peer_what" in row else ours
    assert row["peer"] in peer
    assert row["command"] in " ".join(section.split())
    script = re.search(r"bench_\w+\.py", row["command"])
    assert script is not None
    assert len(list(ROOT.glob(f"tests/benchmarks/*/{script.group()}"))) == 1


@pytest.mark.parametrize("row", figures()["row"], ids=lambda row: row["what"][:30])
def test_each_ratio_follows_from_its_figures(row: dict[str, Any]):
    ours, peer = _number(row["ours"]), _number(row["peer"])
    ratio = peer / ours if row["better"] == "less" else ours / peer
    assert row["ratio"] == pytest.approx(ratio, rel=ROUNDED)


def test_the_machine_is_that_of_the_documentation():
    assert figures()["machine"] in " ".join(INDEX.split())
