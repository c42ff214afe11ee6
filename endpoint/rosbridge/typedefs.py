"""ROS type descriptions, from the fields that the engine reads and the types of its answers."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterable
from typing import Any, NotRequired

from endpoint.rosbridge.messages import JsonObject

SCALAR, LIST = -1, 0

# Kind of a field -> ROS type and length of the array.
_ROS = {
    "string": ("string", SCALAR),
    "number": ("float64", SCALAR),
    "integer": ("int64", SCALAR),
    "boolean": ("bool", SCALAR),
    "bytes": ("string", SCALAR),
    "grasp": ("string", SCALAR),
    "time": ("time", SCALAR),
    "pose": ("geometry_msgs/Pose", SCALAR),
    "points": ("geometry_msgs/Point", LIST),
    "strings": ("string", LIST),
}
_PYTHON = {str: "string", float: "float64", int: "int64", bool: "bool"}
_TEXT = "string"  # of what has no type of its own: JSON
_KNOWN: dict[str, tuple[tuple[str, str, int], ...]] = {
    "geometry_msgs/Pose": (
        ("position", "geometry_msgs/Point", SCALAR),
        ("orientation", "geometry_msgs/Quaternion", SCALAR),
    ),
    "geometry_msgs/Point": tuple((axis, "float64", SCALAR) for axis in "xyz"),
    "geometry_msgs/Quaternion": tuple((axis, "float64", SCALAR) for axis in "xyzw"),
    "rtask/Change": (
        ("commit", "int64", SCALAR), ("agent", "string", SCALAR), ("graphs", "string", LIST),
        ("added", "int64", SCALAR), ("removed", "int64", SCALAR), ("derived", "int64", SCALAR),
    ),
    "rtask/Activity": (("robot", "string", SCALAR), ("service", "string", SCALAR)),
}  # fmt: skip


def request_typedefs(type_: str, fields: Iterable[Any]) -> list[JsonObject]:
    """Return the descriptions of a request and of all types in it, the request first.

    Parameters
    ----------
    type_
        ROS name of the service's type, ``rtask/SearchObject``.
    fields
        Of the operation, :class:`rtask.engine.operations.messages.Field`.
    """
    found: dict[str, JsonObject] = {}
    _add(f"{type_}Request", fields, found)
    return _with_held(found)


def response_typedefs(type_: str, declared: Any) -> list[JsonObject]:
    """Return the descriptions of an answer and of all types in it, the answer first.

    Parameters
    ----------
    declared
        Typed dictionary of :mod:`rtask.engine.operations.answers`.
    """
    found: dict[str, JsonObject] = {}
    _add_answer(f"{type_}Response", declared, found)
    return _with_held(found)


def message_typedefs(type_: str) -> list[JsonObject]:
    """Return the descriptions of a message of the server's topics, or of geometry_msgs.

    Empty where the type is another's: robots say no more of theirs than the name.

    Examples
    --------
    >>> [entry["type"] for entry in message_typedefs("geometry_msgs/Pose")]
    ['geometry_msgs/Pose', 'geometry_msgs/Point', 'geometry_msgs/Quaternion']
    """
    found: dict[str, JsonObject] = {}
    if type_ in _KNOWN:
        found[type_] = _typedef(type_, list(_KNOWN[type_]))
    return _with_held(found)


def _with_held(found: dict[str, JsonObject]) -> list[JsonObject]:
    """Return descriptions with those of the known types that they hold."""
    todo = list(found.values())
    while todo:
        for of in todo.pop()["fieldtypes"]:
            if of in _KNOWN and of not in found:
                found[of] = _typedef(of, list(_KNOWN[of]))
                todo.append(found[of])
    return list(found.values())


def full_text(typedef: JsonObject) -> str:
    """Return a description in the words of a ``.msg`` file.

    Examples
    --------
    >>> full_text(_typedef("a/B", [("x", "float64", SCALAR), ("names", "string", LIST)]))
    'float64 x\\nstring[] names'
    """
    rows = zip(typedef["fieldtypes"], typedef["fieldnames"], typedef["fieldarraylen"], strict=True)
    return "\n".join(f"{of}{'[]' if length == LIST else ''} {name}" for of, name, length in rows)


def _add(type_: str, fields: Iterable[Any], found: dict[str, JsonObject]) -> None:
    members: list[tuple[str, str, int]] = []
    found[type_] = {}  # its place is before the types that it holds
    for field in fields:
        if field.kind in ("record", "records"):
            of = f"{type_}{''.join(part.capitalize() for part in field.name.split('_'))}"
            _add(of, field.fields, found)
            members.append((field.name, of, LIST if field.kind == "records" else SCALAR))
        else:
            members.append((field.name, *_ROS[field.kind]))
    found[type_] = _typedef(type_, members)


def _add_answer(type_: str, declared: Any, found: dict[str, JsonObject]) -> None:
    members: list[tuple[str, str, int]] = []
    found[type_] = {}
    for name, hint in typing.get_type_hints(declared, include_extras=True).items():
        of, length = _plain(hint)
        if typing.is_typeddict(of):
            held = f"rtask/{of.__name__}"
            if held not in found:
                _add_answer(held, of, found)
            members.append((name, held, length))
        else:
            members.append((name, _PYTHON.get(of, _TEXT), length))
    found[type_] = _typedef(type_, members)


def _plain(hint: Any) -> tuple[Any, int]:
    """Return the type that a declared one is or lists, and the length of the array."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is NotRequired:
        return _plain(arguments[0])
    if origin in (types.UnionType, typing.Union):
        return _plain(next(one for one in arguments if one is not type(None)))
    if origin is list:
        return _plain(arguments[0])[0], LIST
    return hint, SCALAR


def _typedef(type_: str, members: list[tuple[str, str, int]]) -> JsonObject:
    return {
        "type": type_,
        "fieldnames": [name for name, _, _ in members],
        "fieldtypes": [of for _, of, _ in members],
        "fieldarraylen": [length for _, _, length in members],
        "examples": ["[]" if length == LIST else _example(of) for _, of, length in members],
        "constnames": [],
        "constvalues": [],
    }


def _example(of: str) -> str:
    return {"string": "", "float64": "0.0", "int64": "0", "bool": "False"}.get(of, "{}")
