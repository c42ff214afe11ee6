"""Limits on one SPARQL text."""

from __future__ import annotations

import pytest

from endpoint.http.messages import RefusedError
from endpoint.http.problems import status_of
from endpoint.settings import Limits
from endpoint.sparql.limits import checked_form
from rtask.errors import RtaskError

LIMITS = Limits()


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("SELECT * { ?s ?p ?o }", "SELECT"),
        ("# ASK\nBASE <urn:x> PREFIX select: <urn:y> construct { ?s ?p ?o } {}", "CONSTRUCT"),
        ("describe <urn:x>", "DESCRIBE"),
        ("ASK { ?s ?p 'SELECT' }", "ASK"),
        ("INSERT DATA { <urn:s> <urn:p> 1 }", ""),
        ("PREFIX x: <urn:x>", ""),
        ("", ""),
    ],
)
def test_the_form_is_found_behind_the_prologue(text: str, form: str) -> None:
    assert checked_form(text, LIMITS) == form


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "SELECT * " + "{" * 10_000,
        "SELECT * { FILTER" + "(" * 100_000,
        "ASK { FILTER(" + "!" * 10_000 + "?x) }",
        "ASK { FILTER(" + "+".join(["1"] * 7_000) + " = 1) }",
        "ASK {" + " UNION ".join(["{ ?s ?p ?o }"] * 10_000) + "}",
        "ASK {" + " . ".join(f"?s <urn:p{i}> ?o{i}" for i in range(1_000)) + "}",
        "ASK { ?s " + "; ".join(f"<urn:p{i}> ?o{i}" for i in range(1_000)) + "}",
        "ASK {" + " ".join("OPTIONAL { ?s ?p ?o }" for _ in range(100)) + "}",
        "ASK { ?s " + "/".join(["<urn:p>"] * 1_000) + " ?o }",
        "ASK { " + "<<(" * 10_000,
    ],
    ids=[
        "braces",
        "parens",
        "not",
        "plus",
        "union",
        "star",
        "semicolons",
        "optional",
        "path",
        "<<(",
    ],
)
def test_text_that_would_hurt_the_store_is_refused_before_it_gets_there(text: str) -> None:
    with pytest.raises(RtaskError, match=r"allowed|at most|too") as caught:
        checked_form(text, LIMITS)
    assert status_of(caught.value) in (400, 413)


def test_data_are_not_counted_as_patterns() -> None:
    values = "SELECT ?v { VALUES ?v { " + " ".join(f'"{i}"' for i in range(5_000)) + " } }"
    assert checked_form(values, LIMITS) == "SELECT"
    data = "INSERT DATA { " + " . ".join(f"<urn:s{i}> <urn:p> 1, 2" for i in range(500)) + " }"
    assert checked_form(data, LIMITS, update=True) == ""
    in_list = "SELECT * { ?s ?p ?o FILTER(?o IN (" + ", ".join(["1"] * 500) + ")) }"
    assert checked_form(in_list, LIMITS) == "SELECT"


def test_patterns_after_a_block_of_data_count_again() -> None:
    text = "ASK { VALUES ?v { 1 } " + " . ".join(f"?s <urn:p{i}> ?v" for i in range(300)) + " }"
    with pytest.raises(RefusedError, match="patterns"):
        checked_form(text, LIMITS)


def test_a_text_beyond_the_length_is_refused() -> None:
    with pytest.raises(RtaskError) as caught:
        checked_form("#" * (LIMITS.query_bytes + 1), LIMITS)
    assert status_of(caught.value) == 413


def test_semicolons_between_operations_are_not_counted_as_patterns() -> None:
    update = " ; ".join(f"INSERT DATA {{ <urn:s{n}> <urn:p> {n} }}" for n in range(900))
    assert checked_form(update, Limits(), update=True) == ""
    with pytest.raises(RefusedError, match="operations"):
        checked_form(f"{update} ; {update}", Limits(), update=True)
    inside = "INSERT { ?s a <urn:T> } WHERE { ?s <urn:p> 1 " + "; <urn:p> 1 " * 200 + "}"
    with pytest.raises(RefusedError, match="patterns"):
        checked_form(inside, Limits(), update=True)
