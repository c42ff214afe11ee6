"""Values of literals: identity, membership, order (OWL 2 Syntax 4, XSD 1.1 part 2)."""

from __future__ import annotations

import pytest

from reasoner.terms.datatypes import BITS, compare, is_within, value_of
from reasoner.terms.vocabulary import XSD


def value(text: str):
    lexical, _, datatype = text.partition("^^")
    return value_of(lexical, XSD + (datatype or "string"))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("1^^integer", "1.0^^decimal"),
        ("+01^^byte", "1^^nonNegativeInteger"),
        ("1^^boolean", "true^^boolean"),
        ("1e0^^double", "1.0^^double"),
        ("INF^^float", "1e39^^float"),
        ("NaN^^double", "NaN^^double"),
        ("a b", "a b^^token"),
        ("0aff^^hexBinary", "0AFF^^hexBinary"),
        ("YQ==^^base64Binary", "Y Q==^^base64Binary"),
        ("2026-01-01T24:00:00Z^^dateTime", "2026-01-02T00:00:00Z^^dateTime"),
        ("2026-01-01T00:00:00Z^^dateTime", "2026-01-01T00:00:00+00:00^^dateTimeStamp"),
    ],
)
def test_two_spellings_of_one_value(left, right):
    assert value(left).well_typed
    assert value(left).key == value(right).key


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("1^^integer", "1^^double"),
        ("1^^float", "1^^double"),
        ("0.0^^float", "-0.0^^float"),
        ("1^^integer", "1"),
        ("0aff^^hexBinary", "Cv8=^^base64Binary"),
        ("2026-01-01T00:00:00Z^^dateTime", "2026-01-01T01:00:00+01:00^^dateTime"),
        ("2026-01-01T00:00:00Z^^dateTime", "2026-01-01T00:00:00^^dateTime"),
    ],
)
def test_two_values(left, right):
    assert value(left).key != value(right).key


@pytest.mark.parametrize(
    "text",
    ["abc^^integer", "1.5^^integer", "300^^byte", "-1^^unsignedInt", "1e5^^decimal", "yes^^boolean",
     "2026-02-29T00:00:00Z^^dateTime", "2026-13-01T00:00:00Z^^dateTime", "abc^^hexBinary",
     "2026-01-01T00:00:00^^dateTimeStamp", "a  b^^token", "1a^^Name", "a:b^^NCName", "^^integer"],
)  # fmt: skip
def test_ill_typed(text):
    assert not value(text).well_typed


@pytest.mark.parametrize(
    ("text", "datatype", "inside"),
    [
        ("127^^integer", "byte", True),
        ("128^^integer", "byte", False),
        ("0^^byte", "nonPositiveInteger", True),
        ("1.0^^decimal", "positiveInteger", True),
        ("1.5^^decimal", "integer", False),
        ("1^^double", "decimal", False),
        ("en-GB", "language", True),
        ("a b", "NMTOKEN", False),
        ("2026-01-01T00:00:00Z^^dateTime", "dateTimeStamp", True),
    ],
)
def test_membership_is_by_value(text, datatype, inside):
    assert bool(value(text).mask & BITS[XSD + datatype]) is inside


@pytest.mark.parametrize(
    ("left", "right", "order"),
    [
        ("2^^integer", "10^^integer", -1),
        ("1.5^^decimal", "1.5e0^^double", 0),
        ("0.0^^double", "-0.0^^double", 0),
        ("NaN^^double", "1^^integer", None),
        ("b", "a", 1),
        ("a", "1^^integer", None),
        ("2026-01-01T00:00:00Z^^dateTime", "2026-01-01T01:00:00+01:00^^dateTime", 0),
        ("2026-01-01T00:00:00.25Z^^dateTime", "2026-01-01T00:00:00.5Z^^dateTime", -1),
        ("-0001-01-01T00:00:00Z^^dateTime", "0001-01-01T00:00:00Z^^dateTime", -1),
        ("2026-01-01T00:00:00Z^^dateTime", "2026-01-01T00:00:00^^dateTime", None),
        ("false^^boolean", "true^^boolean", -1),
    ],
)
def test_order_is_by_value(left, right, order):
    assert compare(value(left), value(right)) == order


def test_language_tags_ignore_case_and_are_part_of_the_value():
    english, also = (value_of("cup", XSD + "string", tag) for tag in ("en", "EN"))
    assert english.key == also.key != value("cup").key


def test_ranges_intersect():
    assert is_within([XSD + "nonNegativeInteger", XSD + "nonPositiveInteger"], XSD + "short")
    assert is_within([XSD + "byte"], XSD + "decimal")
    assert is_within([XSD + "NCName"], XSD + "token")
    assert not is_within([XSD + "decimal"], XSD + "integer")
    assert not is_within([], XSD + "integer")
    assert is_within([XSD + "negativeInteger", XSD + "unsignedInt"], XSD + "byte")
