"""``rtask search``, and ``rtask query`` with a deadline."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli


def test_search_prints_what_fits(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        kb.update(
            "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
            "INSERT DATA { <urn:cup> rdfs:label 'Red cup'@en . <urn:pen> rdfs:label 'pen' }"
        )
    options = ["--data", str(tmp_path / "kb")]
    done = CliRunner().invoke(cli, ["search", "red", "cu*", *options])
    assert (done.exit_code, done.output) == (0, "urn:cup  Red cup@en\n")
    done = CliRunner().invoke(cli, ["search", "pen", "--json", *options])
    assert json.loads(done.output)[0]["iri"] == "urn:pen"
    german = CliRunner().invoke(cli, ["search", "pen", "--lang", "de", *options])
    assert german.output == "nothing found\n"


def test_a_class_that_nothing_mentions_is_an_error_and_not_an_empty_answer(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        kb.update("INSERT DATA { <urn:cup> a <urn:Cup> ; <urn:named> 'red' }")
    options = ["--data", str(tmp_path / "kb")]
    done = CliRunner().invoke(cli, ["search", "red", "--class", "urn:Cups", *options])
    assert "no statement mentions urn:Cups" in str(done.exception)
    other = CliRunner().invoke(cli, ["search", "blue", "--class", "urn:Cup", *options])
    assert (other.exit_code, other.output) == (1, "nothing found\n")


@pytest.mark.slow
def test_a_query_ends_at_its_deadline(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb, kb.transaction() as tx:
        for number in range(1_000):
            tx.add("urn:s", "urn:p", number)
    options = ["--data", str(tmp_path / "kb"), "--timeout", "0.5"]
    endless = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
    done = CliRunner().invoke(cli, ["query", endless, *options])
    assert "within 0.5 s" in str(done.exception)
    options[-1] = "60"
    done = CliRunner().invoke(cli, ["query", "ASK { ?s ?p 1 }", "-F", "json", *options])
    assert json.loads(done.output)["boolean"] is True
