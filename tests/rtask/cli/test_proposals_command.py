"""``rtask proposals``: what waits for an operator is listed, shown, adopted and refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from pyoxigraph import Literal, NamedNode, Quad

import rtask
from rtask.cli import cli


def run(folder: Path, *words: str) -> Any:
    done = CliRunner().invoke(cli, ["proposals", *words, "-d", str(folder), "--json"])
    assert done.exit_code in (0, 1), (done.output, done.exception)
    return json.loads(done.output)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        for name in ("urn:a", "urn:b"):
            statement = Quad(NamedNode(name), NamedNode("urn:p"), Literal(1), kb.graphs.shared)
            kb.propose([statement], author="nao-1", reason="seen")
    return tmp_path / "kb"


def test_proposals_are_listed_shown_adopted_and_refused(folder: Path) -> None:
    first, second = run(folder, "list")
    assert run(folder, "show", str(first["number"])) == first
    assert run(folder, "adopt", str(first["number"]))["added"] == 1
    assert run(folder, "refuse", str(second["number"]), "--remark", "no")["state"] == "refused"
    assert [one["state"] for one in run(folder, "list")] == ["adopted", "refused"]
    with rtask.open(folder, mode="r") as kb:
        assert kb.query("ASK { <urn:a> <urn:p> 1 }")
        assert not kb.query("ASK { <urn:b> <urn:p> 1 }")
