"""ROS types of messages, by the rules of ``.msg`` files.

What has no ROS type of its own, such as free JSON and bytes, travels as ``string``. Typed messages
carry every field: where zero would be a legal value, a field of a request that may be left out is a
list of one value or none.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from pydantic import BaseModel

from rtask.wire.fields import Kind, kind_of, wire_name
from rtask.wire.message import Answer, Message
from rtask.wire.types import carried

__all__ = ["CHANGE", "LIST", "SCALAR", "Member", "camel_case", "declared_types", "ros_types"]

SCALAR, LIST = -1, 0

_PYTHON = {str: "string", float: "float64", int: "int64", bool: "bool"}
_JSON = "string"


class Member(NamedTuple):
    """One field of a ROS message; ``length`` is :data:`SCALAR` or :data:`LIST`."""

    name: str
    type: str
    length: int

    def __str__(self) -> str:
        return self.type + ("[]" if self.length == LIST else "")


CHANGE = (
    Member("commit", "int64", SCALAR), Member("agent", "string", SCALAR),
    Member("graphs", "string", LIST), Member("added", "int64", SCALAR),
    Member("removed", "int64", SCALAR), Member("derived", "int64", SCALAR),
)  # fmt: skip
"""The fields of a commit in the message to its subscribers."""


def camel_case(operation: str) -> str:
    """Return the name of an operation's ROS type without the package.

    >>> camel_case("recognise_for_grasp")
    'RecogniseForGrasp'
    """
    return "".join(part.capitalize() for part in re.split(r"[_\W]+", operation))


def ros_types(name: str, model: type[BaseModel]) -> dict[str, list[Member]]:
    """Return the fields of a message and of all messages in it, by the name of the ROS type.

    Parameters
    ----------
    name
        ROS name of the message itself, which comes first.

    Examples
    --------
    >>> from rtask.wire.message import Message
    >>> class Cup(Message):
    ...     heights: list[float]
    >>> ros_types("rtask/Cup", Cup)
    {'rtask/Cup': [Member(name='heights', type='float64', length=0)]}
    """
    members: dict[str, list[Member]] = {}
    _add(name, model, members)
    return members


def declared_types(model: type[Message]) -> dict[str, str]:
    """Return the type of each field of a request by its own name, as it is declared.

    A field that may be left out is a list in a typed ROS message, and none for other callers.

    Examples
    --------
    >>> class Jar(Message):
    ...     heights: list[float]
    ...     width: float = 0.1
    >>> declared_types(Jar)
    {'heights': 'float64[]', 'width': 'float64'}
    """
    members = ros_types("request", model)["request"]
    return {
        own: member.type if own in model.at_most_one else str(member)
        for own, member in zip(model.model_fields, members, strict=True)
    }


def _add(name: str, model: type[BaseModel], types: dict[str, list[Member]]) -> None:
    members = types[name] = []
    for own, field in model.model_fields.items():
        kind = kind_of(field)
        of, is_list = ("", kind.is_list) if kind.message else _carried(kind)
        if kind.message is not None:
            of = _held(name, own, kind.message)
            if of not in types:
                _add(of, kind.message, types)
        if issubclass(model, Message) and own in model.at_most_one:
            is_list = True
        members.append(Member(wire_name(own, field), of, LIST if is_list else SCALAR))


def _held(name: str, field: str, model: type[BaseModel]) -> str:
    """Return the ROS name of a part: its class in answers, its path in requests."""
    if issubclass(model, Answer):
        return f"rtask/{model.__name__}"
    return name + "".join(part.capitalize() for part in field.split("_"))


def _carried(kind: Kind) -> tuple[str, bool]:
    """Return the ROS type of a value that is no message, and whether it is a list."""
    carried_type = carried(kind)
    if carried_type is not None:
        return carried_type.ros, carried_type.is_list or kind.is_list
    is_text = not isinstance(kind.type, type)
    return _JSON if is_text else _PYTHON.get(kind.type, _JSON), kind.is_list
