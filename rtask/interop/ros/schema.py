"""Services and messages of the ROS package ``rtask_msgs``, as data.

A typed message carries every field, so a field that may be left out must have a form that says so.
In requests blank text and empty bytes count as left out. A number, flag or record that may be left
out is a list of one value or none, unless its zero is the default. In answers a missing number is
NaN, and anything else that may be missing is a list of one or none. Free JSON travels as text in a
field whose name ends in ``_json``.

The schema is made from declarations elsewhere. As JSON it goes with the node for ROS 2, which knows
no declarations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

__all__ = ["PACKAGE", "REFUSED", "Arity", "Code", "Field", "Record", "Schema", "Service"]

PACKAGE = "rtask_msgs"
REFUSED = "refused"
"""Field of each answer with the text of an error; services of ROS 2 have no exceptions."""


class Arity(Enum):
    """Number of values that a field of a ROS message carries."""

    SINGLE = ""
    MANY = "[]"
    OPTIONAL = "[]", "at most one"

    @property
    def suffix(self) -> str:
        """The brackets after the type."""
        return "" if self is Arity.SINGLE else "[]"


class Code(Enum):
    """Encoding of a field's value in JSON."""

    VALUE = "as it is"
    JSON = "an object, in ROS its text"
    BYTES = "base64, in ROS bytes"
    RECORD = "an object with the fields of a record of this package"
    MESSAGE = "an object with the fields of another package's message"
    POINTS = "rows of three numbers, in ROS geometry_msgs/Point"
    HEADER = "stamp and frame_id, in ROS std_msgs/Header"
    IS_EMPTY = "an empty list, in ROS a flag"


@dataclass(frozen=True)
class Field:
    """One field of a ROS message.

    Parameters
    ----------
    name
        In ROS.
    wire
        In JSON. Two fields of a record may be two forms of one.
    type
        ROS type of one value.
    default
        Value of an answer in which the field is not set; None = none.
    """

    name: str
    wire: str
    type: str
    arity: Arity = Arity.SINGLE
    code: Code = Code.VALUE
    note: str = ""
    is_optional: bool = False
    default: Any = None

    @property
    def line(self) -> str:
        """The field in a ``.msg`` file."""
        note = f"  # {self.note}" if self.note else ""
        return f"{self.type}{self.arity.suffix} {self.name}{note}"


@dataclass(frozen=True)
class Record:
    """The fields of a message, or of one half of a service."""

    name: str
    note: str
    fields: tuple[Field, ...]

    @property
    def text(self) -> str:
        """Lines of the message's definition."""
        return "".join(f"{line}\n" for line in (f"# {self.note}", *(f.line for f in self.fields)))


@dataclass(frozen=True)
class Service:
    """The two halves of a service and its name as a ROS type, ``RecogniseForGrasp``."""

    name: str
    request: Record
    answer: Record

    @property
    def text(self) -> str:
        """The ``.srv`` file."""
        refused = f"string {REFUSED}  # why the operation was not carried out; empty: it was\n"
        return f"{self.request.text}---\n{self.answer.text}{refused}"


@dataclass
class Schema:
    """All services of declared operations and the messages in them.

    Parameters
    ----------
    services
        By the name of the operation.
    records
        By the name of the message without its package.
    """

    services: dict[str, Service] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the schema as an object of JSON, which :meth:`from_json` reads."""
        return {
            "services": {
                name: {
                    "name": service.name,
                    "request": _record_json(service.request),
                    "answer": _record_json(service.answer),
                }
                for name, service in self.services.items()
            },
            "records": {name: _record_json(record) for name, record in self.records.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Schema:
        """Return the schema that :meth:`as_json` wrote."""
        return cls(
            {
                name: Service(
                    service["name"], _record_of(service["request"]), _record_of(service["answer"])
                )
                for name, service in data["services"].items()
            },
            {name: _record_of(record) for name, record in data["records"].items()},
        )


def _record_json(record: Record) -> dict[str, Any]:
    fields = [
        {**vars(field), "arity": field.arity.name, "code": field.code.name}
        for field in record.fields
    ]
    return {"name": record.name, "note": record.note, "fields": fields}


def _record_of(data: Mapping[str, Any]) -> Record:
    fields = [
        Field(**{**field, "arity": Arity[field["arity"]], "code": Code[field["code"]]})
        for field in data["fields"]
    ]
    return Record(data["name"], data["note"], tuple(fields))
