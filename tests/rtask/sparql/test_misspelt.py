"""Errors in the text of a query name what was probably meant."""

from __future__ import annotations

import pytest

from rtask.errors import QuerySyntaxError
from rtask.sparql.syntax import check_query
from rtask.sparql.update_outline import read_update


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
        ("SELECT * {\n?s ?p ?o", "query 1:10: this '{' is never closed"),
        ("ASK { ?s ?p ?o FILTER(?o > 2 }", "query 1:22: this '(' is never closed"),
        ("ASK { ?s ?p ?o } }", "query 1:18: this '}' closes nothing"),
    ],
)
def test_a_word_that_is_no_keyword_is_named_with_the_one_meant(text: str, expected: str) -> None:
    with pytest.raises(QuerySyntaxError) as caught:
        check_query(text)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("INSER DATA { }", "update 1:1: 'INSER' is no keyword; did you mean INSERT?"),
        ("INSERT DAT { }", "update 1:8: 'DAT' is no keyword; did you mean DATA?"),
        ("CLEAR ALL ;\nDELET WHERE { }", "update 2:1: 'DELET' is no keyword; did you mean DELETE?"),
        ("DROP GRAF <urn:g>", "update 1:6: 'GRAF' is no keyword; did you mean GRAPH?"),
        ("SELECT * { ?s ?p ?o }", "update 1:1: SELECT begins a query; expected LOAD, CLEAR,"),
        ("hello", "update 1:1: expected LOAD, CLEAR,"),
        ("INSERT DATA", "update 1:12: expected '{', got the end"),
    ],
)
def test_a_word_that_no_update_has_is_named_with_the_one_meant(text: str, expected: str) -> None:
    with pytest.raises(QuerySyntaxError) as caught:
        read_update(text)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("body", "name"),
    [
        ("kb:object/7 ?p ?o", r"kb:object\/7"),
        ("GRAPH kb:graph/agent/nao-1 { ?s ?p ?o }", r"kb:graph\/agent\/nao-1"),
        ("?s ^kb:p/kb:q kb:view/7/a3.", r"kb:view\/7\/a3"),
    ],
)
def test_a_name_with_a_slash_is_shown_as_the_grammar_wants_it(body: str, name: str) -> None:
    prefix = "PREFIX kb: <urn:lab/>"
    with pytest.raises(QuerySyntaxError) as caught:
        check_query(f"{prefix} ASK {{ {body} }}")
    written = body[: body.index(name.partition("\\")[0])]
    assert f"1:{len(prefix) + 8 + len(written)}: a slash" in str(caught.value)
    assert str(caught.value).endswith(f"needs a backslash: {name}")
    shown = body.replace(name.replace("\\", ""), name)
    check_query(f"{prefix} ASK {{ {shown} }}")


def test_paths_and_divisions_are_read_as_such() -> None:
    check_query("PREFIX kb: <urn:lab/> ASK { ?s kb:p/a ?o ; kb:p/kb:q/^a ?x FILTER(?x/7 > 1) }")


@pytest.mark.parametrize("text", ["SELECT ?s { ?s ?p }", "ASK { ?s ?p ?o . . }"])
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
