"""Requests: numbers as text, hints for wrong names, errors that name the field."""

from __future__ import annotations

import math

import numpy as np
import pytest

from grasp.messages import pose_message
from rtask.engine.operations.messages import Field, read
from rtask.engine.operations.table import OPERATIONS
from rtask.engine.records.received import Outcome, received
from rtask.errors import UsageError

FIELDS = (
    Field("name", "string", "what it is called"),
    Field("count", "integer", "how many", default=3, low=1, high=9),
    Field("size", "number", "how large, m"),
    Field("open", "boolean", "whether it is open"),
    Field("kind", "string", "which kind", choices=("Hand", "Jaw")),
    Field("place", "pose", "where"),
    Field("points", "points", "of others, m"),
    Field("when", "time", "at"),
    Field("parts", "records", "of it", fields=(Field("x", "number", "m", required=True),)),
    Field("data", "bytes", "payload", aliases=("cloud",)),
)


def test_numbers_may_come_as_text_and_leave_as_numbers():
    request = read(FIELDS, {"count": "4", "size": " 0.5 ", "open": "true"})
    assert (request["count"], request["size"], request["open"]) == (4, 0.5, True)


def test_what_is_left_out_null_or_empty_text_takes_the_default():
    for given in ({}, {"count": None, "name": None}, {"count": "", "name": ""}):
        request = read(FIELDS, given)
        assert request["count"] == 3
        assert request["name"] is None


def test_an_unknown_field_is_refused_with_the_nearest_name():
    with pytest.raises(UsageError, match="unknown field 'cuont'; did you mean 'count'"):
        read(FIELDS, {"cuont": 1})
    with pytest.raises(UsageError, match=r"unknown field 'parts\[1\]\.y'"):
        read(FIELDS, {"parts": [{"x": 1}, {"x": 2, "y": 3}]})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"size": "a third"}, "size: a finite number is wanted, got 'a third'"),
        ({"size": math.inf}, "size: a finite number"),
        ({"size": True}, "size: a finite number"),
        ({"count": 2.5}, "count: a whole number is wanted, got 2.5"),
        ({"count": 0}, "count: 0 is below 1"),
        ({"count": 10}, "count: 10 is above 9"),
        ({"open": "perhaps"}, "open: true or false is wanted"),
        ({"name": 7}, "name: a text is wanted, got 7"),
        ({"kind": "Hnad"}, "unknown value 'Hnad'; did you mean 'Hand'"),
        ({"parts": {"x": 1}}, "parts: a list is wanted"),
        ({"parts": [{}]}, r"parts\[0\]\.x is missing: m"),
        ({"place": {"position": {"x": 0}}}, "place: a pose has position"),
        ({"points": [[0, 0], [1, 1]]}, r"points: a list of \[x, y, z\] in m is wanted"),
        ({"points": [[0, 0, None]]}, "points"),
        ({"points": [[0, 0, 0]] * 501}, "points: 501 points; at most 500"),
        ({"data": "%%%"}, "data: "),
    ],
)
def test_a_wrong_value_is_named_with_what_is_wanted(given, words):
    with pytest.raises(UsageError, match=words):
        read(FIELDS, given)


def test_stamps_of_ros_1_and_ros_2_mean_the_same():
    one = read(FIELDS, {"when": {"secs": 5, "nsecs": 500_000_000}})["when"]
    two = read(FIELDS, {"when": {"sec": 5, "nanosec": 500_000_000}})["when"]
    assert one == two == 5.5


def test_poses_points_and_bytes_become_arrays_and_bytes():
    request = read(
        FIELDS,
        {"place": pose_message(np.eye(4)), "points": [["0.1", 0, 1]], "cloud": "UlRL Qw"},
    )
    assert np.allclose(request["place"], np.eye(4))
    assert request["points"].tolist() == [[0.1, 0.0, 1.0]]
    assert request["data"] == b"RTKC"


def test_every_field_of_every_operation_says_what_it_means():
    def walk(fields):
        for field in fields:
            assert len(field.summary) > 2, field
            yield from walk(field.fields)

    for operation in OPERATIONS.values():
        assert operation.summary
        list(walk(operation.fields))


def test_a_grasp_may_come_back_with_whatever_the_robot_added():
    grasp = received(
        {"id": "candidate:3", "x": "0.1", "y": 0, "z": 0.3, "theta": 1.0, "rank": 2, "alpha": 5.0,
         "beta": 1.0, "in_object": {"x": 0, "y": 0, "z": 0.03, "theta": 0.7}},
        "grasp",
    )  # fmt: skip
    assert grasp.iri is None
    assert grasp.in_frame == (0.1, 0.0, 0.3, 1.0)
    assert grasp.in_object == (0.0, 0.0, 0.03, 0.7)
    assert grasp.belief == (5.0, 1.0)


@pytest.mark.parametrize(
    ("grasp", "words"),
    [
        ({}, "neither an id nor a pose"),
        ({"x": "here", "y": 0, "z": 0, "theta": 0}, r"grasp\.x: a finite number"),
        ({"grasp_pose": {}}, "grasp: not a grasp message"),
        ({"in_object": {"x": 1}}, r"grasp\.in_object\.y is missing"),
    ],
)
def test_a_grasp_without_a_pose_is_refused(grasp, words):
    with pytest.raises(UsageError, match=words):
        received(grasp, "grasp")


def test_outcomes_follow_the_codes_of_the_ontology():
    known = frozenset({"ok", "missed"})

    def outcome(**fields):
        return Outcome.of({"reason": None, "placed": None, **fields}, known, "outcome")

    assert outcome(success=True).reason == "ok"
    assert outcome(success=False, reason="missed").reason == "missed"
    assert outcome(success=False).reason == "not_judged"
    assert outcome(success=False, reason="odd").comments == ("odd",)
