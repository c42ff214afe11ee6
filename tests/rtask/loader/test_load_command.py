"""``rtask load`` of documents that contradict themselves or what is known."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli

CLASHING = """
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
<urn:limit> rdfs:range xsd:float .
<urn:joint> <urn:limit> "1.5"^^xsd:double ; <urn:name> "elbow" .
"""


@pytest.mark.slow  # two stores with the ontology
def test_what_clashes_is_refused_with_a_way_out_or_set_aside(tmp_path: Path) -> None:
    (tmp_path / "joints.ttl").write_text(CLASHING)
    call = ["load", str(tmp_path / "joints.ttl"), "--data", str(tmp_path / "kb")]
    refused = CliRunner().invoke(cli, call)
    assert refused.exit_code
    message = str(refused.exception) + refused.output
    assert "not in <http://www.w3.org/2001/XMLSchema#float>" in message
    assert "no value is both an xsd:double and an xsd:float" in message
    assert message.rstrip().endswith("--on-inconsistency quarantine stores what does not clash")

    done = CliRunner().invoke(cli, [*call, "--on-inconsistency", "quarantine"])
    assert done.exit_code == 0, done.output
    with rtask.open(tmp_path / "kb", mode="r") as kb:
        aside = len(kb.quarantined())
        assert f"{aside} statements contradict the rest and were set aside" in done.output
        assert aside >= 1
        assert kb.query('ASK { <urn:joint> <urn:name> "elbow" }')
        assert not kb.query("ASK { <urn:joint> <urn:limit> ?limit }")
