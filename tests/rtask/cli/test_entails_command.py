"""``rtask entails`` and the JSON of the commands that reason."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli

SCHEMA = """
@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix : <urn:t:> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<urn:t:> a owl:Ontology .
:Mug rdfs:subClassOf :Cup . :Cup rdfs:subClassOf :Vessel ; rdfs:label "cup"@en .
:Vessel a owl:Class . :Fish owl:disjointWith :Vessel .
"""
CONCLUSION = """
@prefix : <urn:t:> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:Mug rdfs:subClassOf :Vessel . :m a :Cup . :Mug owl:disjointWith :Fish .
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("entails")
    with rtask.open(folder / "kb", ontologies=False, base="urn:lab/") as kb:
        kb.load(SCHEMA.encode(), format="turtle")
        kb.update("INSERT DATA { <urn:t:m> a <urn:t:Mug> }")
    return folder


def run(folder: Path, *arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, [*arguments, "--data", str(folder / "kb")])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.stdout


def test_a_statement_that_follows_is_proven(folder: Path) -> None:
    code, out = run(folder, "entails", "<urn:t:m>", "a", "<urn:t:Vessel>")
    assert (code, out.splitlines()[0]) == (0, "yes")
    assert "cax-sco" in out
    assert '<urn:t:m> a <urn:t:Cup> "cup"' in out


def test_a_statement_that_does_not_follow_is_missing(folder: Path) -> None:
    code, out = run(folder, "entails", "<urn:t:m>", "a", "<urn:t:Fish>")
    assert (code, out.splitlines()[:2]) == (1, ["no", "missing: <urn:t:m> rdf:type <urn:t:Fish>"])
    assert "asserted" in out


def test_a_file_follows_as_a_whole_or_what_is_missing_is_listed(
    folder: Path, tmp_path: Path
) -> None:
    file = tmp_path / "conclusion.ttl"
    file.write_text(CONCLUSION)
    code, out = run(folder, "entails", str(file), "--json")
    found = json.loads(out)
    assert (code, found["entailed"], found["missing"]) == (0, True, [])
    file.write_text(CONCLUSION + ":Vessel rdfs:subClassOf :Mug . :m a :Vessel .")
    code, out = run(folder, "entails", str(file), "--json")
    found = json.loads(out)
    assert (code, found["entailed"]) == (1, False)
    assert found["missing"] == [
        ["<urn:t:Vessel>", "<http://www.w3.org/2000/01/rdf-schema#subClassOf>", "<urn:t:Mug>"]
    ]


def test_faulty_questions_are_usage_errors(folder: Path, tmp_path: Path) -> None:
    for arguments in (["<urn:a>", "<urn:b>"], [str(tmp_path / "none.ttl")]):
        with pytest.raises(rtask.errors.UsageError):
            run(folder, "entails", *arguments)


def json_of(folder: Path, *arguments: str) -> Any:
    return json.loads(run(folder, *arguments, "--json")[1])


@pytest.mark.slow
def test_every_command_that_reasons_prints_json(folder: Path) -> None:
    explained = json_of(folder, "explain", "<urn:t:m>", "a", "<urn:t:Vessel>")
    assert explained["holds"] is True
    assert explained["steps"]["rule"] == "cax-sco"
    assert explained["steps"]["premises"]
    assert json_of(folder, "entails", "<urn:t:m>", "a", "<urn:t:Mug>")["entailed"] is True
    assert json_of(folder, "validate")["results"] == []
    assert json_of(folder, "rules", "list") == []
    assert json_of(folder, "reason")["consistent"] is True
    assert [row["ontology"] for row in json_of(folder, "ontology", "list")] == ["urn:t:"]
    for sub in (["show"], ["patches"], ["diff", "bundled", "bundled"]):
        arguments = ["ontology", *sub, "--json"]
        assert json.loads(CliRunner().invoke(cli, arguments).stdout) is not None


def test_validate_lists_the_cause_of_a_contradiction(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        kb.load(SCHEMA.encode(), format="turtle")
        kb.update("INSERT DATA { <urn:t:m> a <urn:t:Mug>, <urn:t:Fish> }")
    code, out = run(tmp_path, "validate", "--json")
    (found,) = json.loads(out)["results"]
    assert (code, found["severity"]) == (1, "Violation")
    assert "<urn:t:m> rdf:type <urn:t:Fish>" in found["message"]


def test_the_causes_of_contradictory_files_are_told(tmp_path: Path) -> None:
    file = tmp_path / "world.ttl"
    file.write_text(SCHEMA + "<urn:t:m> a <urn:t:Mug>, <urn:t:Fish> . <urn:t:n> a <urn:t:Mug> .")
    done = CliRunner().invoke(cli, ["reason", str(file), "--json"])
    report = json.loads(done.stdout)
    assert done.exit_code == 1
    (cause,) = report["causes"]
    assert "<urn:t:m> rdf:type <urn:t:Fish>" in cause
    assert "<urn:t:n>" not in cause
