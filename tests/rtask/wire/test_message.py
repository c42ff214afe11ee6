"""Requests: numbers as text, hints for wrong names, errors that name the field."""

from __future__ import annotations

import json
import math
from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Ge, Le, MaxLen
from pydantic import Field, ValidationError

from grasp.messages import pose_message
from rtask.errors import UsageError
from rtask.wire.fields import Also
from rtask.wire.message import Answer, Message, named, read, strict_json
from rtask.wire.types import (
    Bytes,
    Flag,
    Grasp,
    Json,
    Number,
    Points,
    Pose,
    Stamp,
    Text,
    Texts,
    Whole,
)


class Part(Message):
    """A part."""

    x: Number
    """abscissa, m"""
    kind: Literal["left", "right"] | None = None
    """side"""


class Thing(Message):
    """A thing."""

    name: Text | None = None
    """what it is called"""
    count: Annotated[Whole, Ge(1), Le(9)] = 3
    """how many"""
    size: Number | None = None
    """how large, m"""
    open: Flag | None = None
    """whether it is open"""
    kind: Literal["Hand", "Jaw"] | None = None
    """which kind"""
    place: Pose | None = None
    """where"""
    points: Points | None = None
    """of others, m"""
    when: Stamp | None = None
    """at"""
    parts: Annotated[list[Part], MaxLen(2)] = Field(default_factory=list)
    """of it"""
    main: Part | None = None
    """the part that counts"""
    data: Annotated[Bytes, Also("cloud")] | None = None
    """payload"""
    words: Annotated[Texts, MaxLen(2)] = Field(default_factory=list)
    """said of it"""
    grasp: Grasp | None = None
    """how it is held"""


def test_numbers_may_come_as_text_and_leave_as_numbers():
    thing = read(Thing, {"count": "4", "size": " 0.5 ", "open": "true"})
    assert (thing.count, thing.size, thing.open) == (4, 0.5, True)
    assert read(Thing, {"count": "1e0"}).count == 1
    assert read(Thing, {"count": 2.0}).count == 2
    assert read(Part, {"x": np.float32(0.5)}).x == 0.5
    assert read(Thing, {"open": 0}).open is False


def test_a_long_whole_number_keeps_its_digits():
    class Draw(Message):
        """A draw."""

        seed: Whole = 0

    assert read(Draw, {"seed": "12345678901234567"}).seed == 12345678901234567
    assert read(Draw, {"seed": 2**70}).seed == 2**70


def test_what_is_left_out_null_or_blank_takes_the_default():
    for given in ({}, {"count": None, "name": None}, {"count": "", "name": " "}):
        thing = read(Thing, given)
        assert thing.count == 3
        assert thing.name is None


def test_an_unknown_field_is_refused_with_the_nearest_name():
    with pytest.raises(UsageError, match="unknown field 'cuont'; did you mean 'count'"):
        read(Thing, {"cuont": 1})
    with pytest.raises(UsageError, match=r"unknown field 'parts\[1\]\.y'; known: kind, x"):
        read(Thing, {"parts": [{"x": 1}, {"x": 2, "y": 3}]})
    # The missing field is missing because its name is misspelt.
    with pytest.raises(UsageError, match=r"unknown field 'main\.xx'; did you mean 'x'"):
        read(Thing, {"main": {"xx": 1}})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"size": "a third"}, "size: expected a finite number, got 'a third'"),
        ({"size": math.inf}, "size: expected a finite number"),
        ({"size": True}, "size: expected a finite number"),
        ({"size": 10**400}, "size: expected a finite number"),
        ({"count": True}, "count: expected a finite number"),
        ({"count": 2.5}, "count: expected a whole number, got 2.5"),
        ({"count": 0}, "count: 0 is below 1"),
        ({"count": "10"}, "count: 10 is above 9"),
        ({"open": "perhaps"}, "open: expected true or false, got 'perhaps'"),
        ({"open": "yes"}, "open: expected true or false"),
        ({"name": 7}, "name: expected a text, got 7"),
        ({"kind": "Hnad"}, "kind: unknown value 'Hnad'; did you mean 'Hand'"),
        ({"kind": "Foot"}, "kind: unknown value 'Foot'; one of Hand, Jaw"),
        ({"kind": 5}, "kind: expected a text, got 5"),
        ({"parts": {"x": 1}}, "parts: expected a list"),
        ({"parts": [{}]}, r"parts\[0\]\.x is missing: abscissa, m"),
        ({"parts": [{"x": None}]}, r"parts\[0\]\.x is missing"),
        ({"parts": [{"x": 1, "kind": "lft"}]}, r"parts\[0\]\.kind: .* did you mean 'left'"),
        ({"parts": [{"x": 1}] * 3}, "parts: length 3 is above 2"),
        ({"parts": [5]}, r"parts\[0\]: expected an object with fields"),
        ({"main": 5}, "main: expected an object with fields"),
        ({"words": ["a", 1]}, "words: expected a list of texts"),
        ({"words": ["a", "b", "c"]}, "words: length 3 is above 2"),
        ({"grasp": 5}, "grasp: expected the id of a grasp, or a grasp as received, got 5"),
        ({"place": {"position": {"x": 0}}}, "place: a pose has position"),
        ({"points": [[0, 0], [1, 1]]}, r"points: expected a list of \[x, y, z\] in m"),
        ({"points": "abc"}, r"points: expected a list of \[x, y, z\] in m"),
        ({"points": [[0, 0, None]]}, "points: points must be finite"),
        ({"points": [[0, 0, 0]] * 501}, "points: 501 points; at most 500"),
        ({"data": "%%%"}, "data: not base64"),
        ({"data": 5}, "data: expected base64 text"),
        ({"when": {"sec": "soon"}}, "when: expected a finite number"),
        (5, "the request: expected an object with fields"),
    ],
)
def test_a_wrong_value_is_named_with_what_was_expected(given, words):
    with pytest.raises(UsageError, match=words) as caught:
        read(Thing, given)
    if isinstance(given, dict):
        assert caught.value.details["field"] == words.split(" is ")[0].split(":")[0].replace(
            "\\", ""
        )


def test_a_text_that_must_be_there_must_not_be_blank():
    class Named(Message):
        """Something with a name."""

        name: Text

    for blank in ("", "  "):
        with pytest.raises(UsageError, match="name: expected a text"):
            read(Named, {"name": blank})


def test_a_large_value_is_cut_short_in_the_error():
    with pytest.raises(UsageError) as caught:
        read(Thing, {"size": "x" * 1_000_000})
    assert len(str(caught.value)) < 120


def test_the_path_of_a_larger_message_stands_before_the_field():
    with pytest.raises(UsageError, match=r"grasp\.x is missing"):
        read(Part, {}, "grasp.")


def test_stamps_of_ros_1_and_ros_2_mean_the_same():
    one = read(Thing, {"when": {"secs": 5, "nsecs": 500_000_000}}).when
    two = read(Thing, {"when": {"sec": 5, "nanosec": 500_000_000}}).when
    assert one == two == read(Thing, {"when": "5.5"}).when == 5.5


@pytest.mark.parametrize("stamp", [{"secs": 0, "nsecs": 0}, {"sec": 0, "nanosec": 0}, None])
def test_a_stamp_of_ros_that_nobody_set_is_none(stamp):
    assert read(Thing, {"when": stamp}).when is None


@pytest.mark.parametrize(
    "stamp",
    [-5, {"sec": -5, "nanosec": 0}, 1.79e12, 1.79e18, "1.79e18", {"sec": 1.79e12}, {}, {"t": 5}],
)
def test_a_stamp_that_is_no_date_is_refused(stamp):
    with pytest.raises(UsageError, match=r"when: expected s since 1970"):
        read(Thing, {"when": stamp})


def test_poses_points_and_bytes_become_arrays_and_bytes():
    thing = read(
        Thing,
        {"place": pose_message(np.eye(4)), "points": [["0.1", 0, 1]], "cloud": "UlRL Qw"},
    )
    assert np.array_equal(thing.place, np.eye(4))
    assert thing.points.tolist() == [[0.1, 0.0, 1.0]]
    assert thing.data == b"RTKC"
    assert read(Thing, {"place": thing.place}).place is thing.place
    assert read(Thing, {"points": []}).points.shape == (0, 3)


@pytest.mark.parametrize("text", ["+/+/", "-_-_", "+/ +/\n", "+/8=", "+/8", "+_8"])
def test_base64_may_come_in_either_alphabet_with_or_without_padding(text):
    assert read(Thing, {"data": text}).data[:2] == b"\xfb\xff"


def test_one_entry_may_stand_for_a_list_of_one():
    class Parts(Message):
        """Several parts."""

        entries = "parts"
        parts: list[Part]

    assert [part.x for part in read(Parts, {"x": 2}).parts] == [2.0]
    assert [part.x for part in read(Parts, {"parts": [{"x": 1}, {"x": 2}]}).parts] == [1.0, 2.0]
    with pytest.raises(UsageError, match="parts is missing"):
        read(Parts, {})


def test_a_request_is_made_in_process_of_typed_values():
    thing = Thing(parts=[Part(x=1.0)], place=np.eye(4), data=b"RTKC")
    assert thing.parts[0].x == 1.0
    with pytest.raises(ValueError, match="frozen"):
        thing.count = 4


class Found(Answer):
    """An object that was found."""

    class_: str = named("class")
    size: float | None
    again: list[Found]
    commit: str = ""


def test_an_answer_reads_like_a_mapping_and_leaves_out_what_was_not_set():
    inner = Found(class_="cup", size=0.1, again=[])
    found = Found(class_="mug", size=None, again=[inner], commit="c-1")
    assert found["class"] == found.class_ == "mug"
    assert found["again"][0]["class"] == "cup"
    assert dict(inner) == {"class": "cup", "size": 0.1, "again": []}
    assert "commit" in found
    assert "commit" not in inner
    assert inner.get("commit") is None
    with pytest.raises(KeyError):
        inner["class_"]
    assert found.as_json() == {
        "class": "mug", "size": None, "commit": "c-1",
        "again": [{"class": "cup", "size": 0.1, "again": []}],
    }  # fmt: skip


class Measured(Answer):
    """An answer with a number and free JSON."""

    length: float
    label: str
    more: Json


def test_an_answer_that_does_not_fit_cannot_be_made():
    for given in ({"length": "long"}, {"length": math.nan}, {"length": 1.0, "extra": 1}):
        with pytest.raises(ValidationError):
            Measured(**{"label": "a", "more": {}, **given})
    with pytest.raises(ValidationError):
        Measured(length=1.0, label="a")


def test_an_answer_is_written_as_json_and_never_with_a_number_that_is_none():
    answer = Measured(length=1, label="NaN, Infinity \u00fc", more={"a": [1e300, None, True]})
    assert json.loads(answer.to_json()) == answer.as_json() == answer
    assert answer.to_json() == strict_json(answer.as_json())
    for bad in (math.nan, -math.inf):
        with pytest.raises(ValueError, match="JSON"):
            Measured(length=1, label="a", more={"deep": [bad]}).to_json()


def test_half_of_a_surrogate_pair_is_escaped():
    answer = Measured(length=1, label="a", more={"said": "\ud800"})
    assert json.loads(answer.to_json())["more"] == {"said": "\ud800"}
