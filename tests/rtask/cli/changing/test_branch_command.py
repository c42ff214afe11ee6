"""``rtask branch``: made, changed, compared, merged and dropped at the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli
from rtask.errors import ConflictError, RtaskError, UnknownTermError, UsageError

pytestmark = pytest.mark.slow


def run(folder: Path, *words: str, code: int = 0) -> Any:
    done = CliRunner().invoke(cli, [*words, "-d", str(folder), "--json"])
    if isinstance(done.exception, RtaskError):
        raise done.exception
    assert done.exit_code == code, (done.output, done.exception)
    return json.loads(done.stdout)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with rtask.open(tmp_path / "kb", base="urn:lab/", ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> a <urn:Cup> }")
    return tmp_path / "kb"


def test_a_branch_is_made_changed_compared_and_merged(folder: Path) -> None:
    assert run(folder, "branch", "list", code=1) == []
    made = run(folder, "branch", "make", "tue", "--note", "a day", "--agent", "nao-1", "--at", "1")
    assert (made["name"], made["base"], made["author"]) == ("tue", 1, "nao-1")
    change = "INSERT DATA { <urn:b> a <urn:Cup> }"
    assert run(folder, "update", change, "--branch", "tue")["added"] == 1
    query = "SELECT ?c { ?c a <urn:Cup> }"
    rows = run(folder, "query", query, "--branch", "tue")["results"]["bindings"]
    assert sorted(row["c"]["value"] for row in rows) == ["urn:a", "urn:b"]
    assert len(run(folder, "query", query)["results"]["bindings"]) == 1
    compared = run(folder, "branch", "compare", "tue")
    assert (len(compared["added"]), compared["conflicts"]) == (1, [])
    assert [record["name"] for record in run(folder, "branch", "list")] == ["tue"]
    assert run(folder, "branch", "merge", "tue", "--note", "good")["added"] == 1
    assert len(run(folder, "query", query)["results"]["bindings"]) == 2
    assert run(folder, "branch", "list", code=1) == []


def test_what_stands_against_merging_is_shown_and_the_branch_dropped(folder: Path) -> None:
    run(folder, "branch", "make", "late")
    run(folder, "update", "INSERT DATA { <urn:a> <urn:p> 1 }", "--branch", "late")
    run(folder, "update", "DELETE DATA { GRAPH <urn:lab/graph/shared> { <urn:a> a <urn:Cup> } }")
    [conflict] = run(folder, "branch", "compare", "late", code=1)["conflicts"]
    assert conflict["kind"] == "withdrawn"
    with pytest.raises(ConflictError, match="urn:a"):
        run(folder, "branch", "merge", "late")
    assert run(folder, "branch", "drop", "late")["name"] == "late"
    with pytest.raises(UnknownTermError, match="late"):
        run(folder, "branch", "drop", "late")


def test_a_branch_of_a_server_is_asked_at_its_own_address(folder: Path) -> None:
    asked = ["query", "ASK {}", "--branch", "tue", "--server", "http://localhost:9"]
    done = CliRunner().invoke(cli, asked)
    assert isinstance(done.exception, UsageError)
    assert "/sparql?branch=tue" in str(done.exception)
