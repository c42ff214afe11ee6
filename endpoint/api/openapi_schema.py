"""JSON Schemas (draft 2020-12) of requests and answers, from what the engine declares."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterable
from typing import Any, NotRequired

JsonObject = dict[str, Any]

_NUMBER = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*$"
_INTEGER = r"^\s*\d+\s*$"
_BASE64 = r"^[A-Za-z0-9+/_=\s-]*$"
_XYZ = {
    "type": "object",
    "properties": {axis: {"type": "number"} for axis in "xyz"},
    "required": list("xyz"),
}
_POSE = {
    "type": "object",
    "description": "geometry_msgs/Pose: m, unit quaternion",
    "properties": {
        "position": _XYZ,
        "orientation": {
            "type": "object",
            "properties": {axis: {"type": "number"} for axis in "xyzw"},
            "required": list("xyzw"),
        },
    },
    "required": ["position", "orientation"],
}
_TIME = {
    "type": ["number", "string", "object"],
    "pattern": _NUMBER,
    "description": "s since the epoch, or a stamp of ROS 1 or ROS 2",
    "properties": {
        name: {"type": "integer"} for name in ("sec", "nanosec", "secs", "nsecs")
    },
}  # fmt: skip
_POINTS = {
    "type": "array",
    "maxItems": 500,
    "items": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
}


def request_schema(fields: Iterable[Any]) -> JsonObject:
    """Return the schema of a request.

    Parameters
    ----------
    fields
        Declarations, :class:`rtask.engine.operations.messages.Field`.

    Examples
    --------
    >>> from rtask.engine.operations.messages import Field
    >>> request_schema([Field("x", "integer", "abscissa", required=True)])["required"]
    ['x']
    """
    properties: JsonObject = {}
    required: list[str] = []
    choices: list[JsonObject] = []
    for field in fields:
        schema = _field_schema(field)
        for name in (field.name, *field.aliases):
            properties[name] = schema
        if field.required and field.aliases:
            # One of its names is needed.
            choices.append({"anyOf": [{"required": [n]} for n in (field.name, *field.aliases)]})
        elif field.required:
            required.append(field.name)
    answer: JsonObject = {
        "type": "object", "properties": properties, "additionalProperties": False,
    }  # fmt: skip
    if required:
        answer["required"] = required
    if choices:
        answer["allOf"] = choices
    return answer


def _field_schema(field: Any) -> JsonObject:
    schema: JsonObject = {"description": field.summary, **_of_kind(field)}
    if not field.required:
        if "enum" in schema:
            schema["enum"] = [*schema["enum"], None]
        elif "type" in schema:
            kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
            schema["type"] = [*kinds, "null"]
        if field.default not in (None, [], {}):
            schema["default"] = field.default
    return schema


def _of_kind(field: Any) -> JsonObject:
    if field.kind in ("number", "integer"):
        bounds = {"minimum": field.low, "maximum": field.high}
        return {
            "type": [field.kind, "string"],
            "pattern": _NUMBER if field.kind == "number" else _INTEGER,
            **{name: bound for name, bound in bounds.items() if bound is not None},
        }
    if field.kind == "string":
        if field.choices:
            return {"enum": list(field.choices)}
        return {"type": "string", **({"pattern": r"\S"} if field.required else {})}
    if field.kind == "boolean":
        return {"enum": [True, False, "true", "false", "1", "0"]}
    if field.kind == "bytes":
        return {"type": "string", "contentEncoding": "base64", "pattern": _BASE64}
    if field.kind == "record":
        return request_schema(field.fields)
    bounds = {"minItems": field.low, "maxItems": field.high}
    lengths = {name: int(length) for name, length in bounds.items() if length is not None}
    if field.kind == "records":
        return {"type": "array", "items": request_schema(field.fields), **lengths}
    if field.kind == "strings":
        return {"type": ["array", "string"], "items": {"type": "string"}, **lengths}
    if field.kind == "grasp":
        return {"type": ["string", "object"], "description": f"{field.summary}; as received"}
    fixed: dict[str, JsonObject] = {"pose": _POSE, "points": _POINTS, "time": _TIME}
    return dict(fixed[field.kind])


def answer_schema(declared: Any, schemas: JsonObject) -> JsonObject:
    """Return the schema of a declared type; those of typed dictionaries go to ``schemas``.

    Parameters
    ----------
    declared
        A type of :mod:`rtask.engine.operations.answers`, or of one of its fields.
    schemas
        Gets the schemas of all typed dictionaries in it, by name.
    """
    if typing.is_typeddict(declared):
        name = declared.__name__
        if name not in schemas:
            schemas[name] = {}  # a type may hold itself
            schemas[name] = _typed_dict(declared, schemas)
        return {"$ref": f"#/components/schemas/{name}"}
    origin, arguments = typing.get_origin(declared), typing.get_args(declared)
    if origin is NotRequired:
        return answer_schema(arguments[0], schemas)
    if origin is list:
        return {"type": "array", "items": answer_schema(arguments[0], schemas)}
    if origin in (types.UnionType, typing.Union):
        return {"anyOf": [answer_schema(one, schemas) for one in arguments]}
    if origin is dict:
        return {"type": "object"}
    names = {str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}
    return {"type": names[declared]}


def _typed_dict(declared: Any, schemas: JsonObject) -> JsonObject:
    hints = typing.get_type_hints(declared, include_extras=True)
    required = sorted(n for n, hint in hints.items() if typing.get_origin(hint) is not NotRequired)
    return {
        "type": "object",
        "properties": {name: answer_schema(hint, schemas) for name, hint in hints.items()},
        "required": required,
    }
