"""Queries: datasets, bindings, limits, forms of the answer."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator

import pytest

import rtask
from rtask.errors import (
    DataError,
    ForbiddenError,
    QuerySyntaxError,
    TooLargeError,
    UnsupportedError,
    UsageError,
)
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import iri
from rtask.sparql.results import Solutions, Triples
from rtask.sparql.syntax import check_query

pytestmark = pytest.mark.slow


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/", ontologies=False) as opened:
        opened.update(
            """INSERT DATA {
            GRAPH <urn:g1> { <urn:a> <urn:p> 1 . <urn:A> <http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:B> }
            GRAPH <urn:g2> { <urn:a> <urn:p> 2 . <urn:a> a <urn:A> } }"""  # noqa: E501
        )
        yield opened


def _values(kb: KnowledgeBase, text: str, **options: object) -> list[object]:
    return sorted(row.value(0) for row in kb.select(text, **options))  # type: ignore[type-var]


def test_patterns_see_all_graphs_at_once(kb: KnowledgeBase) -> None:
    assert _values(kb, "SELECT ?o { <urn:a> <urn:p> ?o }") == [1, 2]
    assert _values(kb, "SELECT ?g { GRAPH ?g { <urn:a> <urn:p> 2 } }") == ["urn:g2"]


def test_a_named_dataset_replaces_the_union(kb: KnowledgeBase) -> None:
    text = "SELECT ?o FROM <urn:g1> { <urn:a> <urn:p> ?o }"
    assert _values(kb, text) == [1]
    assert _values(kb, text, inferred=False) == [1]
    assert _values(kb, text, default_graphs=["urn:g2"]) == [2]
    both = "SELECT ?o { { <urn:a> <urn:p> ?o } UNION { GRAPH ?g { <urn:a> <urn:p> ?o } } }"
    assert _values(kb, both, default_graphs=["urn:g1"]) == [1]
    assert _values(kb, both, named_graphs=["urn:g2"]) == [2]


def test_derived_statements_can_be_left_out(kb: KnowledgeBase) -> None:
    types = "SELECT ?t { <urn:a> a ?t }"
    assert _values(kb, types) == ["urn:A", "urn:B"]
    assert _values(kb, types, inferred=False) == ["urn:A"]
    in_graphs = "SELECT ?t { GRAPH ?g { <urn:a> a ?t } }"
    assert _values(kb, in_graphs, inferred=False) == ["urn:A"]


def test_answers_are_complete_and_may_travel(kb: KnowledgeBase) -> None:
    found = kb.query(
        "SELECT ?s ?o ?none { ?s <urn:p> ?o OPTIONAL { ?s <urn:no> ?none } } ORDER BY ?o"
    )
    assert isinstance(found, Solutions)
    seen: list[object] = []
    thread = threading.Thread(target=lambda: seen.extend(found.to_dicts()))
    thread.start()
    thread.join()
    assert seen == [{"s": "urn:a", "o": 1, "none": None}, {"s": "urn:a", "o": 2, "none": None}]
    assert found.variables == ("s", "o", "none")
    assert found[1]["o"] == found[1][1] == found[-1]["?o"]
    assert [row.value("o") for row in found[:1]] == [1]
    with pytest.raises(UsageError, match="no variable 'x' in this result; it has s, o, none"):
        found[0]["x"]


def test_other_forms_of_query(kb: KnowledgeBase) -> None:
    assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
    triples = kb.query("CONSTRUCT { ?s <urn:q> ?o } WHERE { ?s <urn:p> ?o }")
    assert isinstance(triples, Triples)
    assert len(triples) == 2
    assert triples.serialize().startswith(b"<urn:a> <urn:q> ")
    with pytest.raises(UnsupportedError):
        kb.select("ASK {}")


def test_answers_in_media_types(kb: KnowledgeBase) -> None:
    rows = kb.serialize("SELECT ?o { <urn:a> <urn:p> ?o } ORDER BY ?o", "text/csv")
    assert rows == b"o\r\n1\r\n2\r\n"
    asked = json.loads(kb.serialize("ASK {}", "application/sparql-results+json"))
    assert asked["boolean"] is True
    assert kb.serialize("CONSTRUCT WHERE { ?s <urn:p> 1 }", "text/turtle").startswith(b"<urn:a>")
    with pytest.raises(UsageError, match="cannot represent rows"):
        kb.serialize("SELECT * {}", "text/turtle")
    with pytest.raises(UsageError, match="cannot represent triples"):
        kb.serialize("CONSTRUCT WHERE { ?s ?p ?o }", "text/csv")


@pytest.mark.parametrize(
    "text",
    [
        'quote " and \\ backslash',
        "line\nbreak\r\ttab",
        '"""',
        "} # SELECT",
        "\\u0022 } DROP ALL",
        "😀 ü",
        "?o",
        "",
    ],
)
def test_bound_values_are_data_whatever_they_hold(kb: KnowledgeBase, text: str) -> None:
    with kb.transaction() as tx:
        tx.add("urn:text", "urn:says", text)
    found = kb.select("SELECT ?s ?x { ?s <urn:says> ?x }", bindings={"x": text})
    assert [row.value("x") for row in found] == [text]
    assert len(kb.select("SELECT ?s { ?s <urn:says> ?x }", bindings={"x": text + "."})) == 0


def test_bindings_take_terms_and_lists(kb: KnowledgeBase) -> None:
    text = "PREFIX p: <urn:> SELECT ?s ?o WHERE { ?s p:p ?o }"
    assert len(kb.select(text, bindings={"s": iri("urn:a"), "?o": [1, 2, 3]})) == 2
    assert len(kb.select(text, bindings={"o": []})) == 0
    built = kb.query("CONSTRUCT { ?s <urn:q> ?o } WHERE { ?s <urn:p> ?o }", bindings={"o": 2})
    assert len(built) == 1  # type: ignore[arg-type]
    from rtask.rdf.terms import BlankNode

    with pytest.raises(UsageError, match="blank node"):
        kb.select(text, bindings={"s": BlankNode()})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("SELECT ?x WHERE { ?x", "query 1:"),
        ("", "query 1:1"),
        ("SELECT * {\n ?s e:p ?o }", "2:5: undeclared prefix 'e:'"),
        ("INSERT DATA { <urn:a> <urn:p> 1 }", "query 1:1"),
    ],
)
def test_errors_say_where(kb: KnowledgeBase, text: str, message: str) -> None:
    for ask in (kb.query, check_query):
        with pytest.raises(QuerySyntaxError, match=message):
            ask(text)  # type: ignore[operator]


@pytest.fixture(scope="module")
def empty() -> Iterator[KnowledgeBase]:
    """A knowledge base for texts that are refused before anything is looked up."""
    with rtask.open(":memory:", ontologies=False, reason=False) as opened:
        yield opened


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "ASK " + "{" * 10_000,
        "ASK { FILTER(" + "(" * 10_000,
        "ASK { FILTER(" + "!" * 10_000 + "true) }",
        "SELECT (" + "+".join(["1"] * 7_000) + " AS ?x) {}",
        "ASK { " + "<<( " * 10_000,
        "ASK { ?s <urn:p> " + "[ <urn:p> " * 5_000,
        "ASK { " + " ".join(f"?s <urn:p{n}> ?o{n} ." for n in range(3_000)) + " }",
        "ASK { ?s <urn:p> ?o" + " ; <urn:p> ?o" * 3_000 + " }",
        "ASK { ?s <urn:p> ?o" + " , ?o" * 3_000 + " }",
        "ASK { ?s <urn:p> (" + " 1" * 3_000 + ") }",
        "ASK { ?s <urn:p>" + "/<urn:p>" * 900 + " ?o }",
        "ASK { {?s ?p ?o}" + " UNION {?s ?p ?o}" * 3_000 + " }",
        "ASK { " + "OPTIONAL {?s ?p ?o} " * 3_000 + " }",
        "ASK { " + "{?s ?p ?o} " * 3_000 + " }",
        "ASK { " + "FILTER EXISTS {?s ?p ?o} " * 3_000 + " }",
        "ASK { " + " ".join(f"BIND(1 AS ?v{n})" for n in range(3_000)) + " }",
        "ASK { " + "{ SELECT * { ?s ?p ?o } } " * 3_000 + " }",
    ],
    ids=lambda text: text[:30],
)
def test_text_that_would_end_the_process_is_refused(empty: KnowledgeBase, text: str) -> None:
    with pytest.raises(TooLargeError, match="too complex"):
        empty.query(text)
    with pytest.raises((TooLargeError, QuerySyntaxError)):
        empty.update(text.replace("ASK", "DELETE {} WHERE"))


@pytest.mark.slow
def test_long_but_flat_text_is_fine(kb: KnowledgeBase) -> None:
    rows = " ".join(f"(<urn:{n}> {n})" for n in range(5_000))
    assert len(kb.select(f"SELECT * {{ VALUES (?a ?b) {{ {rows} }} }}")) == 5_000
    statements = " ".join(f"<urn:{n}> <urn:flat> {n} , 1 ; <urn:q> 2 ." for n in range(5_000))
    kb.update(f"INSERT DATA {{ {statements} }}")
    numbers = ",".join(map(str, range(5_000)))
    asked = f"SELECT * {{ ?s <urn:flat> ?o FILTER(?o IN ({numbers})) }}"
    assert len(kb.select(asked)) == 9_999
    branches = " UNION ".join(f"{{ <urn:{n}> <urn:flat> ?o }}" for n in range(200))
    assert len(kb.select(f"SELECT * {{ {branches} }}")) == 399
    flat = " ".join(f"?s <urn:flat> {n % 2} . ?s <urn:q> ?o ." for n in range(50))
    assert kb.query(f"ASK {{ {flat} }}") is True


def test_nothing_calls_out(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError, match="1:7: SERVICE is switched off"):
        kb.query("ASK { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }")
    assert kb.query("ASK { SERVICE SILENT <http://127.0.0.1:1/> { ?s ?p ?o } }") is True
    assert kb.query('ASK { BIND("SERVICE <x>" AS ?s) }') is True
    with pytest.raises(ForbiddenError):
        kb.update("INSERT { ?s ?p ?o } WHERE { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }")


def test_relative_names_are_resolved_against_the_base(kb: KnowledgeBase) -> None:
    assert kb.query("ASK { <a> <p> 1 }", base="urn:x") is True
    assert kb.query("ASK { <a> <p> 1 }", base="http://host/query") is False
    kb.update("INSERT DATA { <a> <p> 1 }", base="http://host/update")
    assert kb.query("ASK { <http://host/a> <http://host/p> 1 }") is True
    with pytest.raises(QuerySyntaxError):
        kb.query("ASK { <a> <p> 1 }")


def test_the_updates_dataset_and_its_own_exclude_each_other(kb: KnowledgeBase) -> None:
    kb.update("INSERT { <urn:x> <urn:p> ?o } WHERE { <urn:a> <urn:p> ?o }", using=["urn:g2"])
    assert _values(kb, "SELECT ?o { <urn:x> <urn:p> ?o }") == [2]
    for text in (
        "WITH <urn:g1> DELETE { ?s ?p 1 } WHERE { ?s ?p 1 }",
        "DELETE { ?s ?p 1 } USING <urn:g1> WHERE { ?s ?p 1 }",
    ):
        with pytest.raises(DataError, match="using-graph-uri"):
            kb.update(text, using=["urn:g2"])
