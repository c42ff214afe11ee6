"""ROS type descriptions as rosapi gives them, of declared messages and of the server's topics."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel

from endpoint.rosbridge.messages import JsonObject
from rtask.wire.ros import CHANGE, LIST, SCALAR, ros_types

_STANDARD: dict[str, tuple[tuple[str, str, int], ...]] = {
    "geometry_msgs/Pose": (
        ("position", "geometry_msgs/Point", SCALAR),
        ("orientation", "geometry_msgs/Quaternion", SCALAR),
    ),
    "geometry_msgs/Point": tuple((axis, "float64", SCALAR) for axis in "xyz"),
    "geometry_msgs/Quaternion": tuple((axis, "float64", SCALAR) for axis in "xyzw"),
    "rtask/Change": CHANGE,
    "rtask/Activity": tuple(
        (name, "string", SCALAR) for name in ("robot", "service", "kind", "words", "detail")
    ),
}


def typedefs_of(type_: str, model: type[BaseModel]) -> list[JsonObject]:
    """Return the descriptions of a message and of all types in it, the message first.

    Parameters
    ----------
    type_
        ROS name of the message, ``rtask/SearchObjectRequest``.
    """
    typedefs = {name: _typedef(name, members) for name, members in ros_types(type_, model).items()}
    return _with_held(typedefs)


def message_typedefs(type_: str) -> list[JsonObject]:
    """Return the descriptions of a message of the server's topics, or of geometry_msgs.

    Empty where the type is another's: robots say no more of theirs than the name.

    Examples
    --------
    >>> [entry["type"] for entry in message_typedefs("geometry_msgs/Pose")]
    ['geometry_msgs/Pose', 'geometry_msgs/Point', 'geometry_msgs/Quaternion']
    """
    typedefs: dict[str, JsonObject] = {}
    if type_ in _STANDARD:
        typedefs[type_] = _typedef(type_, list(_STANDARD[type_]))
    return _with_held(typedefs)


def _with_held(typedefs: dict[str, JsonObject]) -> list[JsonObject]:
    """Return descriptions with those of the known types that they hold."""
    todo = list(typedefs.values())
    while todo:
        for of in todo.pop()["fieldtypes"]:
            if of in _STANDARD and of not in typedefs:
                typedefs[of] = _typedef(of, _STANDARD[of])
                todo.append(typedefs[of])
    return list(typedefs.values())


def full_text(typedef: JsonObject) -> str:
    """Return a description in the words of a ``.msg`` file.

    Examples
    --------
    >>> full_text(_typedef("a/B", [("x", "float64", SCALAR), ("names", "string", LIST)]))
    'float64 x\\nstring[] names'
    """
    rows = zip(typedef["fieldtypes"], typedef["fieldnames"], typedef["fieldarraylen"], strict=True)
    return "\n".join(f"{of}{'[]' if length == LIST else ''} {name}" for of, name, length in rows)


def _typedef(type_: str, members: Sequence[tuple[str, str, int]]) -> JsonObject:
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
