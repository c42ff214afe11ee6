"""A wrong value is refused where it is set, with what was expected."""

from __future__ import annotations

import datetime as dt
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode

import ontology
from rtask.errors import UsageError
from rtask.model import RTASK, FieldError, LangString
from rtask.model.codec import decode, encode

XSD = ontology.PREFIXES["xsd"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RTASK.Mug(mass="heavy"), r"mass \(KiloGM\) of <Mug new> takes a number"),
        (lambda: RTASK.Mug(mass=True), "takes a number, not True"),
        (lambda: RTASK.Mug(mass=0.0), r"takes more than 0\.0"),
        (lambda: RTASK.Mug(object_id="mug"), "takes text that matches"),
        (lambda: RTASK.Mug(masss=0.3), "no field 'masss'; did you mean 'mass'"),
        (lambda: RTASK.PlanarPose(theta=7.0), r"theta \(RAD\).* takes less than 6\.28"),
        (lambda: RTASK.RecognitionResult(recognition_confidence=1.5), r"takes 1\.0 or less"),
        (lambda: RTASK.Match(rank=0), "takes a whole number of 1 or more"),
        (lambda: RTASK.Match(rank=1.5), "takes a whole number"),
        (lambda: RTASK.GraspOutcome(success="yes"), "takes True or False"),
        (lambda: RTASK.Pose(at_time=dt.datetime(2026, 1, 1)), "with its time zone"),
        (lambda: RTASK.PlanarGrasp(grasp_of=RTASK.Frame()), "takes a ManipulableObject"),
        (lambda: RTASK.PlanarGrasp(grasp_of="urn:mug"), "or its NamedNode"),
        (
            lambda: RTASK.GraspOutcome(has_reason=NamedNode(ontology.NS + "reason_slip_lfit")),
            "did you mean .*reason_slip_lift",
        ),
        (lambda: RTASK.Mug(object_id=["lab/a", "lab/b"]), "takes text"),
    ],
)
def test_wrong_values_are_refused(make: Any, message: str) -> None:
    with pytest.raises(FieldError, match=message):
        make()


@pytest.mark.parametrize(
    ("datatype", "value", "message"),
    [
        ("byte", 128, "a whole number from -128 to 127"),
        ("unsignedByte", -1, "a whole number from 0 to 255"),
        ("negativeInteger", 0, "a whole number of -1 or less"),
        ("nonNegativeInteger", -1, "a whole number of 0 or more"),
        ("double", 10**400, "a number within the range of a double"),
    ],
)
def test_a_number_out_of_range_is_refused_with_the_range(
    datatype: str, value: int, message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        encode(value, XSD + datatype)


def test_an_error_names_field_and_property() -> None:
    with pytest.raises(FieldError) as caught:
        RTASK.Mug(mass=-1.0)
    assert caught.value.details["field"] == "mass"
    assert caught.value.details["iri"] == ontology.NS + "mass"


def test_a_refused_value_changes_nothing() -> None:
    mug = RTASK.Mug(mass=0.3)
    with pytest.raises(FieldError):
        mug.mass = -1.0
    assert mug.mass == 0.3


def test_values_of_several_kinds() -> None:
    now = dt.datetime(2026, 1, 1, 10, tzinfo=dt.UTC)
    pose = RTASK.Pose(x=1, qw=1.0, at_time=now)
    assert (pose.x, pose.qw, pose.at_time, pose.y) == (1.0, 1.0, now, None)


def test_a_collection_takes_one_value_or_many() -> None:
    one, many = RTASK.Mug(name="mug"), RTASK.Mug(name=["mug", "cup"])
    assert (list(one.name), list(many.name)) == (["mug"], ["cup", "mug"])
    many.name.discard("cup")
    many.name.add("mug")
    assert list(many.name) == ["mug"]
    many.name.clear()
    assert len(many.name) == 0


def test_both_sides_of_an_inverse_agree() -> None:
    grasp, mug, pen = RTASK.PlanarGrasp(), RTASK.Mug(), RTASK.Pen()
    grasp.grasp_of.add(mug)
    assert grasp in mug.has_grasp
    pen.has_grasp.add(grasp)
    assert set(grasp.grasp_of) == {mug, pen}
    mug.has_grasp.discard(grasp)
    assert set(grasp.grasp_of) == {pen}


def test_a_single_side_moves_from_one_object_to_another() -> None:
    first, second = RTASK.PlanarGrasp(), RTASK.PlanarGrasp()
    attempt = RTASK.GraspAttempt(executes_grasp=first)
    assert list(first.tried_in) == [attempt]
    second.tried_in.add(attempt)
    assert attempt.executes_grasp is second
    assert list(first.tried_in) == []
    attempt.executes_grasp = first
    assert (list(first.tried_in), list(second.tried_in)) == ([attempt], [])
    attempt.executes_grasp = None
    assert list(first.tried_in) == []


def test_text_keeps_its_language() -> None:
    mug = RTASK.Mug(label=[LangString("Tasse", "de"), "mug"])
    assert sorted((text, getattr(text, "language", None)) for text in mug.label) == [
        ("Tasse", "de"),
        ("mug", None),
    ]


def test_a_new_object_has_no_iri_until_a_session_knows_it() -> None:
    with pytest.raises(UsageError, match="no IRI before"):
        _ = RTASK.Mug().iri
    mug = RTASK.Mug(iri="urn:mug")
    with pytest.raises(UsageError, match="keeps its IRI"):
        mug.iri = "urn:other"


def test_unknown_attributes_of_a_path_suggest_the_near_one() -> None:
    with pytest.raises(AttributeError, match="did you mean 'mass'"):
        _ = RTASK.GraspConfiguration.grasp_of.mas
    with pytest.raises(AttributeError, match="plain values"):
        _ = RTASK.Mug.mass.unit


@given(st.floats(allow_nan=False))
def test_numbers_survive(value: float) -> None:
    made = encode(value, XSD + "double")
    assert decode(made) == value
    assert math.copysign(1, float(made.value)) == 1 or value != 0  # never -0.0


@given(st.text(alphabet=st.characters(exclude_categories=["Cs"])))
def test_text_survives(text: str) -> None:
    assert decode(encode(text, XSD + "string")) == text


@given(st.datetimes(timezones=st.just(dt.UTC)))
def test_times_survive(value: dt.datetime) -> None:
    assert decode(encode(value, XSD + "dateTimeStamp")) == value


def test_an_ill_typed_literal_is_left_alone() -> None:
    odd = Literal("many", datatype=NamedNode(XSD + "integer"))
    assert decode(odd) is odd
