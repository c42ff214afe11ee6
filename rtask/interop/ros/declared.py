"""The schema of ``rtask_msgs``, made from declared requests and answers."""

from __future__ import annotations

import keyword
import re
import typing
from collections.abc import Iterable

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rtask.errors import UsageError
from rtask.interop.ros.schema import PACKAGE, REFUSED, Arity, Code, Field, Record, Schema, Service
from rtask.wire.fields import Kind, absence, kind_of, wire_name
from rtask.wire.message import Message
from rtask.wire.ros import LIST, Member, camel_case, ros_types
from rtask.wire.stubs import Declared
from rtask.wire.types import Unit, carried

__all__ = ["RENAMED", "declared_schema"]

RENAMED = {"class": "class_name", "new": "is_new", "operator": "operator_name"}
"""Names in JSON that a language with generated messages reserves, and their names in ROS."""
# fmt: off
_CPP = frozenset({
    "alignas", "alignof", "auto", "bool", "case", "catch", "char", "const", "constexpr", "default",
    "delete", "do", "double", "enum", "explicit", "export", "extern", "float", "friend", "goto",
    "inline", "int", "long", "mutable", "namespace", "new", "noexcept", "nullptr", "operator",
    "private", "protected", "public", "register", "short", "signed", "sizeof", "static", "struct",
    "switch", "template", "this", "throw", "typedef", "typeid", "typename", "union", "unsigned",
    "using", "virtual", "void", "volatile",
})
# fmt: on
_NAME = re.compile(r"[a-z](?:[a-z0-9]|_(?=[a-z0-9]))*")


def declared_schema(operations: Iterable[Declared]) -> Schema:
    """Return the schema of operations.

    Raises
    ------
    UsageError
        A name cannot be used in ROS, or two fields or messages would have the same one.
    """
    reader = _Reader()
    for operation in operations:
        name = camel_case(operation.name)
        summary = f"{operation.summary[0].upper()}{operation.summary[1:]}."
        reader.schema.services[operation.name] = Service(
            name,
            Record(name, summary, reader.fields(operation.request)),
            Record(name, _first_line(operation.answer), reader.answered(operation.answer)),
        )
    return reader.schema


class _Reader:
    """Reads declarations into a schema."""

    def __init__(self) -> None:
        self.schema = Schema()
        self._models: dict[str, type[BaseModel]] = {}

    def answered(self, model: type[BaseModel]) -> tuple[Field, ...]:
        """Return the fields of an answer, beside which each response has one of its own."""
        fields = self.fields(model)
        if REFUSED in (field.name for field in fields):
            raise UsageError(
                f"{model.__name__}: {REFUSED} is the field of each response that says why an "
                "operation was not carried out; give the answer's field another name"
            )
        return fields

    def fields(self, model: type[BaseModel]) -> tuple[Field, ...]:
        """Return the fields of a request, an answer or a record in one."""
        made: list[Field] = []
        members = ros_types("", model)[""]
        for member, (own, declared) in zip(members, model.model_fields.items(), strict=True):
            if issubclass(model, Message):
                is_single = own in model.at_most_one
                made += self._requested(own, declared, member, is_single)
            else:
                made.append(self._answered(wire_name(own, declared), declared, member))
        fields = _joined_header(made)
        names = [field.name for field in fields]
        for name in names:
            if names.count(name) > 1:
                raise UsageError(f"{model.__name__}: two fields are called {name} in ROS")
        return tuple(fields)

    def _requested(
        self, wire: str, declared: FieldInfo, member: Member, is_single: bool
    ) -> list[Field]:
        """Return the field of a request, and the other forms in which it may come."""
        kind = kind_of(declared)
        sent = carried(kind)
        is_optional = not declared.is_required() or bool(sent and sent.also)
        type_, code = self._carried(kind, member.type)
        arity = Arity.MANY if member.length == LIST or code is Code.BYTES else Arity.SINGLE
        if is_single:
            arity = Arity.OPTIONAL
        note = _note(declared, kind, arity)
        made = [Field(_ros_name(wire), wire, type_, arity, code, note, is_optional)]
        for suffix, other in sent.also if sent else ():
            note = f"the same as a {other.partition('/')[2]}; at most one"
            made.append(
                Field(f"{made[0].name}_{suffix}", wire, other, Arity.OPTIONAL, Code.MESSAGE,
                      note, True)
            )  # fmt: skip
        if arity is Arity.MANY and code is Code.VALUE and kind.is_nullable and type_ == "string":
            note = f"whether {made[0].name} is given, and empty"
            made.append(
                Field(f"no_{made[0].name}", wire, "bool", Arity.SINGLE, Code.IS_EMPTY, note, True)
            )
        return made

    def _answered(self, wire: str, declared: FieldInfo, member: Member) -> Field:
        kind = kind_of(declared)
        type_, code = self._carried(kind, member.type)
        arity = Arity.MANY if member.length == LIST else Arity.SINGLE
        note = " ".join((declared.description or "").split())
        if arity is Arity.SINGLE and kind.is_nullable:
            if type_ == "float64":
                note += "; NaN = none" if note else "NaN = none"
            elif code is not Code.JSON:
                arity = Arity.OPTIONAL
        name = _ros_name(wire) + ("_json" if code is Code.JSON else "")
        default = None
        if not declared.is_required():
            default = declared.get_default(call_default_factory=True)
        return Field(name, wire, type_, arity, code, note, False, default)

    def _carried(self, kind: Kind, type_: str) -> tuple[str, Code]:
        """Return the type of one value of a field, and how it is coded."""
        sent = carried(kind)
        if kind.message is not None:
            return self._record(kind.message), Code.RECORD
        if sent is not None and sent.is_packed:
            return "uint8", Code.BYTES
        if type_ == "time":
            return "std_msgs/Header", Code.HEADER
        if type_ == "geometry_msgs/Point":
            return type_, Code.POINTS
        if "/" in type_:
            return type_, Code.MESSAGE
        is_free = sent is None and typing.get_origin(kind.type) is dict
        return type_, Code.JSON if is_free else Code.VALUE

    def _record(self, model: type[BaseModel]) -> str:
        name = model.__name__
        earlier = self._models.setdefault(name, model)
        if earlier is not model:
            raise UsageError(f"two messages are called {PACKAGE}/{name}")
        if name not in self.schema.records:
            self.schema.records[name] = Record(name, _first_line(model), ())  # ends a recursion
            self.schema.records[name] = Record(name, _first_line(model), self.fields(model))
        return name


def _joined_header(fields: list[Field]) -> list[Field]:
    """Return fields with one header in the place of a frame and a time."""
    at = next((k for k, field in enumerate(fields) if field.code is Code.HEADER), None)
    if at is None:
        return fields
    frame = next((k for k, field in enumerate(fields) if field.wire == "frame_id"), None)
    words = f"time: {fields[at].note.partition(';')[0]}, zero = now"
    if frame is not None:
        words += f"; frame: {fields[frame].note}"
    header = Field("header", "stamp", "std_msgs/Header", Arity.SINGLE, Code.HEADER, words, True)
    place = at if frame is None else min(at, frame)
    remaining = [field for k, field in enumerate(fields) if k not in (at, frame)]
    return [*remaining[:place], header, *remaining[place:]]


def _ros_name(wire: str) -> str:
    name = RENAMED.get(wire, wire.lower())
    if keyword.iskeyword(name) or name in _CPP:
        raise UsageError(f"{name!r} is a word of Python or C++; add its name in ROS to RENAMED")
    if not _NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no name of a field in ROS: lower case, digits, single _")
    return name


def _first_line(model: type[BaseModel]) -> str:
    return (model.__doc__ or model.__name__).strip().partition("\n")[0]


def _note(declared: FieldInfo, kind: Kind, arity: Arity) -> str:
    """Return what a field of a request means, its unit, and what leaving it out means."""
    words = " ".join((declared.description or "").split())
    unit = next((marker.symbol for marker in kind.metadata if isinstance(marker, Unit)), "")
    words += f" ({unit})" if unit else ""
    left_out = absence(declared)
    if left_out and f"default: {left_out}" not in words:
        words += f"; default: {left_out}"
    words = words.replace("base64 of ", "").replace("base64 ", "")
    return words + ("; at most one" if arity is Arity.OPTIONAL else "")
