"""Inferences are stored in the same commit, kept apart, and withdrawn with their reasons."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.errors import InconsistentError, UnsupportedError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, iri

_OWL = "http://www.w3.org/2002/07/owl#"
_SCHEMA = """
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<urn:onto> a owl:Ontology .
<urn:Mug> rdfs:subClassOf <urn:Vessel> .
<urn:Vessel> rdfs:subClassOf <urn:Thing> ; owl:disjointWith <urn:Robot> .
"""


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/", ontologies=False) as opened:
        opened.load(_SCHEMA.encode(), format="turtle")
        yield opened


def _types(kb: KnowledgeBase, subject: str, inferred: bool = True) -> set[str]:
    rows = kb.select(f"SELECT ?t {{ <{subject}> a ?t }}", inferred=inferred)
    return {str(row.value("t")).removeprefix("urn:") for row in rows}


def test_a_commit_holds_what_follows_from_it(kb: KnowledgeBase) -> None:
    done = kb.update("INSERT DATA { <urn:m> a <urn:Mug> }", agent="nao-1")
    assert (done.added, done.derived) == (1, 2)
    assert _types(kb, "urn:m") == {"Mug", "Vessel", "Thing"}
    assert _types(kb, "urn:m", inferred=False) == {"Mug"}
    assert {q.graph_name for q in kb.match("urn:m", RDF_TYPE, iri("urn:Thing"))} == {
        kb.graphs.inferred
    }
    assert kb.verify() == []


def test_a_derived_statement_that_somebody_asserts_moves_and_comes_back(
    kb: KnowledgeBase,
) -> None:
    kb.update("INSERT DATA { <urn:m> a <urn:Mug> }", agent="nao-1")
    kb.update("INSERT DATA { <urn:m> a <urn:Thing> }", agent="nao-2")
    [quad] = kb.match("urn:m", RDF_TYPE, iri("urn:Thing"))
    assert quad.graph_name == kb.graphs.agent("nao-2")
    kb.update("DELETE DATA { <urn:m> a <urn:Thing> }", agent="nao-2")
    [quad] = kb.match("urn:m", RDF_TYPE, iri("urn:Thing"))
    assert quad.graph_name == kb.graphs.inferred
    kb.update("DELETE DATA { <urn:m> a <urn:Mug> }", agent="nao-1")
    assert kb.match("urn:m") == []
    assert kb.verify() == []


def test_what_two_robots_assert_follows_until_both_withdraw_it(kb: KnowledgeBase) -> None:
    for agent in ("nao-1", "nao-2"):
        kb.update("INSERT DATA { <urn:m> a <urn:Mug> }", agent=agent)
    kb.update("DELETE DATA { <urn:m> a <urn:Mug> }", agent="nao-1")
    assert _types(kb, "urn:m") == {"Mug", "Vessel", "Thing"}
    kb.update("DELETE DATA { <urn:m> a <urn:Mug> }", agent="nao-2")
    assert _types(kb, "urn:m") == set()


def test_a_contradiction_is_refused_and_nothing_stored(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:m> a <urn:Mug> }")
    before = {str(q) for q in kb.match()}
    with pytest.raises(InconsistentError, match="contradicts the ontology") as caught:
        kb.update("INSERT DATA { <urn:m> a <urn:Robot> ; <urn:p> 1 }")
    [clash] = caught.value.details["contradictions"]
    assert ["<urn:m>", f"<{RDF_TYPE.value}>", "<urn:Robot>"] in clash["triples"]
    assert clash["graphs"] == ["urn:lab/graph/shared"]
    assert {str(q) for q in kb.match()} == before
    assert kb.contradictions() == []
    kb.update("INSERT DATA { <urn:n> a <urn:Robot> }")  # the closure is as before


def test_new_schema_reaches_old_data(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:m> a <urn:Mug> }")
    kb.load(
        b"""@prefix owl: <http://www.w3.org/2002/07/owl#> .
        <urn:more> a owl:Ontology .
        <urn:Thing> <http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:All> .""",
        format="turtle",
    )
    assert "All" in _types(kb, "urn:m")


def test_the_commits_own_records_are_no_premises(kb: KnowledgeBase) -> None:
    kb.update(
        "INSERT DATA { GRAPH <urn:o> { "
        f"<{ontology.NS}WriteActivity> <http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:Act> "
        "} }"
    )
    assert kb.query("ASK { ?x a <urn:Act> }") is False


def test_what_was_written_without_reasoning_is_caught_up_at_the_next_open(
    tmp_path: Path,
) -> None:
    with rtask.open(tmp_path, ontologies=False) as kb:
        kb.load(_SCHEMA.encode(), format="turtle")
        assert kb.stats()["closure"] == "current"
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        kb.update("INSERT DATA { <urn:m> a <urn:Mug> }")
        assert kb.stats()["closure"] == "off"
        assert _types(kb, "urn:m") == {"Mug"}
    with rtask.open(tmp_path, ontologies=False) as kb:
        assert _types(kb, "urn:m") == {"Mug", "Vessel", "Thing"}
        assert kb.stats()["closure"] == "current"
        assert kb.verify() == []


def test_rebuild_restores_a_damaged_inferred_graph(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:m> a <urn:Mug> }")
    [lost] = kb.match("urn:m", RDF_TYPE, iri("urn:Thing"))
    kb.store.raw.remove(lost)
    assert {finding.part for finding in kb.verify()} == {"union", "catalogue", "closure"}
    kb.verify(repair=True)
    assert kb.verify() == []
    assert _types(kb, "urn:m") == {"Mug", "Vessel", "Thing"}


def test_a_proof_names_the_graphs_of_its_leaves(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:m> a <urn:Mug> }", agent="nao-1")
    proof = kb.explain("urn:m", RDF_TYPE, iri("urn:Thing"))
    assert proof is not None
    assert list(proof.leaves()) == [(iri("urn:m"), RDF_TYPE, iri("urn:Mug"))]
    assert "asserted: urn:lab/graph/agent/nao-1" in proof.render()
    assert kb.explain("urn:m", RDF_TYPE, iri("urn:Robot")).holds is False


def test_without_reasoning_there_is_nothing_to_rebuild() -> None:
    with (
        rtask.open(":memory:", ontologies=False, reason=False) as kb,
        pytest.raises(UnsupportedError, match="without reasoning"),
    ):
        kb.rebuild()


@pytest.mark.slow
def test_a_new_knowledge_base_knows_the_ontology(tmp_path: Path) -> None:
    with rtask.open(tmp_path) as kb:
        assert kb.seq == 1
        done = kb.update(f"INSERT DATA {{ <urn:m> a <{ontology.NS}Mug> }}", agent="nao-1")
        assert done.derived > 1
        assert kb.query(f"ASK {{ <urn:m> a <{ontology.NS}ManipulableObject> }}") is True
        assert kb.catalogue.is_ontology(iri(ontology.ONTOLOGY))
    with rtask.open(tmp_path) as kb:
        assert kb.seq == 2  # it is not loaded again


@pytest.mark.slow
def test_a_newer_bundled_ontology_replaces_the_stores_as_one_commit(tmp_path: Path) -> None:
    graph = iri(ontology.ONTOLOGY + "/grasp")
    version = iri(_OWL + "versionInfo")
    with rtask.open(tmp_path) as kb:
        size = kb.catalogue.triple_count(graph)
        [now] = kb.match(graph, version, None, graph)
        with kb.transaction() as tx:
            tx.clear(graph)
            tx.add(graph, version, "0.9.0", graph)
        seq = kb.seq
    with rtask.open(tmp_path) as kb:
        assert kb.seq == seq + 1
        assert kb.match(graph, version, None, graph) == [now]
        assert kb.catalogue.triple_count(graph) == size
        with kb.transaction() as tx:
            tx.remove(graph, version, now.object, graph)
            tx.add(graph, version, "99.0.0", graph)
        seq = kb.seq
    with rtask.open(tmp_path) as kb:
        assert kb.seq == seq  # a newer one of the user's stays
