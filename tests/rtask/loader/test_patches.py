"""Known faults of published ontologies: mended by name, or told by their cause."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import ontology
import rtask
from rtask.cli import cli
from rtask.errors import InconsistentError
from rtask.loader.patches import patches

OWL = "http://www.w3.org/2002/07/owl#"
VARIANT = """
@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<http://purl.org/rtask/sumo-cora> a owl:Ontology .
xsd:Variant a rdfs:Datatype ; owl:equivalentClass xsd:boolean, xsd:double, xsd:int, xsd:string .
"""
POS = """
@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix pos: <http://purl.org/ieee1872-owl/pos#> .
@prefix sumo: <http://purl.org/ieee1872-owl/sumo-cora#> .
<http://purl.org/ieee1872-owl/pos> a owl:Ontology .
sumo:PhysicalQuantity owl:disjointUnionOf ( pos:OrientationValue pos:OrientationRegion ) .
sumo:Other owl:disjointUnionOf ( pos:A pos:B ) .
"""
NAMES = {
    "aur": ["ieee1872-2_aur.ttl"],
    "brick": ["Brick.n3"],
    "cora": [
        "annotation.owl",
        "cora-bare.owl",
        "cora-fullaxiom.owl",
        "cora.owl",
        "corax.owl",
        "pos.owl",
        "rparts.owl",
        "sumo-cora.owl",
    ],
    "knowrob": ["URDF.owl", "knowrob-pepper.owl", "srdl2-cap.owl", "srdl2-comp.owl"],
    "rtask2020": [
        "annotation.owl",
        "cora-bare.owl",
        "cora-fullaxiom.owl",
        "cora.owl",
        "corax.owl",
        "pos.owl",
        "rparts.owl",
        "rtask.owl",
        "sumo-cora.owl",
    ],
    "soma": ["SOMA-ACT.owl", "SOMA-OBJ.owl", "SOMA.owl"],
    "w3c": ["sosa.rdf", "sosa.ttl", "ssn.ttl", "time.jsonld", "time.nt", "time.rdf", "time.ttl"],
}
FILES = [f"{folder}/{name}" for folder, names in NAMES.items() for name in names]
PATCHED = {
    "cora/pos.owl": "pos-disjoint-union",
    "cora/cora.owl": "cora-agent-robot",
    "rtask2020/sumo-cora.owl": "rtask2020-variant",
}


def test_a_known_fault_is_left_out_and_named() -> None:
    with rtask.open(":memory:") as kb:
        report = kb.load(VARIANT.encode(), format="turtle")
        assert report.files[0].patches == ("rtask2020-variant",)
        variant = "http://www.w3.org/2001/XMLSchema#Variant"
        assert [
            quad.predicate.value for quad in kb.match(variant) if "owl" in quad.predicate.value
        ] == []
        (row,) = kb.select(
            "SELECT ?note { ?a <http://www.w3.org/2000/01/rdf-schema#comment> ?note "
            "FILTER(STRSTARTS(?note, 'load ')) }"
        )
        assert row["note"].value.endswith("mended by rtask2020-variant")


@pytest.mark.slow
def test_without_patches_the_cause_is_told_and_not_only_what_breaks() -> None:
    with rtask.open(":memory:") as kb:
        before = kb.seq
        with pytest.raises(InconsistentError) as caught:
            kb.load(VARIANT.encode(), format="turtle", patches=False)
        assert (
            "xsd:Variant owl:equivalentClass xsd:int and xsd:Variant owl:equivalentClass xsd:double"
            in str(caught.value)
        )
        causes = caught.value.details["causes"]
        assert {len(cause["statements"]) for cause in causes} == {2}
        assert all(cause["smallest"] for cause in causes)
        assert len(caught.value.details["contradictions"]) == 100
        assert kb.seq == before


def test_a_fault_with_a_list_goes_with_its_list_and_nothing_else_does() -> None:
    with rtask.open(":memory:", ontologies=False) as kb:
        report = kb.load(POS.encode(), format="turtle")
        assert report.files[0].patches == ("pos-disjoint-union",)
        left = kb.match(None, OWL + "disjointUnionOf")
        assert [quad.subject.value.rpartition("#")[2] for quad in left] == ["Other"]
        assert report.files[0].added == 1 + 5


def test_a_patch_that_finds_nothing_is_told() -> None:
    mended = VARIANT.replace("owl:equivalentClass xsd:boolean, xsd:double, xsd:int, xsd:string", "")
    with rtask.open(":memory:", ontologies=False) as kb:
        report = kb.load(mended.replace("; .", ".").encode(), format="turtle")
    assert "rtask2020-variant" in report.warnings[0]
    assert report.files[0].patches == ()


def test_patches_have_names_reasons_and_are_listed() -> None:
    assert len({patch.name for patch in patches()}) == len(patches()) >= 3
    done = CliRunner().invoke(cli, ["ontology", "patches", "--json"])
    listed = json.loads(done.output)
    assert [patch["name"] for patch in listed] == [patch.name for patch in patches()]
    assert all(patch["reason"] and patch["edition"] and patch["removes"] for patch in listed)
    assert "rtask2020-variant" in CliRunner().invoke(cli, ["ontology", "patches"]).output


@pytest.mark.slow
def test_the_command_says_what_it_mended(tmp_path: Path) -> None:
    file = tmp_path / "sumo.ttl"
    file.write_text(VARIANT)
    options = ["--data", str(tmp_path / "kb")]
    done = CliRunner().invoke(cli, ["load", str(file), *options])
    assert "mended by the patch rtask2020-variant" in done.output
    refused = CliRunner().invoke(cli, ["load", str(file), "--replace", "--no-patches", *options])
    assert "causes, each enough" in str(refused.exception)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_every_published_file_loads_with_reasoning_on(ontologies_dir: Path, name: str) -> None:
    with rtask.open(":memory:") as kb:
        report = kb.load(ontologies_dir / name, missing_imports="warn")
        own = next(file for file in report.files if file.name.endswith(name))
        assert own.read > 0
        assert own.patches == ((PATCHED[name],) if name in PATCHED else ())
        assert kb.contradictions() == []


def test_the_list_of_files_is_that_of_the_folder(ontologies_dir: Path) -> None:
    kinds = {".owl", ".rdf", ".nt", ".jsonld", ".ttl", ".n3"}
    found = [p for p in ontologies_dir.rglob("*") if p.suffix in kinds and "local" not in p.parts]
    assert sorted(p.relative_to(ontologies_dir).as_posix() for p in found) == sorted(FILES)
    assert ontology.patches().is_file()
