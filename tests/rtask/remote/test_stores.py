"""Promises of a knowledge base, wherever its statements are: memory, folder, SPARQL servers."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import ontology
import rtask
from rtask.errors import (
    DataError,
    ForbiddenError,
    InconsistentError,
    RtaskError,
    VersionConflictError,
)
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change
from rtask.kb.commit.inference import Inference
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import BlankNode, Literal, iri, literal, prologue
from rtask.remote.store import RemoteStore
from tests.rtask.remote.places import TBOX, texts

pytestmark = pytest.mark.slow

_PREFIXES = prologue(ontology.PREFIXES)
_RT = ontology.NS


def test_a_transaction_is_one_commit_with_an_owner(kb: KnowledgeBase) -> None:
    with kb.transaction(agent="nao-1", note="first sight") as tx:
        tx.add("urn:mug", "urn:mass", 0.3)
        tx.update("INSERT { ?s <urn:heavy> true } WHERE { ?s <urn:mass> ?m FILTER(?m > 0.2) }")
        tx.remove("urn:mug", "urn:mass", 0.3)
    assert (tx.commit.seq, tx.commit.added, tx.commit.removed) == (1, 1, 0)
    [quad] = kb.match("urn:mug")
    assert quad.graph_name == kb.graphs.agent("nao-1")
    assert quad.predicate == iri("urn:heavy")
    [entry] = kb.history("urn:mug")
    assert (entry.seq, entry.agent, entry.note) == (1, "nao-1", "first sight")
    assert texts(kb, f"?a <{_RT}commitNumber> 1 . ?a a <{_RT}WriteActivity> BIND(?a AS ?x)") == [
        str(tx.commit.activity)
    ]


def test_an_exception_rolls_the_transaction_back(kb: KnowledgeBase) -> None:
    def write() -> None:
        with kb.transaction() as tx:
            tx.add("urn:mug", "urn:mass", 0.3)
            raise RuntimeError("the robot fell over")

    with pytest.raises(RuntimeError, match="fell over"):
        write()
    assert kb.match("urn:mug") == []
    assert kb.seq == 0
    kb.update("INSERT DATA { <urn:mug> <urn:mass> 1 }")  # the lock is free again


def test_the_union_counts_a_triple_once_however_many_graphs_hold_it(kb: KnowledgeBase) -> None:
    for agent in ("nao-1", "nao-2"):
        kb.update("INSERT DATA { <urn:mug> <urn:colour> 'red' }", agent)
    assert texts(kb, "<urn:mug> <urn:colour> ?x") == ['"red"']
    assert len(kb.match("urn:mug")) == 2
    kb.update("DELETE DATA { <urn:mug> <urn:colour> 'red' }", "nao-1")
    assert texts(kb, "<urn:mug> <urn:colour> ?x") == ['"red"']
    kb.update("DELETE DATA { <urn:mug> <urn:colour> 'red' }", "nao-2")
    assert texts(kb, "<urn:mug> <urn:colour> ?x") == []


def test_named_graphs_can_be_asked_for(kb: KnowledgeBase) -> None:
    kb.update(
        "INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } GRAPH <urn:h> { <urn:a> <urn:p> 1 } }"
    )
    assert texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:g>", "<urn:h>"]
    rows = kb.select("SELECT ?x { ?x <urn:p> 1 }", default_graphs=["urn:g"])
    assert [str(x) for (x,) in rows] == ["<urn:a>"]
    assert not kb.select("SELECT ?x { ?x <urn:p> 1 }", default_graphs=["urn:none"])
    kb.update("DROP GRAPH <urn:g>")
    assert texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:h>"]
    kb.update("MOVE <urn:h> TO <urn:i>")
    assert texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:i>"]
    with pytest.raises(DataError, match="does not exist"):
        kb.update("CLEAR GRAPH <urn:h>")


def test_a_variable_for_graphs_ranges_over_those_of_the_knowledge_base(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } <urn:a> <urn:q> 2 }")
    theirs = "GRAPH <urn:somebody> { <urn:a> <urn:p> 1 }"
    if isinstance(kb.store, RemoteStore):  # another program's graph on the same server
        kb.store.endpoints.update(f"INSERT DATA {{ {theirs} }}")
    known = sorted(str(graph) for graph in kb.store.named_graphs() if kb.store.count(graph))
    try:
        assert texts(kb, "{ SELECT DISTINCT ?x { GRAPH ?x { ?s ?p ?o } } }") == known
        assert texts(kb, "GRAPH ?x { <urn:a> <urn:p> ?o }GRAPH $x { ?s <urn:p> 1 }") == ["<urn:g>"]
        nested = "?s <urn:q> 2 FILTER EXISTS { GRAPH ?g { ?s <urn:p> 1 } } BIND(?s AS ?x)"
        assert texts(kb, nested) == ["<urn:a>"]
        found = kb.query("CONSTRUCT { ?g <urn:holds> ?s } { GRAPH ?g { ?s <urn:p> 1 } }")
        assert [str(triple.subject) for triple in found] == ["<urn:g>"]
    finally:
        if isinstance(kb.store, RemoteStore):
            kb.store.endpoints.update(f"DELETE DATA {{ {theirs} }}")


_VALUES = [
    literal(3), literal(-(2**53) - 1), literal(0.1), literal(True), literal("Becher \\ \" \n ☕"),
    Literal("mug", language="en"), Literal("2.5", datatype=iri(rtask.rdf.terms.XSD + "decimal")),
    Literal("3", datatype=iri(rtask.rdf.terms.XSD + "decimal")),
    Literal("2026-01-02T03:04:05.25Z", datatype=iri(rtask.rdf.terms.XSD + "dateTime")),
    Literal("PT1M30S", datatype=iri(rtask.rdf.terms.XSD + "duration")),
    Literal("POINT(1 2)", datatype=iri("http://www.opengis.net/ont/geosparql#wktLiteral")),
    iri("urn:x#é"),
]  # fmt: skip


def test_values_come_back_as_they_were_given_and_can_be_removed(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for value in _VALUES:
            tx.add("urn:a", "urn:p", value)
    assert {q.object for q in kb.match("urn:a")} == set(_VALUES)
    assert {row[0] for row in kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")} == set(_VALUES)
    with kb.transaction() as tx:
        for value in _VALUES:
            tx.remove("urn:a", "urn:p", value)
    assert tx.commit.removed == len(_VALUES)
    assert kb.match("urn:a") == []


_HOSTILE = [
    Literal("urn:rtask:as:no datatype"), Literal("urn:rtask:as:"),
    Literal("urn:rtask:as:urn:x 1", language="en"),
    iri("urn:lab/.well-known/genid/_/a/b"), iri("urn:lab/.well-known/genid/_/"),
]  # fmt: skip


def test_values_that_look_like_those_on_their_way_to_a_server_come_back(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for value in _HOSTILE:
            tx.add("urn:a", "urn:p", value)
    assert {q.object for q in kb.match("urn:a")} == set(_HOSTILE)
    assert {row[0] for row in kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")} == set(_HOSTILE)
    found = kb.query("CONSTRUCT WHERE { <urn:a> <urn:p> ?x }")
    assert {triple.object for triple in found} == set(_HOSTILE)
    with kb.transaction() as tx:
        for value in _HOSTILE:
            tx.remove("urn:a", "urn:p", value)
    assert kb.match("urn:a") == []


def test_blank_nodes_keep_their_names(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> [ <urn:q> 1, 2 ] } }")
    [quad] = kb.match("urn:a")
    assert isinstance(quad.object, BlankNode)
    assert len(kb.match(quad.object)) == 2
    assert len(kb.select("SELECT ?x { <urn:a> <urn:p>/<urn:q> ?x }")) == 2
    [row] = kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")
    assert row[0] == quad.object
    with kb.transaction() as tx:
        tx.remove("urn:a", "urn:p", quad.object, "urn:g")
    assert kb.match("urn:a") == []


def test_rights_hold(kb: KnowledgeBase) -> None:
    robot = Access("nao-1", "robot")
    with pytest.raises(ForbiddenError, match="nao-1"):
        kb.update("INSERT DATA { GRAPH <urn:lab/graph/agent/nao-2> { <urn:a> <urn:p> 1 } }",
                  access=robot)  # fmt: skip
    with pytest.raises(ForbiddenError, match="only the knowledge base itself"):
        kb.update("INSERT DATA { GRAPH <urn:lab/graph/meta> { <urn:a> <urn:p> 1 } }")
    assert kb.seq == 0


def test_a_version_can_be_required(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", if_version=0)
    with pytest.raises(VersionConflictError, match="expected version 0, found 1"):
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }", if_version=0)
    assert texts(kb, "<urn:a> <urn:p> ?x") == [str(literal(1))]


def test_commits_are_announced_and_searched(kb: KnowledgeBase) -> None:
    heard: list[Change] = []
    kb.on_commit(heard.append)
    with kb.transaction() as tx:
        tx.add("urn:mug", "http://www.w3.org/2000/01/rdf-schema#label", literal("red coffee mug"))
    assert [change.commit.seq for change in heard] == [1]
    assert [str(hit.subject) for hit in kb.search("coffee")] == ["<urn:mug>"]


def test_blobs_are_kept_and_missing_ones_refused(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        name = tx.blob(b"a picture", "image/png")
    assert kb.blobs.read(name) == b"a picture"
    with pytest.raises(RtaskError, match="not stored here"), kb.transaction() as tx:
        tx.add("urn:a", "urn:p", iri("urn:sha256:" + "0" * 64))


def test_what_was_stored_is_there_after_opening_again(place: Callable[..., KnowledgeBase]) -> None:
    with place() as kb:
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}", "nao-1")
        before = kb.stats()
    with place(again=True) as kb:
        assert kb.seq == 3
        after = kb.stats()
        assert {k: after[k] for k in ("triples", "asserted", "graphs", "commits")} == {
            k: before[k] for k in ("triples", "asserted", "graphs", "commits")
        }
        assert [entry.seq for entry in kb.history("urn:a")] == [1, 2, 3]
        kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
        assert kb.seq == 4


def test_a_change_of_many_statements_is_one_commit(kb: KnowledgeBase) -> None:
    """More than one request of any server holds."""
    count = 6_000
    with kb.transaction() as tx:
        for number in range(count):
            tx.add(f"urn:s{number % 50}", "urn:p", number, "urn:big")
    assert (tx.commit.seq, tx.commit.added) == (1, count)
    [row] = kb.select("SELECT (COUNT(*) AS ?n) { GRAPH <urn:big> { ?s ?p ?o } }")
    assert int(str(row.value("n"))) == count
    kb.update("CLEAR GRAPH <urn:big>")
    assert not kb.query("ASK { ?s <urn:p> ?o }")


def test_readmes_calls_with_reasoning_contradictions_and_quarantine(
    place: Callable[..., KnowledgeBase],
) -> None:
    with place(reason=True, on_inconsistency="quarantine") as kb:
        kb.load(_PREFIXES.replace("PREFIX", "@prefix").replace(">", "> .").encode() + b"""
            rt:Mug a owl:Class ; rdfs:subClassOf rt:Vessel .
            rt:Vessel owl:disjointWith rt:Robot .
            """, format="turtle", graph="urn:lab/graph/import/tbox")  # fmt: skip
        with kb.transaction(agent="nao-1") as tx:
            tx.add("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert tx.commit.derived == 1
        assert kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}") is True
        assert not kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}", inferred=False)
        assert kb.explain("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Vessel")).holds
        with kb.transaction(agent="nao-2") as tx:
            tx.add("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Robot"))
            tx.add("urn:mug", "urn:mass", 0.3)
        assert tx.commit.quarantined == 1
        assert len(kb.quarantined()) == 1
        with kb.transaction(agent="nao-1") as tx:
            tx.remove("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}") is False
    with place(again=True, reason=True) as kb:
        with kb.transaction() as tx:
            tx.add("urn:cup", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert tx.commit.derived == 1
        with pytest.raises(InconsistentError), kb.transaction() as tx:
            tx.add("urn:cup", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Robot"))


def test_the_closure_is_there_after_opening_again(
    place: Callable[..., KnowledgeBase], built: list[Inference], monkeypatch: pytest.MonkeyPatch
) -> None:
    with place(reason=True) as kb:
        kb.load(TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        kb.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-1")
    built.clear()
    with monkeypatch.context() as patch, place(again=True, reason=True) as kb:
        patch.setattr(Inference, "prepare_save", lambda _: None)  # as if it were killed later
        kb.update("DELETE DATA { <urn:m0> a <urn:t:Mug> }", "nao-1")
        kb.update("INSERT DATA { <urn:m1> a <urn:t:Mug> }", "nao-1")
        kb.close()
    with place(again=True, reason=True) as kb:
        with kb.transaction(agent="nao-1") as tx:
            tx.add("urn:m2", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Mug"))
        assert tx.commit.derived == 2
        assert kb.explain("urn:m1", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing")).holds
        assert not kb.explain("urn:m0", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing"))
    assert built == []
