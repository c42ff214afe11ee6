"""Requests and answers as classes, and reading a request with errors that help.

A request refuses fields that it does not know. Typed ROS clients send every field, so null and
blank text in a field that may be left out count as left out.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from rtask.errors import UsageError, nearest

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

__all__ = ["Also", "Answer", "Kind", "Message", "kind_of", "named", "read", "wire_name"]

_SHOWN = 60
M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True)
class Also:
    """Another name under which a field may come."""

    name: str


class Message(BaseModel):
    """A request, or a part of one.

    The docstring of each field is its summary. A field with a default may be left out.

    Examples
    --------
    >>> class Move(Message):
    ...     '''Go somewhere.'''
    ...     x: float
    >>> read(Move, {"x": "0.5"}).x
    0.5
    >>> read(Move, {"y": 1})
    Traceback (most recent call last):
    rtask.errors.UsageError: unknown field 'y'; known: x
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        defer_build=True,
        arbitrary_types_allowed=True,
    )

    entries: ClassVar[str] = ""
    """Name of the list whose one entry may stand at top level in its place."""
    wire_names: ClassVar[Mapping[str, str]] = {}
    """Every name under which a field may come, and the field's own."""
    _optional: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        fields = cls.__pydantic_fields__
        cls.wire_names = {
            name: own
            for own, field in fields.items()
            for name in (
                own,
                *(one.name for one in kind_of(field).metadata if isinstance(one, Also)),
            )
        }
        cls._optional = frozenset(n for n, field in fields.items() if not field.is_required())

    @model_validator(mode="before")
    @classmethod
    def _given(cls, message: Any) -> Any:
        """Leave out what counts as left out, and put other names into the proper ones."""
        if not isinstance(message, dict):
            return message
        if cls.entries and message and cls.entries not in message:
            return {cls.entries: [message]}
        given = {}
        for key, value in message.items():
            name = cls.wire_names.get(key)
            if name is None:
                given[key] = value  # refused by its name
            elif value is not None and not (
                isinstance(value, str) and name in cls._optional and not value.strip()
            ):
                given[name] = value
        return given


class Answer(BaseModel):
    """What an operation gives back, or a part of it.

    Fields are read as attributes, or by their names in JSON as from a mapping. A field with a
    default is left out of JSON unless it was set.

    Examples
    --------
    >>> class Found(Answer):
    ...     '''An object.'''
    ...     class_: str = named("class")
    >>> found = Found(class_="cup")
    >>> found["class"], found.as_json()
    ('cup', {'class': 'cup'})
    """

    model_config = ConfigDict(
        frozen=True,
        use_attribute_docstrings=True,
        defer_build=True,
        arbitrary_types_allowed=True,
        validate_by_name=True,
        validate_by_alias=True,
    )

    def as_json(self) -> dict[str, Any]:
        """Return the answer as JSON carries it."""
        return self.model_dump(by_alias=True, exclude_unset=True)

    def keys(self) -> Iterator[str]:
        """Yield the names of the fields that are set, as in JSON."""
        fields = type(self).__pydantic_fields__
        return (wire_name(name, fields[name]) for name in fields if name in self.model_fields_set)

    def __getitem__(self, name: str) -> Any:
        for own, field in type(self).__pydantic_fields__.items():
            if wire_name(own, field) == name and own in self.model_fields_set:
                return getattr(self, own)
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return name in set(self.keys())

    def get(self, name: str, default: Any = None) -> Any:
        """Return a field by its name in JSON, or the default when it is not set."""
        try:
            return self[name]
        except KeyError:
            return default


def named(name: str) -> Any:
    """Return the declaration of a field whose name in JSON is no name in Python: ``class``."""
    return Field(validation_alias=name, serialization_alias=name)


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
    >>> class Cup(Message):
    ...     heights: list[float] | None = None
    >>> kind = kind_of(Cup.model_fields["heights"])
    >>> kind.type, kind.is_list, kind.is_nullable
    (<class 'float'>, True, True)
    """
    return _taken_apart(Kind(field.annotation, tuple(field.metadata)))


def _taken_apart(kind: Kind) -> Kind:
    origin, arguments = typing.get_origin(kind.type), typing.get_args(kind.type)
    if origin is Annotated:
        first, *more = arguments
        return _taken_apart(replace(kind, type=first, metadata=(*kind.metadata, *more)))
    if origin is list:
        return _taken_apart(replace(kind, type=arguments[0], is_list=True))
    if origin in (types.UnionType, typing.Union) and type(None) in arguments:
        present = [one for one in arguments if one is not type(None)]
        if len(present) == 1:
            return _taken_apart(replace(kind, type=present[0], is_nullable=True))
    return kind


# Errors


def read(model: type[M], message: Any, where: str = "") -> M:
    """Check a request and return it.

    Parameters
    ----------
    where
        Path of the message inside a larger one, ``objects[2].``.

    Raises
    ------
    UsageError
        Naming the field by its path, what came and what is wanted.
    """
    try:
        return model.model_validate(message)
    except ValidationError as error:
        found = error.errors(include_url=False)
    # A misspelt name explains more than the field that is missing because of it.
    unknown = (one for one in found if one["type"] == "extra_forbidden")
    first = min(unknown, key=lambda one: len(one["loc"]), default=found[0])
    path = where + _path(first["loc"])
    raise UsageError(_words(model, first, path), field=path)


def _path(places: tuple[int | str, ...]) -> str:
    parts = (f"[{one}]" if isinstance(one, int) else f".{one}" for one in places)
    return "".join(parts).removeprefix(".")


def _words(model: type[BaseModel], error: ErrorDetails, path: str) -> str:
    kind, places, value, context = error["type"], error["loc"], error["input"], error.get("ctx", {})
    if kind == "extra_forbidden":
        names = getattr(_message_at(model, places[:-1]), "wire_names", {})
        hint = nearest(str(places[-1]), list(names)) or f"; known: {', '.join(sorted(names))}"
        return f"unknown field {path!r}{hint}"
    if kind == "missing":
        owner = _message_at(model, places[:-1])
        return f"{path} is missing: {owner.model_fields[str(places[-1])].description}"
    if kind == "refused":
        return f"{path}: {context['words']}"
    if kind in _BOUNDS:
        name, side = _BOUNDS[kind]
        return f"{path}: {float(value):g} is {side} {context[name]:g}"
    if kind in _LENGTHS:
        name, side = _LENGTHS[kind]
        length = len(value) if isinstance(value, list | tuple) else context["actual_length"]
        return f"{path}: length {length} is {side} {context[name]}"
    if kind == "literal_error" and isinstance(value, str):
        known = [str(one) for one in _choices(model, places)]
        hint = nearest(value, known) or f"; one of {', '.join(known)}"
        return f"{path}: unknown value {value!r}{hint}"
    if kind == "model_type":
        return f"{path or 'the request'}: an object with fields is wanted"
    what = context["what"] if kind == "wanted" else _WANTED.get(kind, error["msg"])
    return f"{path}: {what} is wanted, got {_shown(value)}"


_BOUNDS = {"greater_than_equal": ("ge", "below"), "less_than_equal": ("le", "above")}
_LENGTHS = {"too_short": ("min_length", "below"), "too_long": ("max_length", "above")}
_WANTED = {"list_type": "a list", "dict_type": "an object with fields", "literal_error": "a text"}


def _shown(value: Any) -> str:
    shown = repr(value[:_SHOWN]) if isinstance(value, str | bytes | list) else repr(value)
    return shown if len(shown) <= _SHOWN else shown[: _SHOWN - 3] + "..."


def _kind_at(model: type[BaseModel], places: tuple[int | str, ...]) -> Kind:
    """Return the type of the field at a path; of the message itself at the empty path."""
    kind = Kind(model)
    for place in places:
        if isinstance(place, str) and kind.message is not None:
            kind = kind_of(kind.message.model_fields[place])
    return kind


def _message_at(model: type[BaseModel], places: tuple[int | str, ...]) -> type[BaseModel]:
    return _kind_at(model, places).message or model


def _choices(model: type[BaseModel], places: tuple[int | str, ...]) -> tuple[Any, ...]:
    return typing.get_args(_kind_at(model, places).type)
