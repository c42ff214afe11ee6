"""An ontology is upgraded with its data, taken back, unloaded; a plain load says what it merges."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli
from rtask.errors import ConflictError, InconsistentError, UnknownTermError, UsageError
from rtask.ontology_docs.difference import compare
from rtask.ontology_docs.source import read_source
from rtask.ontology_docs.unloading import unload
from rtask.ontology_docs.upgrading import undo_upgrade, upgrade

PREFIXES = """
@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix dcterms: <http://purl.org/dc/terms/> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> . @prefix v: <urn:vessels#> .
"""
FIRST = f"""{PREFIXES}
<urn:vessels> a owl:Ontology ; owl:versionInfo "1.0" .
v:Vessel a owl:Class . v:Tumbler a owl:Class ; rdfs:subClassOf v:Vessel .
v:Jug a owl:Class ; rdfs:subClassOf v:Vessel . v:old a owl:ObjectProperty .
v:holds a owl:ObjectProperty ; rdfs:range v:Liquid . v:Liquid a owl:Class .
"""
SECOND = f"""{PREFIXES}
<urn:vessels> a owl:Ontology ; owl:versionInfo "2.0" .
v:Vessel a owl:Class . v:Glass a owl:Class ; rdfs:subClassOf v:Vessel ; dcterms:replaces v:Tumbler .
v:Jug a owl:Class ; rdfs:subClassOf v:Vessel ; owl:deprecated true ; owl:equivalentClass v:Pitcher .
v:Pitcher a owl:Class ; rdfs:subClassOf v:Vessel .
v:contains a owl:ObjectProperty ; rdfs:range v:Liquid . v:Liquid a owl:Class .
v:holds a owl:ObjectProperty ; owl:deprecated true ; dcterms:isReplacedBy v:contains .
"""
DATA = """
PREFIX v: <urn:vessels#>
INSERT DATA { <urn:a> a v:Tumbler ; v:holds <urn:w> . <urn:b> a v:Jug ; v:old <urn:a> }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "first.ttl").write_text(FIRST)
    (tmp_path / "second.ttl").write_text(SECOND)
    return tmp_path


@pytest.fixture
def kb(folder: Path):
    with rtask.open(folder / "kb", ontologies=False, base="urn:lab/") as kb:
        kb.load(folder / "first.ttl")
        kb.update(DATA, "nao-1")
        yield kb


def content(kb: rtask.KnowledgeBase, *but: str) -> set[str]:
    kept = {kb.graphs.meta.value, kb.graphs.provenance.value, *but}
    return {str(q) for q in kb.match() if getattr(q.graph_name, "value", "") not in kept}


def types(kb: rtask.KnowledgeBase, name: str) -> list[str]:
    rows = kb.select(f"SELECT DISTINCT ?t {{ <{name}> a ?t }} ORDER BY ?t")
    return [row["t"].value.partition("#")[2] for row in rows]


def test_an_upgrade_rewrites_data_and_tells_what_it_did(kb, folder: Path) -> None:
    done = upgrade(kb, folder / "second.ttl")
    assert done.renamed == {
        "urn:vessels#Tumbler": "urn:vessels#Glass",
        "urn:vessels#Jug": "urn:vessels#Pitcher",
        "urn:vessels#holds": "urn:vessels#contains",
    }
    assert sorted(done.rewritten.values()) == [1, 1, 1]
    assert done.left == {"urn:vessels#old": 1}
    assert types(kb, "urn:a") == ["Glass", "Vessel"]
    # Derived from the equivalence that the new version states.
    assert types(kb, "urn:b") == ["Jug", "Pitcher", "Vessel"]
    assert types(kb, "urn:w") == ["Liquid"]
    graphs = {quad.graph_name for quad in kb.match("urn:a", "urn:vessels#contains")}
    assert graphs == {kb.graphs.agent("nao-1")}
    assert kb.verify() == []


def test_an_upgrade_is_one_commit_and_can_be_undone(kb, folder: Path) -> None:
    before, seq = content(kb), kb.seq
    upgrade(kb, folder / "second.ttl")
    assert kb.seq == seq + 1
    undo_upgrade(kb, "urn:vessels")
    assert content(kb) == before
    with pytest.raises(UnknownTermError, match="no upgrade"):
        undo_upgrade(kb, "urn:vessels")
    upgrade(kb, folder / "second.ttl")
    kb.update("DELETE WHERE { GRAPH ?g { <urn:a> <urn:vessels#contains> ?o } }")
    with pytest.raises(ConflictError, match="changed since"):
        undo_upgrade(kb, "urn:vessels")


def test_a_dry_run_and_a_contradiction_change_nothing(kb, folder: Path) -> None:
    before = content(kb)
    assert upgrade(kb, folder / "second.ttl", dry_run=True).rewritten
    bad = folder / "bad.ttl"
    bad.write_text(SECOND + "v:Vessel owl:disjointWith v:Glass .")
    with pytest.raises(InconsistentError, match="cause"):
        upgrade(kb, bad)
    assert content(kb) == before


def test_without_migration_data_stay_and_rules_that_need_a_look_are_named(kb, folder: Path) -> None:
    kb.add_rules(
        rtask.Rule("full", "CONSTRUCT { ?a <urn:full> true } WHERE { ?a <urn:vessels#holds> ?b }")
    )
    done = upgrade(kb, folder / "second.ttl", migrate=False)
    assert (done.renamed, done.rewritten, done.rules) == ({}, {}, ())
    undo_upgrade(kb, "urn:vessels")
    assert upgrade(kb, folder / "second.ttl").rules == ("full",)


@pytest.mark.slow
def test_only_a_loaded_ontology_of_ones_own_is_upgraded_or_unloaded(folder: Path) -> None:
    with rtask.open(":memory:") as kb:
        with pytest.raises(UnknownTermError, match="not loaded"):
            upgrade(kb, folder / "second.ttl")
        with pytest.raises(UnknownTermError, match="did you mean"):
            unload(kb, "https://w3id.org/rtask-kg/onto/grsp")
        with pytest.raises(UsageError, match="comes with RTASK"):
            unload(kb, "https://w3id.org/rtask-kg/onto/grasp")


def test_unloading_takes_what_follows_along_and_is_refused_while_in_use(kb) -> None:
    with pytest.raises(ConflictError, match="in use"):
        unload(kb, "urn:vessels")
    assert unload(kb, "urn:vessels", dry_run=True).used["urn:vessels#Tumbler"] == 1
    assert types(kb, "urn:a") == ["Tumbler", "Vessel"]
    done = unload(kb, "urn:vessels", force=True)
    assert done.statements > 10
    assert types(kb, "urn:a") == ["Tumbler"]
    assert kb.catalogue.ontologies() == []
    assert kb.verify() == []


def test_an_importer_keeps_an_ontology(kb) -> None:
    kb.load(
        f"{PREFIXES} <urn:kitchen> a owl:Ontology ; owl:imports <urn:vessels> .".encode(),
        format="turtle",
    )
    with pytest.raises(ConflictError, match="<urn:kitchen> imports it"):
        unload(kb, "urn:vessels")


def test_a_plain_load_says_which_version_it_is_merged_with(kb, folder: Path) -> None:
    (warning,) = kb.load(folder / "second.ttl").warnings
    assert "version 2.0 of <urn:vessels> is merged with version 1.0" in warning
    assert kb.load(folder / "first.ttl", replace=True).warnings == []


def test_the_difference_names_renamed_terms(folder: Path) -> None:
    found = compare(read_source(str(folder / "first.ttl")), read_source(str(folder / "second.ttl")))
    assert found.to_dict()["renamed"]["urn:vessels#holds"] == "urn:vessels#contains"
    assert any("is replaced by" in line for line in found.lines())


@pytest.mark.slow
def test_the_commands(folder: Path) -> None:
    options = ["--data", str(folder / "kb")]

    def run(*arguments: str) -> str:
        done = CliRunner().invoke(cli, [*arguments, *options])
        assert done.exit_code == 0, (done.output, done.exception)
        return done.stdout

    run("load", str(folder / "first.ttl"))
    with rtask.open(folder / "kb") as kb:
        kb.update(DATA, "nao-1")
    assert (
        "is merged with version 1.0"
        in CliRunner()
        .invoke(cli, ["load", str(folder / "second.ttl"), "--dry-run", *options])
        .output
    )
    told = run("ontology", "upgrade", str(folder / "second.ttl"))
    assert "renamed <urn:vessels#holds> -> <urn:vessels#contains>: 1 statements" in told
    assert json.loads(run("ontology", "upgrade", "--undo", "urn:vessels", "--json"))["commit"] > 0
    dry = json.loads(run("ontology", "unload", "urn:vessels", "--dry-run", "--json"))
    assert dry["commit"] is None
    assert run("ontology", "unload", "urn:vessels", "--force").endswith("statements\n")
