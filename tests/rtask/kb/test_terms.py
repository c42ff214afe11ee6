"""Terms: Python values in and out."""

from __future__ import annotations

import datetime as dt
import math
from decimal import Decimal

import pytest

from rtask.errors import DataError, UsageError
from rtask.rdf.terms import (
    BlankNode,
    Triple,
    iri,
    is_ground,
    literal,
    moment,
    object_term,
    python_value,
    stored,
    subject_term,
)


@pytest.mark.parametrize("value", [True, 3, -2, 0.25, 1e300, "text", "", "ü\n"])
def test_values_come_back(value: object) -> None:
    found = python_value(stored(literal(value)))
    assert found == value
    assert type(found) is type(value)


def test_other_values_become_typed_literals() -> None:
    time = dt.datetime(2026, 1, 2, 3, 4, 5, 600, tzinfo=dt.UTC)
    assert literal(time).value == "2026-01-02T03:04:05.000600Z"
    assert literal(dt.date(2026, 1, 2)).value == "2026-01-02"
    assert literal(Decimal("1E-3")).value == "0.001"
    with pytest.raises(UsageError, match="a list cannot be converted"):
        literal([1])


def test_text_is_an_iri_where_only_an_iri_can_stand() -> None:
    assert subject_term("urn:a") == iri("urn:a")
    assert object_term("urn:a") == literal("urn:a")
    with pytest.raises(DataError, match="not an absolute IRI: 'a b'"):
        iri("a b")
    with pytest.raises(UsageError, match="expected an IRI, got int"):
        iri(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "value", ["tomorrow", "0001-01-01T00:00:00+05:00", 1e20, math.nan, math.inf]
)
def test_a_moment_that_is_no_time_or_out_of_range_is_refused(value: str | float) -> None:
    with pytest.raises(UsageError, match="is not a time"):
        moment(value)


def test_blank_nodes_are_found_inside_triple_terms() -> None:
    deep = Triple(iri("urn:a"), iri("urn:p"), Triple(BlankNode(), iri("urn:p"), literal(1)))
    assert not is_ground(deep)
    assert is_ground(Triple(iri("urn:a"), iri("urn:p"), literal(1)))
    assert stored(Triple(iri("urn:a"), iri("urn:p"), literal("01"))) == Triple(
        iri("urn:a"), iri("urn:p"), literal("01")
    )


def test_a_text_that_is_no_unicode_is_refused_by_name():
    with pytest.raises(DataError, match=r"cannot be stored as a literal: 'a\\ud800'"):
        literal("a\ud800")
