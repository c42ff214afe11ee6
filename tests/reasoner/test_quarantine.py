"""With the policy `quarantine`, what contradicts the rest is kept aside and can come back."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import rtask
from rtask.cli.maintenance import quarantine
from rtask.errors import ForbiddenError, InconsistentError, UsageError
from rtask.knowledge_base import KnowledgeBase

SCHEMA = b"""
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<urn:onto> a owl:Ontology .
<urn:Mug> rdfs:subClassOf <urn:Vessel> .
<urn:Vessel> owl:disjointWith <urn:Robot> .
<urn:Pen> a owl:Class .
"""


def opened(target: str | Path) -> KnowledgeBase:
    return rtask.open(target, ontologies=False, on_inconsistency="quarantine")


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with opened(":memory:") as made:
        made.load(SCHEMA, format="turtle")
        made.update("INSERT DATA { <urn:nao> a <urn:Robot> }", agent="nao")
        yield made


def types(kb: KnowledgeBase, name: str) -> set[str]:
    rows = kb.select(f"SELECT ?t {{ <urn:{name}> a ?t }}")
    return {str(row.value("t")) for row in rows}


def test_the_statement_to_blame_is_kept_aside_and_the_rest_is_stored(kb: KnowledgeBase) -> None:
    done = kb.update("INSERT DATA { <urn:nao> a <urn:Mug> . <urn:m> a <urn:Mug> }", agent="pr2")
    assert done.quarantined == 1
    assert types(kb, "nao") == {"urn:Robot"}
    assert types(kb, "m") == {"urn:Mug", "urn:Vessel"}
    [kept] = kb.quarantined()
    assert str(kept.quad.object) == "<urn:Mug>"
    assert kept.quad.graph_name == kb.graphs.agent("pr2")
    assert "disjoint" in kept.reason
    assert kept.activity == done.activity


def test_it_is_neither_reasoned_over_nor_in_the_union_and_a_query_lists_it(
    kb: KnowledgeBase,
) -> None:
    kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
    assert not kb.query("ASK { <urn:nao> a <urn:Vessel> }")
    assert not kb.query("ASK { <urn:nao> a <urn:Mug> }")
    assert not kb.query("ASK { <urn:nao> a <urn:Mug> }", inferred=False)
    assert kb.query(f"ASK {{ GRAPH {kb.graphs.quarantine} {{ <urn:nao> a <urn:Mug> }} }}")
    assert kb.contradictions() == []
    assert kb.verify() == []


def test_it_comes_back_once_the_cause_is_gone(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
    with pytest.raises(InconsistentError):
        kb.release()
    assert len(kb.quarantined()) == 1
    kb.update("DELETE DATA { <urn:nao> a <urn:Robot> }", agent="nao")
    kb.release()
    assert kb.quarantined() == []
    assert types(kb, "nao") == {"urn:Mug", "urn:Vessel"}
    assert kb.match(graph=kb.graphs.quarantine) == []
    assert kb.verify() == []


def test_statements_can_be_forgotten_one_by_one(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
    kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="tiago")
    first, second = kb.quarantined()
    kb.release([first.node.value], drop=True)
    assert kb.quarantined() == [second]
    assert kb.query(f"ASK {{ GRAPH {kb.graphs.quarantine} {{ <urn:nao> a <urn:Mug> }} }}")
    with pytest.raises(UsageError, match="nothing in quarantine"):
        kb.release([first.node.value])


def test_two_statements_of_one_commit_that_clash_with_each_other_go_both(
    kb: KnowledgeBase,
) -> None:
    done = kb.update("INSERT DATA { <urn:x> a <urn:Mug>, <urn:Robot>, <urn:Pen> }", agent="pr2")
    assert done.quarantined == 2
    assert types(kb, "x") == {"urn:Pen"}


def test_an_axiom_that_makes_known_data_inconsistent_is_kept_aside(kb: KnowledgeBase) -> None:
    done = kb.update("INSERT DATA { <urn:n> a <urn:Robot>, <urn:Pen> }", agent="nao")
    assert done.quarantined == 0
    axiom = "<urn:Pen> <http://www.w3.org/2002/07/owl#disjointWith> <urn:Robot>"
    done = kb.update(f"INSERT DATA {{ {axiom} . <urn:p> a <urn:Pen> }}")
    assert done.quarantined == 1
    assert types(kb, "p") == {"urn:Pen"}
    assert kb.contradictions() == []


def test_an_agent_releases_only_into_graphs_that_it_may_write(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
    kb.update("DELETE DATA { <urn:nao> a <urn:Robot> }", agent="nao")
    with pytest.raises(ForbiddenError):
        kb.release(agent="nao")
    kb.release(agent="pr2")
    assert types(kb, "nao") == {"urn:Mug", "urn:Vessel"}


def test_nobody_writes_the_quarantine_graph_directly(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError):
        kb.update(f"INSERT DATA {{ GRAPH {kb.graphs.quarantine} {{ <urn:a> <urn:b> 1 }} }}")


def test_it_survives_closing_and_opening(tmp_path: Path) -> None:
    with opened(tmp_path / "kb") as kb:
        kb.load(SCHEMA, format="turtle")
        kb.update("INSERT DATA { <urn:nao> a <urn:Robot> }", agent="nao")
        kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        assert len(kb.quarantined()) == 1
        assert kb.verify() == []
        with pytest.raises(InconsistentError):
            kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")


@pytest.mark.slow
def test_the_command_lists_releases_and_forgets(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with opened(folder) as kb:
        kb.load(SCHEMA, format="turtle")
        kb.update("INSERT DATA { <urn:nao> a <urn:Robot> }", agent="nao")
        kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="pr2")
        kb.update("INSERT DATA { <urn:nao> a <urn:Mug> }", agent="tiago")
        first, _ = (one.node.value for one in kb.quarantined())

    def run(*options: str) -> Result:
        return CliRunner().invoke(quarantine, ["--data", str(folder), *options])

    assert "disjoint" in run().output
    assert "2 in quarantine" in run().output
    assert json.loads(run("--json", first).output)[0]["record"] == first
    assert isinstance(run("--release").exception, InconsistentError)
    assert "1 deleted" in run("--forget", first).output
    with rtask.open(folder) as kb:
        kb.update("DELETE DATA { <urn:nao> a <urn:Robot> }", agent="nao")
    assert "1 put back" in run("--release").output
    assert "0 in quarantine" in run().output


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(UsageError, match="one of error, quarantine"):
        rtask.open(":memory:", on_inconsistency="ignore")
