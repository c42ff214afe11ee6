"""Errors in the text of a query name what was probably meant."""

from __future__ import annotations

import pytest

from rtask.errors import QuerySyntaxError
from rtask.sparql.syntax import check_query


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("SELEC * { ?s ?p ?o }", "query 1:1: 'SELEC' is no keyword; did you mean SELECT?"),
        ("PREFIX x: <urn:x>\nSLECT ?s { ?s ?p ?o }", "query 2:1: 'SLECT' is no keyword; did you"),
        ("ASKK {}", "query 1:1: 'ASKK' is no keyword; did you mean ASK?"),
        ("ASK { ?s ?p ?o FILTR(?o) }", "query 1:16: 'FILTR' is no keyword; did you mean FILTER?"),
        ("INSERT DATA { }", "query 1:1: INSERT begins an update; a query begins with SELECT,"),
        ("hello", "query 1:1: a query begins with SELECT, CONSTRUCT, DESCRIBE or ASK, got 'hello'"),
        ("", "got the end"),
    ],
)
def test_a_word_that_is_no_keyword_is_named_with_the_one_meant(text: str, expected: str) -> None:
    with pytest.raises(QuerySyntaxError) as caught:
        check_query(text)
    assert expected in str(caught.value)


@pytest.mark.parametrize("text", ["ASK { ?s ?p ?o", "SELECT ?s { ?s ?p }", "ASK { ?s ?p ?o . . }"])
def test_what_was_expected_is_told_without_classes_of_characters(text: str) -> None:
    with pytest.raises(QuerySyntaxError) as caught:
        check_query(text)
    assert "expected" in str(caught.value)
    assert "u{" not in str(caught.value)


def test_each_function_and_keyword_of_the_language_is_left_alone() -> None:
    check_query(
        "SELECT (GROUP_CONCAT(DISTINCT STR(?s) ; SEPARATOR = ', ') AS ?all) (COUNT(*) AS ?n) {"
        " VALUES ?p { UNDEF } OPTIONAL { ?s ?p ?o } MINUS { ?s a ?o } BIND(IF(true, 1, 2) AS ?b)"
        " FILTER(NOT EXISTS { ?s ?p 1 } && sameTerm(?s, ?o) && REGEX(STR(?o), 'x')) }"
        " GROUP BY ?s HAVING (COUNT(*) > 0) ORDER BY DESC(?s) LIMIT 1 OFFSET 2"
    )
