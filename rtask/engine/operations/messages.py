"""Requests: which fields a message has, and reading them with errors that help.

One declaration serves the check, the documentation and the pages. Numbers may come as numeric
text, as in the printed messages of Gatto 2016, 3.2.4; typed ROS clients send every field, so an
empty text in a field that may be left out counts as left out.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

__all__ = ["Field", "Kind", "nearest", "read"]

Kind = Literal[
    "string", "number", "integer", "boolean", "bytes", "pose", "points", "time",
    "strings", "record", "records", "grasp",
]  # fmt: skip

_MOST_POINTS = 500


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Parameters
    ----------
    name
        As on the wire.
    kind
        ``bytes`` is base64 text; ``pose`` a geometry_msgs/Pose; ``points`` a list of [x, y, z] in
        m; ``time`` a ROS stamp; ``record`` an object with ``fields``; ``grasp`` an IRI, or a grasp
        as it was received.
    summary
        What it means, one line.
    low, high
        Range of numbers, or of the length of lists.
    choices
        The only texts allowed.
    fields
        Of a record, or of each entry of records.
    aliases
        Other names under which it may come.
    """

    name: str
    kind: Kind
    summary: str
    required: bool = False
    default: Any = None
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    fields: tuple[Field, ...] = ()
    aliases: tuple[str, ...] = ()


def nearest(name: str, known: Sequence[str]) -> str:
    """Return the words ``; did you mean 'x'?`` when something known is near, else nothing.

    >>> nearest("grippr_id", ["gripper_id", "task"])
    "; did you mean 'gripper_id'?"
    """
    found = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"; did you mean {found[0]!r}?" if found else ""


def read(fields: Sequence[Field], message: Any, where: str = "") -> dict[str, Any]:
    """Check a message and return its values by field name, defaults filled in.

    Parameters
    ----------
    where
        Path of the message inside a larger one, ``objects[2].``.

    Raises
    ------
    UsageError
        Naming the field by its path, what came and what is wanted.

    Examples
    --------
    >>> wanted = [Field("x", "number", "abscissa", required=True)]
    >>> read(wanted, {"x": "0.5"})
    {'x': 0.5}
    >>> read(wanted, {"y": 1})
    Traceback (most recent call last):
    rtask.errors.UsageError: unknown field 'y'; known: x
    """
    if not isinstance(message, dict):
        raise UsageError(f"{where.rstrip('.') or 'the request'}: an object with fields is wanted")
    names = {alias: f.name for f in fields for alias in (f.name, *f.aliases)}
    given: dict[str, Any] = {}
    for key, value in message.items():
        if key not in names:
            hint = nearest(str(key), list(names)) or f"; known: {', '.join(sorted(names))}"
            raise UsageError(f"unknown field {where + str(key)!r}{hint}", field=where + str(key))
        if value is not None:
            given[names[key]] = value
    answer = {}
    for field in fields:
        value = given.get(field.name)
        if isinstance(value, str) and not value.strip() and not field.required:
            value = None
        if value is None:
            if field.required:
                raise UsageError(
                    f"{where}{field.name} is missing: {field.summary}", field=where + field.name
                )
            answer[field.name] = field.default
            continue
        answer[field.name] = _READERS[field.kind](field, value, where + field.name)
    return answer


def _wrong(path: str, wanted: str, value: Any) -> UsageError:
    shown = repr(value)
    shown = shown if len(shown) <= 60 else shown[:57] + "..."
    return UsageError(f"{path}: {wanted} is wanted, got {shown}", field=path)


def _in_range(field: Field, number: float, path: str, what: str = "") -> None:
    if field.low is not None and number < field.low:
        raise UsageError(f"{path}: {what}{number:g} is below {field.low:g}", field=path)
    if field.high is not None and number > field.high:
        raise UsageError(f"{path}: {what}{number:g} is above {field.high:g}", field=path)


def _string(field: Field, value: Any, path: str) -> str:
    if not isinstance(value, str) or not value.strip():
        raise _wrong(path, "a text", value)
    if field.choices and value not in field.choices:
        hint = nearest(value, field.choices) or f"; one of {', '.join(field.choices)}"
        raise UsageError(f"{path}: unknown value {value!r}{hint}", field=path)
    return value


def _number(field: Field, value: Any, path: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise _wrong(path, "a finite number", value)
    _in_range(field, number, path)
    return number


def _integer(field: Field, value: Any, path: str) -> int:
    number = _number(field, value, path)
    if number != int(number):
        raise _wrong(path, "a whole number", value)
    return int(value) if isinstance(value, int | str) and str(value).isdecimal() else int(number)


def _boolean(field: Field, value: Any, path: str) -> bool:
    if isinstance(value, bool):
        return value
    known = {"true": True, "false": False, "1": True, "0": False}
    if isinstance(value, str | int) and str(value).strip().casefold() in known:
        return known[str(value).strip().casefold()]
    raise _wrong(path, "true or false", value)


def _bytes(field: Field, value: Any, path: str) -> bytes:
    from features.codec import from_wire

    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    if not isinstance(value, str):
        raise _wrong(path, "base64 text", value)
    try:
        return from_wire(value)
    except ValueError as error:
        raise UsageError(f"{path}: {error}", field=path) from error


def _pose(field: Field, value: Any, path: str) -> NDArray[np.float64]:
    from grasp.messages import matrix_from_message

    try:
        return np.asarray(matrix_from_message(value), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise UsageError(f"{path}: {error}", field=path) from error


def _points(field: Field, value: Any, path: str) -> NDArray[np.float64]:
    try:
        points = np.array(value, dtype=np.float64).reshape(-1, 3) if value else np.zeros((0, 3))
    except (TypeError, ValueError) as error:
        raise _wrong(path, "a list of [x, y, z] in m", value) from error
    if not np.isfinite(points).all():
        raise UsageError(f"{path}: points must be finite", field=path)
    if len(points) > _MOST_POINTS:
        raise UsageError(f"{path}: {len(points)} points; at most {_MOST_POINTS}", field=path)
    return points


def _time(field: Field, value: Any, path: str) -> float:
    """Return s since the epoch of a number, or of a stamp of ROS 1 or ROS 2."""
    if isinstance(value, dict):
        whole = value.get("sec", value.get("secs", 0))
        part = value.get("nanosec", value.get("nsecs", 0))
        return _number(field, whole, path) + _number(field, part, path) * 1e-9
    return _number(field, value, path)


def _strings(field: Field, value: Any, path: str) -> list[str]:
    listed = [value] if isinstance(value, str) else value
    if not isinstance(listed, list) or not all(isinstance(v, str) for v in listed):
        raise _wrong(path, "a list of texts", value)
    _in_range(field, len(listed), path, "length ")
    return listed


def _record(field: Field, value: Any, path: str) -> dict[str, Any]:
    return read(field.fields, value, path + ".")


def _records(field: Field, value: Any, path: str) -> list[dict[str, Any]]:
    if not isinstance(value, list):
        raise _wrong(path, "a list", value)
    _in_range(field, len(value), path, "length ")
    return [read(field.fields, entry, f"{path}[{i}].") for i, entry in enumerate(value)]


def _grasp(field: Field, value: Any, path: str) -> str | dict[str, Any]:
    """Take a grasp as it was received, whatever the robot added to it."""
    if isinstance(value, str):
        return _string(field, value, path)
    if not isinstance(value, dict):
        raise _wrong(path, "the id of a grasp, or a grasp as received,", value)
    return value


_READERS: dict[Kind, Callable[[Field, Any, str], Any]] = {
    "string": _string,
    "number": _number,
    "integer": _integer,
    "boolean": _boolean,
    "bytes": _bytes,
    "pose": _pose,
    "points": _points,
    "time": _time,
    "strings": _strings,
    "record": _record,
    "records": _records,
    "grasp": _grasp,
}
