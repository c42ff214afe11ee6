"""Messages of ``rtask_msgs`` to the JSON of requests, and the JSON of answers to messages.

Works on the classes that genpy (ROS 1) and rosidl (ROS 2) generate, by the schema they were
generated from. A field that was left out in a message is left out in the request, at every depth.
"""

from __future__ import annotations

import array
import base64
import importlib
import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import UsageError
from rtask.interop.ros.schema import PACKAGE, Arity, Code, Field, Record, Schema

__all__ = [
    "Converter",
    "JsonObject",
    "Make",
    "Pack",
    "bytes_like",
    "fill",
    "make_message",
    "mapping_of",
    "members_of",
    "raw_mapping",
    "stamp_json",
    "time_like",
    "time_of",
]

JsonObject = dict[str, Any]
Make = Callable[[str], Any]
"""Return a new message of a ROS type, such as ``geometry_msgs/Pose``."""
Pack = Callable[[Any, str], Any]
"""Return what stands for a PointCloud2 in a request; takes the message and its place."""

_STAMPS = {"builtin_interfaces/Time": "time", "builtin_interfaces/Duration": "duration"}
_IDL = {"boolean": "bool", "octet": "byte", "double": "float64", "float": "float32"}
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, \d+)?>|(.+)(\[\d+\])")
_WHOLE = frozenset(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))


def make_message(type_: str) -> Any:
    """Return an empty message of a ROS type, ``geometry_msgs/Pose``."""
    package, _, name = type_.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)()


def members_of(message: Any) -> list[tuple[str, str]] | None:
    """Return names and types of a message's fields as genpy writes them; None if it is none."""
    if hasattr(message, "_slot_types"):
        return list(zip(message.__slots__, message._slot_types, strict=True))
    if hasattr(message, "get_fields_and_field_types"):
        return [(n, _plain_type(t)) for n, t in message.get_fields_and_field_types().items()]
    return None


def _plain_type(type_: str) -> str:
    """Return a type as genpy writes it: ``sequence<double>`` is ``float64[]``."""
    listed = _SEQUENCE.fullmatch(type_)
    base, size = (type_, "") if listed is None else (listed[1] or listed[2], listed[3] or "[]")
    base = base.partition("<")[0]  # string<256>
    return f"{_STAMPS.get(base) or _IDL.get(base, base)}{size}"


def bytes_like(field: Any, data: bytes) -> Any:
    """Return bytes as the ``uint8[]`` of a new message has them: of ROS 1 or of ROS 2.

    genpy has bytes; rosidl takes an array whole, and checks anything else byte by byte.
    """
    return array.array("B", data) if isinstance(field, array.array) else data


def time_of(stamp: Any) -> tuple[int, int]:
    """Return the seconds and nanoseconds of a time of ROS 1 or ROS 2."""
    if hasattr(stamp, "nanosec"):
        return int(stamp.sec), int(stamp.nanosec)
    return int(stamp.secs), int(stamp.nsecs)


def stamp_json(stamp: Any) -> dict[str, int]:
    """Return a time as requests carry it."""
    secs, nsecs = time_of(stamp)
    return {"secs": secs, "nsecs": nsecs}


class Converter:
    """Converts the requests and answers of one schema.

    Parameters
    ----------
    schema
        Of the operations.
    make
        Makes empty messages.
    pack
        Packs a cloud in a request; by default it travels as the message that it is.
    """

    def __init__(self, schema: Schema, make: Make, pack: Pack | None = None) -> None:
        self._schema = schema
        self._make = make
        self._pack = pack or (lambda cloud, path: mapping_of(cloud))

    def request(self, operation: str, message: Any) -> JsonObject:
        """Return the request that a service's message carries.

        Raises
        ------
        UsageError
            A field for at most one value holds more, or one value came in two forms.
        """
        return self._wire_object(self._schema.services[operation].request, message, "")

    def answer(self, operation: str, data: Mapping[str, Any], message: Any) -> Any:
        """Fill in the message of an answer and return it.

        Raises
        ------
        UsageError
            The answer does not fit the declaration of this release.
        """
        return self._filled(self._schema.services[operation].answer, data, message, "")

    # Requests

    def _wire_object(self, record: Record, message: Any, where: str) -> JsonObject:
        decoded: JsonObject = {}
        forms: dict[str, str] = {}
        for field in record.fields:
            path = f"{where}{field.name}"
            values = self._given(field, getattr(message, field.name), path)
            for name, value in values.items():
                if name in decoded:
                    raise UsageError(
                        f"{path}: {forms[name]} is given as well; expected one of both"
                    )
                decoded[name], forms[name] = value, path
        return decoded

    def _given(self, field: Field, value: Any, path: str) -> JsonObject:
        """Return what a field says, by the name in JSON; empty if it was left out."""
        if field.code is Code.HEADER:
            return _header(value)
        if field.code is Code.IS_EMPTY:
            return {field.wire: []} if value else {}
        if field.arity is Arity.OPTIONAL:
            if len(value) > 1:
                raise UsageError(f"{path}: {len(value)} values; expected one, or none to leave out")
            return {field.wire: self._value(field, value[0], path)} if len(value) else {}
        if field.arity is Arity.MANY and field.code is not Code.BYTES:
            listed = [self._value(field, v, f"{path}[{k}]") for k, v in enumerate(value)]
            return {field.wire: listed} if listed or not field.is_optional else {}
        if field.is_optional and (field.type == "string" or field.code is Code.BYTES) and not value:
            return {}
        return {field.wire: self._value(field, value, path)}

    def _value(self, field: Field, value: Any, path: str) -> Any:
        if field.code is Code.RECORD:
            return self._wire_object(self._schema.records[field.type], value, f"{path}.")
        if field.code is Code.BYTES:
            return base64.b64encode(bytes(value)).decode("ascii")
        if field.code is Code.POINTS:
            return [value.x, value.y, value.z]
        if field.type == "sensor_msgs/PointCloud2":
            return self._pack(value, path)
        if field.code is Code.MESSAGE:
            return mapping_of(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise UsageError(
                f"{path}: {value} is no number; leave the field empty if there is none"
            )
        return value

    # Answers

    def _filled(self, record: Record, data: Mapping[str, Any], message: Any, where: str) -> Any:
        for field in record.fields:
            value = data.get(field.wire, field.default)
            path = f"{where}{field.name}"
            try:
                setattr(message, field.name, self._coded(field, value, path))
            except (TypeError, ValueError, KeyError, AttributeError) as error:
                raise UsageError(
                    f"the server's answer does not fit {PACKAGE}/{record.name}, {path}: {error!r}; "
                    "are server and node of one release?"
                ) from error
        return message

    def _coded(self, field: Field, value: Any, path: str) -> Any:
        if field.code is Code.JSON:
            return json.dumps(value)
        if field.arity is Arity.OPTIONAL:
            return [] if value is None else [self._made(field, value, path)]
        if field.arity is Arity.MANY:
            return [self._made(field, v, f"{path}[{k}]") for k, v in enumerate(value or ())]
        return self._made(field, value, path)

    def _made(self, field: Field, value: Any, path: str) -> Any:
        if field.code is Code.RECORD:
            made = self._make(f"{PACKAGE}/{field.type}")
            return self._filled(self._schema.records[field.type], value, made, f"{path}.")
        if field.code is Code.MESSAGE:
            return fill(self._make(field.type), value, self._make)
        if field.type == "float64":
            return math.nan if value is None else float(value)
        if field.type == "int64":
            return int(value)
        if field.type == "bool":
            return bool(value)
        if not isinstance(value, str):
            raise TypeError(f"expected a text, got {value!r:.40}")
        return value


def mapping_of(message: Any) -> Any:
    """Return a message of any package as nested mappings; times as ``secs`` and ``nsecs``."""
    if hasattr(message, "nsecs") or hasattr(message, "nanosec"):
        return stamp_json(message)
    members = members_of(message)
    if members is not None:
        return {
            name: base64.b64encode(bytes(getattr(message, name))).decode("ascii")
            if type_ in ("uint8[]", "char[]")
            else mapping_of(getattr(message, name))
            for name, type_ in members
        }
    if hasattr(message, "tolist"):  # an array of numbers
        return message.tolist()
    if isinstance(message, list | tuple):
        return [mapping_of(part) for part in message]
    return message


def fill(message: Any, data: Mapping[str, Any], make: Make) -> Any:
    """Fill in a message of any package from nested mappings and return it.

    Members that the type does not have, such as the times of ROS 2 beside those of ROS 1, are
    ignored; those that are missing stay zero.

    Parameters
    ----------
    make
        Makes the messages that a list holds.
    """
    for name, type_ in members_of(message) or ():
        if name not in data:
            continue
        value, old = data[name], getattr(message, name)
        base, is_list, _ = type_.partition("[")
        if is_list and "/" in base:
            setattr(message, name, [fill(make(base), part, make) for part in value])
        elif is_list:
            setattr(message, name, _numbers(value, base))
        elif base in ("time", "duration"):
            setattr(message, name, time_like(old, int(value["secs"]), int(value["nsecs"])))
        elif "/" in base:
            fill(old, value, make)
        else:
            setattr(message, name, type(old)(value))
    return message


def time_like(old: Any, secs: int, nsecs: int) -> Any:
    """Return a time of the kind of another, of ROS 1 or ROS 2."""
    if hasattr(old, "nanosec"):
        return type(old)(sec=secs, nanosec=nsecs)
    return type(old)(secs, nsecs)


def _numbers(values: Any, base: str) -> list[Any]:
    """Return a list with members of the type that the strict classes of rosidl accept."""
    if base.startswith("float"):
        return [float(value) for value in values]
    return [int(value) for value in values] if base in _WHOLE else list(values)


def _header(header: Any) -> JsonObject:
    values: JsonObject = {}
    if any(time_of(header.stamp)):
        values["stamp"] = stamp_json(header.stamp)
    if header.frame_id:
        values["frame_id"] = header.frame_id
    return values


def raw_mapping(message: Any) -> JsonObject:
    """Return a message's own fields with its bytes as they are, as :mod:`features.codec` reads."""
    values = {name: getattr(message, name) for name, _ in members_of(message) or ()}
    if "header" in values:
        values["header"] = {"frame_id": message.header.frame_id}
    if "fields" in values:
        values["fields"] = [mapping_of(field) for field in message.fields]
    return values
