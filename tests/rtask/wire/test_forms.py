"""Forms made of declarations: a control for each field, and the request that they mean."""

from __future__ import annotations

import json
from typing import Annotated, Literal

import pytest
from annotated_types import Ge, Le
from pydantic import Field

from rtask.engine.operations.table import OPERATIONS
from rtask.errors import UsageError
from rtask.wire.forms import controls_of, filled_form, read_form
from rtask.wire.message import Message, read
from rtask.wire.types import Bytes, Flag, Number, Points, Text, Texts, Unit, Whole

POSE = {"position": dict.fromkeys("xyz", 0.0), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}


class Finger(Message):
    """A finger."""

    length: Annotated[Number, Unit("m"), Ge(0)]
    """from the palm"""
    name: Text | None = None
    """what it is called; default: none"""


class Hand(Message):
    """A hand."""

    side: Literal["left", "right"]
    """which one"""
    count: Annotated[Whole, Ge(1), Le(9)] = 3
    """how many"""
    open: Flag = True
    """whether it is open"""
    words: Texts = Field(default_factory=list)
    """said of it"""
    at: Points | None = None
    """where; default: nowhere"""
    data: Bytes | None = None
    """picture; default: none"""
    thumb: Finger | None = None
    """the opposing one; default: none"""
    fingers: list[Finger] = Field(default_factory=list)
    """the others"""


def named(controls, name):
    """Return a control by its path."""
    for one in controls:
        if one.name == name:
            return one
        found = named(one.parts, name)
        if found:
            return found
    return None


def leaves(controls):
    """Return the controls that are no groups."""
    return [leaf for one in controls for leaf in (leaves(one.parts) if one.parts else [one])]


def test_a_control_has_unit_bounds_choices_and_the_meaning_of_absence():
    controls = controls_of(Hand)
    length = named(controls, "thumb.length")
    assert (length.sort, length.unit, length.minimum, length.meaning) == (
        "number", "m", 0.0, "from the palm",
    )  # fmt: skip
    count = named(controls, "count")
    assert (count.minimum, count.maximum, count.step, count.absent) == (1.0, 9.0, "1", "3")
    side = named(controls, "side")
    assert side.choices == ("left", "right")
    assert side.is_required
    assert named(controls, "thumb").absent == "none"
    assert named(controls, "thumb").meaning == "the opposing one"


def test_a_list_of_messages_has_one_group_or_as_many_as_were_filled_in_and_one_more_on_request():
    def groups(**options):
        return [one.name for one in controls_of(Hand, **options) if one.name.startswith("fingers")]

    assert groups() == ["fingers.0"]
    assert groups(given=["fingers.0.name", "fingers.1.name"]) == ["fingers.0", "fingers.1"]
    assert groups(given=["fingers.0.name"], more="fingers") == ["fingers.0", "fingers.1"]


def test_a_filled_form_means_a_request_without_what_is_blank():
    given = {
        "side": ["left"], "count": [" "], "open": ["false"], "words": ["a\n b \n", "c"],
        "at": ["[[0, 0, 1]]"], "thumb.length": [""], "fingers.0.length": ["0.07"],
        "fingers.2.length": ["0.08"], "fingers.2.name": ["ring"], "secret": ["x"],
    }  # fmt: skip
    request = read_form(Hand, given, {"data": b"abc"})
    assert request == {
        "side": "left",
        "open": False,
        "words": ["a", "b", "c"],
        "at": [[0, 0, 1]],
        "data": b"abc",
        "fingers": [{"length": 0.07}, {"length": 0.08, "name": "ring"}],
    }
    filled = {name: [text] for name, text in filled_form(Hand, request).items()}
    assert read_form(Hand, filled, {"data": b"abc"}) == request
    hand = read(Hand, request)
    assert (hand.open, hand.count, hand.thumb, hand.fingers[1].length) == (False, 3, None, 0.08)


def test_broken_json_is_refused_by_the_name_of_its_control():
    with pytest.raises(UsageError, match="at: not JSON"):
        read_form(Hand, {"at": ["[[0"]})


def filled(control):
    """Return a legal value of a control as a person would type it."""
    if control.choices:
        return control.choices[0]
    if control.sort == "number":
        return str(control.minimum if control.minimum is not None else 0)
    if control.sort == "json":
        if control.name.endswith(("box", "region")):
            return json.dumps([0, 0, 9, 9])
        if control.name.endswith(("times", "positions", "commands")):
            return json.dumps([0, 1])
        return json.dumps([[0, 0, 0]] if control.name.endswith("neighbours") else POSE)
    return "a"


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_every_operation_can_be_asked_for_by_its_form(name):
    model = OPERATIONS[name].request
    controls = leaves(controls_of(model))
    texts = {one.name: [filled(one)] for one in controls if one.sort != "file"}
    # A question has two choices at least, and a form begins with one.
    texts |= {
        name.replace("choices.0.", "choices.1."): value
        for name, value in texts.items()
        if name.startswith("choices.0.")
    }
    files = {one.name: b"abc" for one in controls if one.sort == "file"}
    request = read(model, read_form(model, texts, files))
    assert request.model_fields_set == set(model.model_fields)


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_a_blank_form_means_nothing(name):
    model = OPERATIONS[name].request
    blank = {one.name: [""] for one in leaves(controls_of(model))}
    assert read_form(model, blank) == {}
