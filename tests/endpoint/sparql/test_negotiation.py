"""Negotiation of formats (RFC 9110, 12.5.1)."""

from __future__ import annotations

import pytest

from endpoint.http.messages import RefusedError
from endpoint.sparql import negotiation
from endpoint.sparql.negotiation import (
    CSV,
    GRAPH_TYPES,
    JSON_LD,
    RDF_XML,
    RESULTS_JSON,
    RESULTS_XML,
    SOLUTION_TYPES,
    TSV,
    TURTLE,
)


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        ("", RESULTS_JSON),
        ("*/*", RESULTS_JSON),
        (";;;", RESULTS_JSON),
        (f"{RESULTS_XML};q=0.1, {RESULTS_JSON};q=0.9", RESULTS_JSON),
        (f"{RESULTS_XML};q=0.9, {RESULTS_JSON};q=0.1", RESULTS_XML),
        (f"{CSV};q=0.2,{TSV}", TSV),
        (f"{RESULTS_JSON};q=0, */*;q=0.5, {RESULTS_XML};q=0.9", RESULTS_XML),
        (f"{RESULTS_JSON};q=0, */*", RESULTS_XML),
        (f"*/*, {RESULTS_XML}", RESULTS_XML),
        ("application/json", RESULTS_JSON),
        ("text/xml", RESULTS_XML),
        ("text/*", CSV),
        ("TEXT/CSV;header=absent", CSV),
        ("image/png, text/html, text/csv;q=0.1", CSV),
        ("application/sparql-results+json,application/json,text/javascript", RESULTS_JSON),
    ],
)
def test_the_best_acceptable_format_is_chosen(accept: str, chosen: str) -> None:
    assert negotiation.choose(accept, SOLUTION_TYPES) == chosen


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [("", TURTLE), ("application/json", JSON_LD), ("application/xml", RDF_XML)],
)
def test_graphs_have_formats_of_their_own(accept: str, chosen: str) -> None:
    assert negotiation.choose(accept, GRAPH_TYPES) == chosen


def test_nothing_acceptable_lists_what_there_is() -> None:
    with pytest.raises(RefusedError, match="available: application/sparql-results") as caught:
        negotiation.choose("image/png", SOLUTION_TYPES)
    assert caught.value.http_status == 406
    assert caught.value.details["available"] == list(SOLUTION_TYPES)


def test_a_huge_accept_header_is_refused() -> None:
    with pytest.raises(RefusedError) as caught:
        negotiation.choose("text/csv," * 2_000, SOLUTION_TYPES)
    assert caught.value.http_status == 431


@pytest.mark.parametrize(
    ("accept", "is_browser"),
    [
        ("text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8", True),
        ("text/html", True),
        ("*/*", False),
        ("application/json, text/html;q=0.5", False),
        ("text/html;q=0", False),
        ("", False),
    ],
)
def test_html_is_for_those_who_name_it_first(accept: str, is_browser: bool) -> None:
    assert negotiation.prefers_html(accept) is is_browser
