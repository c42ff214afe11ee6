"""A default graph of several graphs is their merge: a statement that two hold counts once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
from pyoxigraph import BlankNode
from rdflib import BNode, Graph

import rtask
from rtask.knowledge_base import KnowledgeBase

pytestmark = pytest.mark.slow

_GRAPHS = {
    "urn:a": """<urn:s> <urn:p> 1, 2 . <urn:t> <urn:p> 2 . _:b <urn:p> 3 .
                <urn:s> <urn:q> <urn:t>""",
    "urn:b": """<urn:s> <urn:p> 1 . <urn:u> <urn:p> 4 . <urn:s> <urn:q> <urn:t> .
                <urn:t> <urn:q> <urn:u>""",
    "urn:c": "<urn:u> <urn:p> 4 . <urn:v> <urn:p> 5",
    "urn:d": "<urn:alone> <urn:p> 6",
}
_BODIES = [
    "SELECT (COUNT(*) AS ?n) {} {{ ?s ?p ?o }}",
    "SELECT ?s ?o {} {{ ?s <urn:p> ?o }}",
    "SELECT ?o (COUNT(?s) AS ?n) (SUM(?o) AS ?sum) {} {{ ?s <urn:p> ?o }} GROUP BY ?o",
    "SELECT ?o {} {{ <urn:s> <urn:q>/<urn:p> ?o }}",
    "SELECT ?o {} {{ <urn:s> <urn:q>+ ?o }}",
    "SELECT DISTINCT ?s {} {{ ?s <urn:p> ?o }}",
    "SELECT ?n {} {{ {{ SELECT (COUNT(?o) AS ?n) {{ ?s <urn:p> ?o }} }} }}",
    "SELECT DISTINCT ?n {} {{ {{ SELECT (COUNT(?o) AS ?n) {{ ?s <urn:p> ?o }} }} }}",
    "ASK {} {{ <urn:t> <urn:p> ?o . <urn:u> <urn:p> ?q }}",
]
_CHOICES = [("urn:a", "urn:b"), ("urn:a", "urn:b", "urn:c"), ("urn:a", "urn:d"), ("urn:a", "urn:a")]


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    blocks = " ".join(f"GRAPH <{name}> {{ {said} }}" for name, said in _GRAPHS.items())
    with rtask.open(":memory:", ontologies=False, reason=False) as opened:
        opened.update(f"INSERT DATA {{ {blocks} }}")
        yield opened


def _expected(body: str, graphs: tuple[str, ...]) -> bool | Counter[tuple[str, ...]]:
    """Return what rdflib answers on one graph that holds the statements of all."""
    merged = Graph()
    for name in dict.fromkeys(graphs):
        merged.parse(data=f"{_GRAPHS[name]} .", format="turtle")
    answer = merged.query(body.format(""))
    return bool(answer.askAnswer) if answer.type == "ASK" else _counted(answer)


def _counted(rows: Iterable[Any]) -> Counter[tuple[str, ...]]:
    """Return how often each row occurs; blank nodes have other labels on the other side."""
    return Counter(
        tuple(
            "_:" if isinstance(one, BNode | BlankNode) else str(getattr(one, "value", one))
            for one in row
        )
        for row in rows
    )


@pytest.mark.parametrize("timeout_s", [None, 60.0], ids=["here", "in a reader"])
@pytest.mark.parametrize("graphs", _CHOICES, ids=" ".join)
@pytest.mark.parametrize("body", _BODIES)
def test_several_default_graphs_answer_as_one(
    kb: KnowledgeBase, body: str, graphs: tuple[str, ...], timeout_s: float | None
) -> None:
    expected = _expected(body, graphs)
    clauses = " ".join(f"FROM <{name}>" for name in graphs)
    for given in (
        kb.query(body.format(""), default_graphs=graphs, timeout_s=timeout_s),
        kb.query(body.format(clauses), timeout_s=timeout_s),
    ):
        assert (given if isinstance(given, bool) else _counted(given)) == expected


def test_graphs_for_patterns_in_graph_stay_apart(kb: KnowledgeBase) -> None:
    text = "SELECT ?g ?o {} {{ ?s <urn:p> 1 . GRAPH ?g {{ ?s <urn:p> ?o }} }} ORDER BY ?g ?o"
    named = "FROM <urn:a> FROM <urn:b> FROM NAMED <urn:a> FROM NAMED <urn:b>"
    rows = [("urn:a", 1), ("urn:a", 2), ("urn:b", 1)]
    both = ["urn:a", "urn:b"]
    for found in (
        kb.select(text.format(""), default_graphs=both, named_graphs=both),
        kb.select(text.format(named)),
    ):
        assert [(row.value("g"), row.value("o")) for row in found] == rows


def test_asserted_statements_count_once_though_two_graphs_hold_them(kb: KnowledgeBase) -> None:
    text = "SELECT (COUNT(*) AS ?n) { ?s <urn:p>|<urn:q> ?o }"
    assert kb.select(text, inferred=False)[0].value("n") == 9


def test_updates_count_a_statement_of_several_graphs_once() -> None:
    """Three numbers, of which both graphs hold one."""
    counting = (
        "INSERT { ?s <urn:n> ?n } USING <urn:a> USING <urn:b> "
        "WHERE { SELECT ?s (COUNT(*) AS ?n) { ?s <urn:p> ?o } GROUP BY ?s }"
    )
    with rtask.open(":memory:", ontologies=False, reason=False) as opened:
        opened.update(
            "INSERT DATA { GRAPH <urn:a> { <urn:s> <urn:p> 1, 2 } "
            "GRAPH <urn:b> { <urn:s> <urn:p> 2, 3 } }"
        )
        opened.update(counting)
        assert [str(q.object.value) for q in opened.match(None, "urn:n")] == ["3"]
