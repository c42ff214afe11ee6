"""The package rtask_msgs: what its definitions say, and that absence is never taken for a value.

Needs no ROS: messages are made of the schema alone, with the zeros that generated classes have.
"""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rtask.cli.ros.schema import definitions_text
from rtask.engine.operations.table import OPERATIONS
from rtask.errors import UsageError
from rtask.interop.ros.convert import Converter
from rtask.interop.ros.declared import declared_schema
from rtask.interop.ros.package import definitions_of, write_source
from rtask.interop.ros.schema import Arity, Code, Field, Record
from rtask.wire.fields import parts_of
from rtask.wire.message import Answer, Message, named
from rtask.wire.ros import CHANGE
from rtask.wire.types import Flag, Json, Number, Stamp, Text
from simulate.act.request import ActMessage, ActRequest
from simulate.robots import describe

SCHEMA = declared_schema(OPERATIONS.values())
GOLDEN = Path(__file__).with_name("rtask_msgs.txt")
MODELS = {
    model.__name__: model for one in OPERATIONS.values() for model in parts_of(one.request).values()
}
REQUESTS = {
    **{name: one.request for name, one in SCHEMA.services.items()},
    **{name: record for name, record in SCHEMA.records.items() if name in MODELS},
}
OPTIONAL = [
    (name, field.name)
    for name, record in REQUESTS.items()
    for field in record.fields
    if field.is_optional
]
NAO = describe("nao")
POSE = {"position": dict.fromkeys("xyz", 0.1), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
# Clouds are packed on the way: test_node.py.
SETTABLE = [
    (name, field)
    for name, field in OPTIONAL
    if next(f for f in REQUESTS[name].fields if f.name == field).type != "sensor_msgs/PointCloud2"
]
ZEROS = {"string": "", "float64": 0.0, "int64": 0, "bool": False}
SAMPLES = {"string": "cup", "float64": 0.0, "int64": 0, "bool": False}


class Point:
    """Three numbers."""

    __slots__ = ("x", "y", "z")
    _slot_types = ("float64", "float64", "float64")

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        self.x, self.y, self.z = x, y, z


def blank(record: Record) -> Any:
    """Return a message as ROS makes it: every field there, nothing set."""
    return SimpleNamespace(**{one.name: zero(one) for one in record.fields})


def zero(one: Field) -> Any:
    if one.code is Code.BYTES:
        return b""
    if one.arity is not Arity.SINGLE:
        return []
    if one.code is Code.HEADER:
        return SimpleNamespace(stamp=SimpleNamespace(secs=0, nsecs=0), frame_id="")
    return Point() if one.code is Code.MESSAGE else ZEROS[one.type]


def sample(one: Field) -> tuple[Any, Any]:
    """Return a value of a field in ROS, zero where that is legal, and the one in JSON."""
    if one.code is Code.HEADER:
        stamp = {"secs": 7, "nsecs": 8}
        return SimpleNamespace(stamp=SimpleNamespace(**stamp), frame_id="base"), stamp
    if one.code is Code.BYTES:
        return b"\0\xff", base64.b64encode(b"\0\xff").decode()
    if one.code is Code.IS_EMPTY:
        return True, []
    if one.code is Code.RECORD:
        inner = blank(SCHEMA.records[one.type])
        value, told = inner, converter()._wire_object(SCHEMA.records[one.type], inner, "")
    elif one.code is Code.POINTS:
        value, told = Point(1.0, 2.0, 3.0), [1.0, 2.0, 3.0]
    elif one.code is Code.MESSAGE:
        value, told = Point(1.0, 2.0, 3.0), {"x": 1.0, "y": 2.0, "z": 3.0}
    else:
        value = told = SAMPLES[one.type]
    if one.arity is Arity.OPTIONAL:
        return [value], told
    return ([value], [told]) if one.arity is Arity.MANY else (value, told)


def converter() -> Converter:
    """Return a converter that makes messages of the schema alone."""

    def make(type_: str) -> Any:
        name = type_.rpartition("/")[2]
        return blank(SCHEMA.records[name]) if name in SCHEMA.records else Point()

    return Converter(SCHEMA, make)


def told(record: Record, message: Any) -> dict[str, Any]:
    return converter()._wire_object(record, message, "")


def test_the_definitions_change_only_on_purpose():
    """After a change that is meant: python -m rtask.cli.ros.schema > this folder/rtask_msgs.txt"""
    assert definitions_text() == GOLDEN.read_text("utf-8")


@pytest.mark.parametrize(("name", "field"), OPTIONAL, ids=str)
def test_an_optional_field_that_was_not_set_is_not_told(name, field):
    record = REQUESTS[name]
    one = next(f for f in record.fields if f.name == field)
    said = told(record, blank(record))
    model = MODELS[name] if name in MODELS else OPERATIONS[name].request
    default = model.model_fields[one.wire].get_default(call_default_factory=True)
    assert one.wire not in said or said[one.wire] == default


@pytest.mark.parametrize(("name", "field"), SETTABLE, ids=str)
def test_an_optional_field_that_was_set_is_told_even_if_it_is_zero(name, field):
    record = REQUESTS[name]
    one = next(f for f in record.fields if f.name == field)
    message = blank(record)
    value, expected = sample(one)
    setattr(message, field, value)
    assert told(record, message)[one.wire] == expected


def test_a_field_for_at_most_one_value_refuses_two():
    message = blank(SCHEMA.services["report_outcome"].request)
    message.success = [True, False]
    with pytest.raises(UsageError, match="success: 2 values; expected one, or none"):
        converter().request("report_outcome", message)


def test_one_value_in_two_forms_is_refused():
    message = blank(SCHEMA.services["report_outcome"].request)
    message.grasp, message.grasp_message = "urn:g", [Point()]
    with pytest.raises(UsageError, match="grasp_message: grasp is given as well"):
        converter().request("report_outcome", message)


def test_a_number_that_is_not_finite_is_refused_with_its_path():
    message = blank(SCHEMA.services["report_outcome"].request)
    message.outcome = [blank(SCHEMA.records["OutcomeReport"])]
    message.outcome[0].slip = [math.nan]
    with pytest.raises(UsageError, match=r"^outcome\.slip: nan is no number"):
        converter().request("report_outcome", message)


def test_an_empty_list_and_no_list_are_told_apart():
    request = SCHEMA.services["resolve_request"].request
    message = blank(request)
    assert "objects" not in told(request, message)
    message.no_objects = True
    assert told(request, message)["objects"] == []
    message.objects = ["urn:a"]
    with pytest.raises(UsageError, match="no_objects: objects is given as well"):
        told(request, message)


class Asked(Message):
    """A question."""

    stamp: Stamp | None = None
    """when; default: now"""
    wanted: Text
    """which"""


class Told(Answer):
    """An answer."""

    class_: str = named("class")
    new: bool
    height: float | None
    held: bool | None
    about: Json | None
    later: str = "none"


def declared(request: type[Message] = Asked, answer: type[Answer] = Told) -> Any:
    return SimpleNamespace(name="ask_it", summary="ask", request=request, answer=answer)


def test_nulls_reserved_names_and_defaults_of_answers():
    schema = declared_schema([declared()])
    answer = schema.services["ask_it"].answer
    assert [one.line for one in answer.fields] == [
        "string class_name", "bool is_new", "float64 height  # NaN = none", "bool[] held",
        "string about_json", "string later",
    ]  # fmt: skip
    given = {"class": "cup", "new": True, "height": None, "held": None, "about": None}
    made = Converter(schema, lambda type_: None).answer("ask_it", given, blank(answer))
    assert (made.class_name, made.is_new, made.held, made.later) == ("cup", True, [], "none")
    assert math.isnan(made.height)
    assert json.loads(made.about_json) is None
    held = Converter(schema, lambda type_: None).answer(
        "ask_it", {**given, "height": 0.5, "held": False}, blank(answer)
    )
    assert (held.height, held.held) == (0.5, [False])


def test_an_answer_of_another_release_is_an_error_that_names_the_field():
    schema = declared_schema([declared()])
    message = blank(schema.services["ask_it"].answer)
    with pytest.raises(UsageError, match=r"AskIt, class_name: .*one release"):
        Converter(schema, lambda type_: None).answer("ask_it", {}, message)


def test_a_time_becomes_a_header_that_both_generations_have():
    schema = declared_schema([declared()])
    assert schema.services["ask_it"].request.fields[0].line.startswith("std_msgs/Header header")


class Twice(Message):
    """Two names that differ by case."""

    X: Number | None = None
    """one; default: none"""
    x: Number | None = None
    """other; default: none"""


class Reserved(Message):
    """A word of C++."""

    union: Flag = False
    """no"""


def test_names_that_ros_cannot_have_stop_the_generator():
    with pytest.raises(UsageError, match="Twice: two fields are called x"):
        declared_schema([declared(Twice)])
    with pytest.raises(UsageError, match="'union' is a word of Python or C"):
        declared_schema([declared(Reserved)])


def test_a_field_that_every_response_has_is_no_field_of_an_answer():
    class Judged(Answer):
        """What was judged."""

        refused: list[str]

    with pytest.raises(UsageError, match="Judged: refused is the field of each response"):
        declared_schema([declared(answer=Judged)])


def test_the_source_package_is_written_again_but_nothing_else_is_overwritten(tmp_path):
    written = write_source(SCHEMA, tmp_path)
    (written / "msg" / "Old.msg").write_text("bool old\n")
    assert write_source(SCHEMA, tmp_path) == tmp_path / "rtask_msgs"
    assert not (written / "msg" / "Old.msg").exists()
    assert (written / "srv" / "ReportOutcome.srv").read_text().count("---") == 1
    other = tmp_path / "other" / "rtask_msgs"
    other.mkdir(parents=True)
    with pytest.raises(UsageError, match="is no package rtask_msgs"):
        write_source(SCHEMA, tmp_path / "other")


def members(path: str) -> list[tuple[str, str]]:
    """Return types and names in the first part of a definition written by hand."""
    text = definitions_of("rtask_msgs")[path].partition("---")[0]
    rows = [line.partition("#")[0].split() for line in text.splitlines()]
    return [(row[0], row[1]) for row in rows if row]


def test_the_definitions_written_by_hand_fit_what_they_carry():
    act = {name: type_ for type_, name in members("srv/Act.srv")}
    assert list(act) == list(ActMessage.model_fields)
    lists = {name for name, type_ in act.items() if type_.endswith("[]")}
    # Of the others ActRequest reads zero as the default.
    assert lists == {"angle_resolution_in", "goal_pose"} <= ActMessage.at_most_one
    for name in act.keys() - lists - {"robot_name", "end_eff_name"}:
        zero = "" if act[name] == "string" else 0
        given = {"goal_pose": POSE, name: zero}
        assert ActRequest.read(given, NAO) == ActRequest.read({"goal_pose": POSE}, NAO)
    assert members("msg/Change.msg") == [(str(one), one.name) for one in CHANGE]
