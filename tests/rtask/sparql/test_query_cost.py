"""Estimates of the cost of queries."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtask.sparql.query_cost import MAX_PATTERNS, is_lookup, is_quick


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("SELECT * { <urn:a> ?p ?o ; <urn:q> ?x . ?o <urn:r> ?y }", True),
        ("PREFIX : <urn:> ASK WHERE { ?s :p 'label' . ?s a :C }", True),
        ("SELECT * { ?s a <urn:C> }", False),
        ("SELECT * { ?s ?p <urn:C> }", False),
        ("SELECT * { <urn:a> ?p ?o . ?x <urn:q> ?y }", False),
        # few solutions are sorted and counted in no time
        ("SELECT (COUNT(*) AS ?n) { <urn:a> ?p ?o }", True),
        ("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }", False),
        ("SELECT DISTINCT ?o { <urn:a> ?p ?o }", True),
        ("SELECT DISTINCT ?p { ?s ?p ?o }", False),
        ("SELECT * { <urn:a> ?p ?o } ORDER BY DESC(?o)", True),
        ("SELECT ?p (MAX(?o) AS ?m) { <urn:a> ?p ?o } GROUP BY ?p HAVING (COUNT(?o) > 1)", True),
        ("SELECT * { <urn:a> ?p ?o } ORDER BY xsd:integer(?o)", True),
        ("SELECT * { <urn:a> ?p ?o } HAVING (EXISTS { ?x ?y ?z })", False),
        ("CONSTRUCT { <urn:a> ?p ?o } WHERE { <urn:a> ?p ?o }", False),
        # a sequence is so many patterns; other paths need a constant of their own
        ("SELECT * { <urn:a> <urn:p>/^<urn:q>/:r ?o }", True),
        ("SELECT * { <urn:a> <urn:p>/(<urn:q>/:r) ?o . ?o <urn:s>/:t ?u }", True),
        ("SELECT * { ?o <urn:p>/<urn:q> ?s }", False),
        ("SELECT * { ?s :p/a <urn:C> }", False),
        ("SELECT * { <urn:a> <urn:p>" + "/<urn:p>" * 8 + " ?o }", False),
        ("SELECT * { <urn:a> <urn:p>+ ?o }", True),
        ("SELECT * { ?s (<urn:p>|^<urn:q>)* <urn:a> }", True),
        ("SELECT * { ?s a/:sub* <urn:C> }", False),
        ("SELECT * { <urn:a> <urn:p> ?o . ?o <urn:p>+ ?q }", False),
        ("SELECT * { <urn:a> <urn:p> ?o . ?o <urn:p>|<urn:r> ?q }", False),
        ("SELECT * { <urn:a> (<urn:p> ?o }", False),
        ("SELECT * { <urn:a> !<urn:p> ?o }", False),
        # a filter and optional patterns read no more than the patterns that bind their variables
        ("SELECT * { <urn:a> ?p ?o FILTER(?o > 1) }", True),
        ("SELECT * { <urn:a> ?p ?o FILTER regex(?o, 'x{2}', 'i') . ?o <urn:q> ?r }", True),
        ("SELECT * { <urn:a> ?p ?o OPTIONAL { ?o <urn:q> ?r FILTER(?r != 2) } }", True),
        ("SELECT * { GRAPH ?g { <urn:a> ?p ?o } }", True),
        ("SELECT * { GRAPH <urn:g> { ?s ?p ?o } }", False),
        ("SELECT * { OPTIONAL { ?x <urn:q> ?y } <urn:a> <urn:p> ?x }", False),
        ("SELECT * { ?x <urn:q> ?y OPTIONAL { <urn:a> <urn:p> ?x } }", False),
        ("SELECT * { <urn:a> ?p ?o OPTIONAL { ?x <urn:q> ?y } }", False),
        ("SELECT * { <urn:a> ?p ?o FILTER EXISTS { ?x ?y ?z } }", False),
        ("SELECT * { <urn:a> ?p ?o FILTER(NOT EXISTS { ?x ?y ?z }) }", False),
        ("SELECT * { <urn:a> ?p ?o { SELECT * { ?x ?y ?z } } }", False),
        ("SELECT * { VALUES ?s { <urn:a> } ?s ?p ?o }", False),
        ("SELECT * { <urn:a> ?p ?o ; }", True),
        ("SELECT * { <urn:a> ?p }", False),
        ("SELECT * {}", False),
        ("SELECT * { { <urn:a> ?p ?o } UNION { ?a ?b ?c } }", False),
        ("SELECT * { " + "<urn:a> ?p ?o . " * 9 + "}", False),
        ("SELECT * {", False),
        ("CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o }", False),
    ],
)
def test_quick_queries_are_told_from_others(text: str, expected: bool) -> None:
    assert is_quick(text) is expected


def test_as_many_patterns_as_allowed_are_quick_and_one_more_is_not() -> None:
    pattern = "<urn:a> ?p ?o . "
    assert is_quick("ASK { " + pattern * MAX_PATTERNS + "}")
    assert not is_quick("ASK { " + pattern * (MAX_PATTERNS + 1) + "}")


def test_a_long_text_is_not_even_read() -> None:
    assert is_quick("ASK { <urn:a> ?p ?o }")
    assert not is_quick("ASK { <urn:a> ?p ?o }" + " " * 4_000)


@pytest.mark.parametrize(
    "text",
    [
        "SELECT * { <urn:a> ?p ?o }",
        "PREFIX e: <urn:e#> SELECT ?o WHERE { e:a e:p ?o } LIMIT 5",
        "select ?t { <urn:a> a ?t . }",
    ],
)
def test_every_lookup_is_quick(text: str) -> None:
    assert is_lookup(text)
    assert is_quick(text)


_WORDS = "SELECT * ?s ?p ?o <urn:a> a { } . ; , ( ) OPTIONAL GRAPH FILTER 'x' 1 ASK WHERE"


@given(st.lists(st.sampled_from(_WORDS.split(" ")), max_size=30).map(" ".join))
def test_every_text_gets_a_judgement(text: str) -> None:
    assert is_quick(text) in (True, False)
    assert not is_lookup(text) or is_quick(text)
