"""Fields of messages: their types taken apart, their names in JSON, and what absence means."""

from __future__ import annotations

import json
import types
import typing
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rtask.wire.request_id import RequestId, StoredOnce

__all__ = ["Also", "Kind", "absence", "kind_of", "parts_of", "request_id_of", "wire_name"]


@dataclass(frozen=True)
class Also:
    """Another name under which a field may come."""

    name: str


def wire_name(name: str, field: FieldInfo) -> str:
    """Return the name of a field in JSON."""
    return field.serialization_alias or name


@dataclass(frozen=True)
class Kind:
    """The type of a field, taken apart.

    Parameters
    ----------
    type
        Without list, None and annotations.
    metadata
        All annotations.
    """

    type: Any
    metadata: tuple[Any, ...] = ()
    is_list: bool = False
    is_nullable: bool = False

    @property
    def message(self) -> type[BaseModel] | None:
        """The class of the message that a field holds, or lists."""
        is_message = isinstance(self.type, type) and issubclass(self.type, BaseModel)
        return self.type if is_message else None


def kind_of(field: FieldInfo) -> Kind:
    """Return the type of a field, taken apart.

    Examples
    --------
    >>> from rtask.wire.message import Message
    >>> class Cup(Message):
    ...     heights: list[float] | None = None
    >>> kind = kind_of(Cup.model_fields["heights"])
    >>> kind.type, kind.is_list, kind.is_nullable
    (<class 'float'>, True, True)
    """
    return _unwrapped(Kind(field.annotation, tuple(field.metadata)))


def _unwrapped(kind: Kind) -> Kind:
    origin, arguments = typing.get_origin(kind.type), typing.get_args(kind.type)
    if origin is Annotated:
        first, *more = arguments
        return _unwrapped(replace(kind, type=first, metadata=(*kind.metadata, *more)))
    if origin is list:
        return _unwrapped(replace(kind, type=arguments[0], is_list=True))
    if origin in (types.UnionType, typing.Union) and type(None) in arguments:
        present = [member for member in arguments if member is not type(None)]
        if len(present) == 1:
            return _unwrapped(replace(kind, type=present[0], is_nullable=True))
    return kind


def absence(field: FieldInfo) -> str:
    """Return in words what leaving a field out means; empty where it must be given.

    A default that is no value of its own is named at the end of the field's summary.

    Examples
    --------
    >>> from pydantic.fields import FieldInfo
    >>> absence(FieldInfo(annotation=float, default=0.1))
    '0.1'
    >>> absence(FieldInfo(annotation=str | None, default=None, description="who; default: nobody"))
    'nobody'
    """
    if field.is_required():
        return ""
    default = field.get_default(call_default_factory=True)
    if default == []:
        return "none"
    if default is not None:
        return default if isinstance(default, str) else json.dumps(default)
    return (field.description or "").partition("; default: ")[2]


def parts_of(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """Return the messages in a message by their names, the inner ones first, without itself."""
    parts: dict[str, type[BaseModel]] = {}
    for field in model.model_fields.values():
        part = kind_of(field).message
        if part is not None and part.__name__ not in parts:
            parts.update(parts_of(part))
            parts[part.__name__] = part
    return parts


@lru_cache(maxsize=256)
def request_id_of(model: type[BaseModel]) -> RequestId | None:
    """Return where a request carries its ids, or None if none of its fields is marked.

    Examples
    --------
    >>> from rtask.wire.message import Message
    >>> class Report(Message):
    ...     task_id: Annotated[str | None, StoredOnce()] = None
    >>> request_id_of(Report)
    RequestId(field='task_id', entries='', where=None)
    """
    for name, field in model.model_fields.items():
        kind = kind_of(field)
        for marker in kind.metadata:
            if isinstance(marker, StoredOnce):
                return RequestId(wire_name(name, field), where=marker.where)
        if kind.message is not None and name == getattr(model, "entries", ""):
            inner = request_id_of(kind.message)
            return None if inner is None else replace(inner, entries=wire_name(name, field))
    return None
