"""Leaving a field out: every declaration says what that means, and typed messages can do it.

A typed ROS message carries every field. One whose optional fields were never set holds zeros, and
must read like a request without these fields.
"""

from __future__ import annotations

import base64
import typing

import pytest
from annotated_types import Ge, MinLen

from endpoint.rosbridge.typedefs import typedefs_of
from rtask.engine.operations.table import OPERATIONS
from rtask.engine.records.outcomes import OutcomeReport
from rtask.errors import UsageError
from rtask.wire.fields import absence, kind_of, parts_of, wire_name
from rtask.wire.message import read
from rtask.wire.openapi import components
from rtask.wire.ros import LIST, ros_types
from rtask.wire.types import Carried

REQUESTS = {
    one.__name__: one
    for operation in OPERATIONS.values()
    for one in (*parts_of(operation.request).values(), operation.request)
}
OPTIONAL = [
    (name, field)
    for name, model in REQUESTS.items()
    for field, info in model.model_fields.items()
    if not info.is_required()
]
PUBLISHED = components(REQUESTS)
ZEROS = {"string": "", "float64": 0.0, "int64": 0, "bool": False}
POSE = {"position": dict.fromkeys("xyz", 0.0), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
# The list itself is the answer to "what do you see?": a typed message cannot leave it out.
ALWAYS_TOLD = ("ResolveRequest", "objects")


def sample(field):
    """Return a legal value of a field that must be given."""
    kind = kind_of(field)
    carried = next((one for one in kind.metadata if isinstance(one, Carried)), None)
    if kind.message is not None:
        value = needed(kind.message)
    elif typing.get_origin(kind.type) is typing.Literal:
        value = typing.get_args(kind.type)[0]
    elif kind.type is bytes:
        value = base64.b64encode(b"abc").decode()
    elif carried is not None and carried.ros == "geometry_msgs/Pose":
        value = POSE
    elif carried is not None and carried.ros == "geometry_msgs/PoseStamped":
        value = {"pose": POSE}
    elif carried is not None and carried.ros == "float64":
        value = 0.05
    else:
        least = max((one.ge for one in kind.metadata if isinstance(one, Ge)), default=0.0)
        value = {str: "a", float: max(least, 0.05), int: max(1, int(least)), bool: True}[kind.type]
    fewest = max((one.min_length for one in kind.metadata if isinstance(one, MinLen)), default=1)
    return [value] * max(fewest, 1) if kind.is_list else value


def needed(model):
    """Return a message of the fields that must be given."""
    return {
        wire_name(name, field): sample(field)
        for name, field in model.model_fields.items()
        if field.is_required()
    }


def zero(model, field):
    """Return what a typed ROS message holds in a field that was not set."""
    members = {one.name: one for one in ros_types("rtask/Any", model)["rtask/Any"]}
    member = members[field]
    return [] if member.length == LIST else ZEROS[member.type]


@pytest.mark.parametrize(("name", "field"), OPTIONAL, ids=".".join)
def test_every_optional_field_says_and_publishes_what_its_absence_means(name, field):
    model = REQUESTS[name]
    words = absence(model.model_fields[field])
    assert words
    published = PUBLISHED[name]["properties"][field]
    assert published["x-absent"] == words
    assert published["x-ros-type"]


@pytest.mark.parametrize(("name", "field"), OPTIONAL, ids=".".join)
def test_the_zero_of_a_typed_message_is_absence(name, field):
    model = REQUESTS[name]
    plain = needed(model)
    absent = getattr(read(model, plain), field)
    if (name, field) == ALWAYS_TOLD:
        assert absent is None
        return
    got = getattr(read(model, {**plain, field: zero(model, field)}), field)
    if absent is None and zero(model, field) == [] and kind_of(model.model_fields[field]).metadata:
        assert got is None or len(got) == 0
    else:
        assert got == absent


@pytest.mark.parametrize("name", sorted(REQUESTS))
def test_values_of_an_optional_field_come_bare_or_as_a_list_of_one(name):
    model = REQUESTS[name]
    plain = needed(model)
    for field in model.at_most_one:
        value = sample(model.model_fields[field])
        bare, listed = (read(model, {**plain, field: one}) for one in (value, [value]))
        assert repr(getattr(bare, field)) == repr(getattr(listed, field))
        with pytest.raises(UsageError, match=field):
            read(model, {**plain, field: [value, value]})


def test_no_flag_can_be_forgotten_into_false():
    for name, operation in OPERATIONS.items():
        for typedef in typedefs_of(f"rtask/{name}", operation.request):
            rows = zip(
                typedef["fieldnames"], typedef["fieldtypes"], typedef["fieldarraylen"], strict=True
            )
            for field, type_, length in rows:
                if type_ == "bool" and length != LIST:
                    owner = next(m for m in REQUESTS.values() if field in m.model_fields)
                    assert owner.model_fields[field].default is False, (name, field)


def test_an_outcome_without_success_is_refused_and_not_a_failure():
    assert read(OutcomeReport, {"success": [True]}).success is True
    assert read(OutcomeReport, {"success": [False]}).success is False
    with pytest.raises(UsageError, match="success is missing"):
        read(OutcomeReport, {"success": [], "reason": ""})
