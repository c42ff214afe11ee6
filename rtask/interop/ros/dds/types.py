"""Types of ROS 2: definitions, CDR and RIHS01 hashes, also of services.

:mod:`rosbags` brings the definitions of Jazzy, the CDR and the hashes of messages. Services are
described as rosidl does: a request, a response, and an event that holds at most one of each.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rtask.errors import UsageError
from rtask.interop.ros.package import definitions_of
from rtask.interop.ros.schema import PACKAGE, Schema

__all__ = ["RosTypes", "dds_name", "full_type"]

_OTHERS = ("moveit_msgs", "object_recognition_msgs", "octomap_msgs", "shape_msgs")
_STAMPS = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}
_FILLER = "structure_needs_at_least_one_member"
_EVENT = "service_msgs/msg/ServiceEventInfo"
_UUID = "unique_identifier_msgs/msg/UUID"


def full_type(type_: str) -> str:
    """Return the name of a message in ROS 2.

    Examples
    --------
    >>> full_type("geometry_msgs/Pose")
    'geometry_msgs/msg/Pose'
    """
    parts = type_.split("/")
    if len(parts) == 2:
        parts.insert(1, "msg")
    if len(parts) != 3 or not all(parts):
        raise UsageError(f"{type_!r} is no type of ROS 2; expected package/msg/Name")
    return "/".join(parts)


def dds_name(type_: str) -> str:
    """Return the name of a type in DDS.

    Examples
    --------
    >>> dds_name("std_msgs/msg/String")
    'std_msgs::msg::dds_::String_'
    """
    package, kind, name = full_type(type_).split("/")
    return f"{package}::{kind}::dds_::{name}_"


class RosTypes:
    """Messages of ROS 2 and of a schema, by their names: ``rtask_msgs/msg/Change``.

    The messages that :meth:`make` and :meth:`decode` return have the form that genpy gives to those
    of ROS 1, with ``secs`` and ``nsecs``, so that one converter serves both.
    """

    def __init__(self, schema: Schema | None = None) -> None:
        self.store: Typestore = get_typestore(Stores.ROS2_JAZZY)
        self._classes: dict[str, type] = {}
        event = self.store.fielddefs[_EVENT][1]
        # rosidl takes char for uint8, also in hashes.
        self.store.fielddefs[_EVENT] = ([], [(n, _without_char(d)) for n, d in event])
        for path, text in _definitions(schema):
            self.add_message(path, text)
        if schema is not None:
            for path, text in definitions_of(PACKAGE).items():
                if path.startswith("action/"):
                    self.add_action(f"{PACKAGE}/{path.removesuffix('.action')}", text)

    def add_message(self, type_: str, text: str) -> None:
        """Register a message, ``package/msg/Name``, unless it is known."""
        if type_ not in self.store.fielddefs:
            self._register(type_, text)

    def add_service(self, type_: str, text: str) -> None:
        """Register the two halves of a service, ``example_interfaces/srv/AddTwoInts``."""
        for half, part in zip(("Request", "Response"), text.split("---\n"), strict=True):
            self._register(f"{type_}_{half}", part)

    def add_action(self, type_: str, text: str) -> None:
        """Register an action, ``rtask_msgs/action/See``, and what rosidl derives from it."""
        for name, part in zip(("Goal", "Result", "Feedback"), text.split("---\n"), strict=True):
            self._register(f"{type_}_{name}", part)

        def named(name: str) -> Any:
            return Nodetype.NAME, f"{type_}_{name}"

        goal_id = ("goal_id", (Nodetype.NAME, _UUID))
        derived: dict[str, list[tuple[str, Any]]] = {
            "SendGoal_Request": [goal_id, ("goal", named("Goal"))],
            "SendGoal_Response": [
                ("accepted", (Nodetype.BASE, ("bool", 0))),
                ("stamp", (Nodetype.NAME, "builtin_interfaces/msg/Time")),
            ],
            "GetResult_Request": [goal_id],
            "GetResult_Response": [
                ("status", (Nodetype.BASE, ("int8", 0))),
                ("result", named("Result")),
            ],
            "FeedbackMessage": [goal_id, ("feedback", named("Feedback"))],
        }
        # Not by register(), which cannot name types of actions; they are hashed, never sent.
        defs: Any = self.store.fielddefs
        for name, fields in derived.items():
            defs[f"{type_}_{name}"] = ([], fields)
        services = {"send_goal_service": "SendGoal", "get_result_service": "GetResult"}
        for service in services.values():
            self._add_event(f"{type_}_{service}")
        parts = {"goal": "Goal", "result": "Result", "feedback": "Feedback", **services}
        parts["feedback_message"] = "FeedbackMessage"
        defs[type_] = ([], [(field, named(name)) for field, name in parts.items()])

    def hashes(self, package: str = PACKAGE) -> dict[str, str]:
        """Return the RIHS01 hash of each type of a package by its name, in ROS's order of names."""
        for type_ in list(self.store.fielddefs):
            if type_.startswith(f"{package}/srv/") and type_.endswith("_Request"):
                self.hash(type_.removesuffix("_Request"))
        own = sorted(name for name in self.store.fielddefs if name.startswith(f"{package}/"))
        return {type_: self.hash(type_) for type_ in own}

    def hash(self, type_: str) -> str:
        """Return the RIHS01 hash of a message, service or action: ``package/srv/Name``.

        Raises
        ------
        UsageError
            The type is not known.
        """
        if f"{type_}_Request" in self.store.fielddefs and f"{type_}_Event" not in (
            self.store.fielddefs
        ):
            self._add_event(type_)
        if type_ not in self.store.fielddefs:
            raise UsageError(f"type {type_!r} is not known; expected one that ROS 2 brings")
        return str(self.store.hash_rihs01(type_))

    def make(self, type_: str) -> Any:
        """Return an empty message."""
        return self._class(full_type(type_))()

    def encode(self, message: Any, type_: str) -> bytes:
        """Return the CDR of a message that :meth:`make` returned and a program filled in."""
        return bytes(self.store.serialize_cdr(self._packed(message, type_), type_))

    def decode(self, data: bytes, type_: str) -> Any:
        """Return the message of a CDR, in the form of :meth:`make`.

        Raises
        ------
        UsageError
            It is no CDR of this type.
        """
        return self._unpacked(self.decode_arrays(data, type_), type_)

    def decode_arrays(self, data: bytes, type_: str) -> Any:
        """Return the message of a CDR as one of :mod:`rosbags`, whose lists are arrays.

        Raises
        ------
        UsageError
            It is no CDR of this type.
        """
        from rosbags.serde import SerdeError

        try:
            return self.store.deserialize_cdr(data, type_)
        except (SerdeError, ValueError, AssertionError, IndexError, struct.error) as error:
            raise UsageError(f"no {type_}: {error or 'it is cut off'}") from error

    def _register(self, type_: str, text: str) -> None:
        # rosbags takes every type for a message and would write srv/msg into the name.
        package, _, name = type_.split("/")
        (definition,) = get_types_from_msg(text, f"{package}/msg/{name}").values()
        self.store.register({type_: definition})

    def _add_event(self, type_: str) -> None:
        defs: Any = self.store.fielddefs
        named = {
            half: (Nodetype.NAME, f"{type_}_{half}") for half in ("Request", "Response", "Event")
        }
        # Not by register(), which would generate Python for what is never sent.
        defs[f"{type_}_Event"] = (
            [],
            [
                ("info", (Nodetype.NAME, _EVENT)),
                ("request", (Nodetype.SEQUENCE, (named["Request"], 1))),
                ("response", (Nodetype.SEQUENCE, (named["Response"], 1))),
            ],
        )
        defs[type_] = (
            [],
            [(f"{half.lower()}_message", description) for half, description in named.items()],
        )

    def fields(self, type_: str) -> list[tuple[str, Any]]:
        """Return names and descriptions of a message's fields, as rosbags has them."""
        try:
            return list(self.store.fielddefs[type_][1])
        except KeyError:
            raise UsageError(f"type {type_!r} is not known") from None

    def _class(self, type_: str) -> type:
        if type_ in self._classes:
            return self._classes[type_]
        if type_ in _STAMPS:
            return _Stamp
        fields = [(name, desc) for name, desc in self.fields(type_) if name != _FILLER]

        def start(message: Any) -> None:
            for name, desc in fields:
                setattr(message, name, self._empty(desc))

        members = {
            "__slots__": tuple(name for name, _ in fields),
            "_slot_types": tuple(_slot_type(desc) for _, desc in fields),
            "__init__": start,
        }
        made = self._classes[type_] = type(type_.rpartition("/")[2], (), members)
        return made

    def _empty(self, desc: Any) -> Any:
        kind, what = desc
        if kind == Nodetype.BASE:
            return {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}.get(what[0], 0)
        if kind == Nodetype.NAME:
            return self._class(what)()
        if kind == Nodetype.SEQUENCE:
            return []
        return [self._empty(what[0]) for _ in range(what[1])]

    def _packed(self, message: Any, type_: str) -> Any:
        """Return a message of rosbags."""
        made = self.store.types[type_]
        if type_ in _STAMPS:
            return made(sec=message.secs, nanosec=message.nsecs)
        values = {
            name: 0 if name == _FILLER else self._packed_value(getattr(message, name), desc)
            for name, desc in self.fields(type_)
        }
        return made(**values)

    def _packed_value(self, value: Any, desc: Any) -> Any:
        kind, what = desc
        if kind == Nodetype.NAME:
            return self._packed(value, what)
        if kind == Nodetype.BASE:
            return value
        inner, base = what[0]
        if inner == Nodetype.NAME or base[0] == "string":
            return [self._packed_value(part, what[0]) for part in value]
        if isinstance(value, bytes):
            return np.frombuffer(value, np.uint8)
        return np.asarray(value, _DTYPES.get(base[0], base[0]))

    def _unpacked(self, message: Any, type_: str) -> Any:
        if type_ in _STAMPS:
            return _Stamp(message.sec, message.nanosec)
        made = self._class(type_)()
        for name, desc in self.fields(type_):
            if name != _FILLER:
                setattr(made, name, self._unpacked_value(getattr(message, name), desc))
        return made

    def _unpacked_value(self, value: Any, desc: Any) -> Any:
        kind, what = desc
        if kind == Nodetype.NAME:
            return self._unpacked(value, what)
        if isinstance(value, np.ndarray):
            return value.tobytes() if what[0][1][0] in ("uint8", "byte") else value.tolist()
        if kind == Nodetype.BASE:
            return value
        return [self._unpacked_value(part, what[0]) for part in value]


_DTYPES = {"byte": "uint8", "char": "uint8"}


class _Stamp:
    """A time or duration, with the members of genpy's."""

    __slots__ = ("nsecs", "secs")

    def __init__(self, secs: int = 0, nsecs: int = 0) -> None:
        self.secs, self.nsecs = secs, nsecs


def _definitions(schema: Schema | None) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each message, those of services as their halves."""
    for package in _OTHERS:
        for path, text in definitions_of(package).items():
            if path.startswith("msg/"):
                yield f"{package}/{path.removesuffix('.msg')}", text
    if schema is None:
        return
    from rtask.interop.ros.package import source_files

    for path, text in source_files(schema).items():
        if path.startswith("msg/"):
            yield f"{PACKAGE}/{path.removesuffix('.msg')}", text
        elif path.startswith("srv/"):
            for half, part in zip(("Request", "Response"), text.split("---\n"), strict=True):
                yield f"{PACKAGE}/{path.removesuffix('.srv')}_{half}", part


def _without_char(desc: Any) -> Any:
    kind, what = desc
    if kind == Nodetype.BASE:
        return kind, ("uint8", 0) if what[0] == "char" else what
    if kind == Nodetype.NAME:
        return desc
    return kind, (_without_char(what[0]), what[1])


def _slot_type(desc: Any) -> str:
    kind, what = desc
    if kind == Nodetype.BASE:
        return str(what[0])
    if kind == Nodetype.NAME:
        return _STAMPS.get(what) or str(what).replace("/msg/", "/")
    size = str(what[1]) if kind == Nodetype.ARRAY else ""
    return f"{_slot_type(what[0])}[{size}]"
