"""ROS type descriptions of requests, from the fields that the engine itself reads."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

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
_GEOMETRY = {
    "geometry_msgs/Pose": (
        ("position", "geometry_msgs/Point"),
        ("orientation", "geometry_msgs/Quaternion"),
    ),
    "geometry_msgs/Point": (("x", "float64"), ("y", "float64"), ("z", "float64")),
    "geometry_msgs/Quaternion": tuple((axis, "float64") for axis in "xyzw"),
}


def request_typedefs(type_: str, fields: Iterable[Any]) -> list[JsonObject]:
    """Return the descriptions of a request and of all types in it, the request first.

    Parameters
    ----------
    type_
        ROS name of the service's type, ``rtask/SearchObject``.
    fields
        Of the operation, :class:`rtask.engine.messages.Field`.
    """
    found: dict[str, JsonObject] = {}
    _add(f"{type_}Request", fields, found)
    for name in ("geometry_msgs/Pose", "geometry_msgs/Point", "geometry_msgs/Quaternion"):
        if any(name in entry["fieldtypes"] for entry in found.values()):
            members = _GEOMETRY[name]
            found[name] = _typedef(name, [(member, of, SCALAR) for member, of in members])
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
