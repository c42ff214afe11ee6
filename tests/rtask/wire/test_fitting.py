"""Outputs that may stand for inputs, and the messages for those that may not."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest

from rtask.wire.fields import Kind, kind_of
from rtask.wire.fitting import kind_at, misfit, places_in
from rtask.wire.message import Answer, Message
from rtask.wire.types import Array, Bytes, Cloud, Flag, GraspPose, Image, Points, Pose, Unit


class Part(Answer):
    """A part."""

    cloud: Cloud
    height: Annotated[float, Unit("m")]


class Found(Answer):
    """A finding."""

    part: Part
    parts: list[Part]
    picture: Image
    raw: Bytes
    pose: Pose
    row: Array
    rows: list[Array]
    mode: Literal["near", "far"]
    name: str
    names: list[str]
    count: int
    sure: bool
    free: dict[str, Any]


class Height(Message):
    """A height."""

    height: Annotated[float, Unit("m")]


class Wanted(Message):
    """Inputs of all kinds."""

    cloud: Cloud | None = None
    bytes_: Bytes
    length: Annotated[float, Unit("m")]
    angle: Annotated[float, Unit("rad")]
    pose: Pose
    row: Array
    rows: list[Array]
    points: Points
    mode: Literal["near", "far", "auto"]
    name: str
    names: list[str]
    count: int
    sure: Flag
    free: dict[str, Any]
    grasp: GraspPose
    height: Height
    heights: list[Height]


FITTING = {
    "part": {"free", "grasp"},
    "part.cloud": {"cloud", "bytes_"},
    "part.height": {"length"},
    "parts": set(),
    "picture": {"bytes_"},
    "raw": {"cloud", "bytes_"},
    "pose": {"pose"},
    "row": {"row"},
    "rows": {"rows"},
    "rows.0": {"row"},
    "mode": {"mode", "name", "grasp"},
    "name": {"name", "grasp"},
    "names": {"names"},
    "count": {"count", "length", "angle"},
    "sure": {"sure"},
    "free": {"free", "grasp", "height"},
}


@pytest.mark.parametrize("path", FITTING)
def test_an_output_fits_the_inputs_of_its_type_form_and_unit_and_no_others(path):
    source = kind_at(Kind(Found), path)
    assert source is not None
    fields = Wanted.model_fields.items()
    assert {name for name, field in fields if not misfit(source, kind_of(field))} == FITTING[path]


@pytest.mark.parametrize(
    ("path", "field", "words"),
    [
        ("part.height", "angle", "a number in m is not a number in rad"),
        ("picture", "cloud", "a picture is not a cloud"),
        ("parts", "cloud", "a list of: a Part is not a cloud"),
        ("name", "mode", "a text is not one of near, far, auto"),
        ("row", "points", "a list of numbers is not rows of 3 numbers in m"),
        ("names", "name", "a list of texts is not a text"),
    ],
)
def test_a_misfit_is_told_in_words(path, field, words):
    source = kind_at(Kind(Found), path)
    assert source is not None
    assert misfit(source, kind_of(Wanted.model_fields[field])) == words


def test_the_places_of_an_answer_are_its_fields_and_the_first_entries_of_its_lists():
    places = dict(places_in(Kind(Found), "step"))
    assert {"step", "step.part.cloud", "step.parts", "step.parts.0.cloud", "step.names.0"} <= {
        *places
    }
    assert all(kind_at(Kind(Found), path.partition(".")[2]) == kind for path, kind in
               places.items())  # fmt: skip


def test_what_no_declaration_says_is_unknown():
    assert kind_at(Kind(Found), "free.length") is None
    assert kind_at(Kind(Found), "parts.cloud") is None
    assert kind_at(Kind(Found), "pose.position.x") is None
