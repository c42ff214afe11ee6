"""Requests and answers as classes, and reading a request with errors that help.

A request refuses fields that it does not know. Typed ROS clients send every field, so null and
blank text in a field that may be left out count as left out.
"""

from __future__ import annotations

import json
import typing
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticSerializationError, to_json

from rtask.errors import UsageError, nearest
from rtask.wire.fields import Also, Kind, kind_of, wire_name
from rtask.wire.types import Unit, carried

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

__all__ = ["Answer", "Message", "named", "read", "strict_json"]

_SHOWN = 60
M = TypeVar("M", bound=BaseModel)


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
    at_most_one: ClassVar[frozenset[str]] = frozenset()
    """Names of the fields that may also come as a list of one value, or of none when left out.

    Typed ROS messages send every field, and zero is a legal value of most numbers, false of every
    flag: what was left out must not arrive as one of these.
    """
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
                *(marker.name for marker in kind_of(field).metadata if isinstance(marker, Also)),
            )
        }
        cls._optional = frozenset(n for n, field in fields.items() if not field.is_required())
        cls.at_most_one = frozenset(n for n, field in fields.items() if _is_ambiguous(field))

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
            if name in cls.at_most_one and isinstance(value, list) and len(value) < 2:
                value = value[0] if value else None
            if name is None:
                given[key] = value  # refused by its name
            elif value is not None and not (
                isinstance(value, str) and name in cls._optional and not value.strip()
            ):
                given[name] = value
        return given


class Answer(BaseModel):
    """The answer of an operation, or a part of it.

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
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        defer_build=True,
        arbitrary_types_allowed=True,
        validate_by_name=True,
        validate_by_alias=True,
        allow_inf_nan=False,
        ser_json_inf_nan="constants",
        # Clients must not refuse the fields of a later release.
        json_schema_extra=lambda schema: schema.pop("additionalProperties", None),
    )

    _by_wire_name: ClassVar[Mapping[str, str]] = {}
    """Own name of each field by its name in JSON."""

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        fields = cls.__pydantic_fields__
        cls._by_wire_name = {wire_name(own, field): own for own, field in fields.items()}

    def as_json(self) -> dict[str, Any]:
        """Return the answer as an object of JSON."""
        return self.model_dump(by_alias=True, exclude_unset=True)

    def to_json(self) -> bytes:
        """Return the answer as JSON text.

        Raises
        ------
        ValueError
            A number in free JSON is not finite.
        """
        try:
            text = self.model_dump_json(by_alias=True, exclude_unset=True)
        except PydanticSerializationError:
            return strict_json(self.as_json())
        return _finite(text.encode(), self.as_json)

    def keys(self) -> list[str]:
        """Return the names of the fields that are set, as in JSON."""
        return [name for name, own in self._by_wire_name.items() if own in self.model_fields_set]

    def __getitem__(self, name: str) -> Any:
        own = self._by_wire_name.get(name, "")
        if own not in self.model_fields_set:
            raise KeyError(name)
        return getattr(self, own)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Mapping):
            return self.as_json() == other
        return super().__eq__(other)

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


def strict_json(value: Any) -> bytes:
    """Return a value as JSON text without spaces.

    Raises
    ------
    ValueError
        A number is not finite; browsers could not read it.

    Examples
    --------
    >>> strict_json({"a": [1, 0.5, None, "\u00e9"]}).decode()
    '{"a":[1,0.5,null,"\u00e9"]}'
    """
    try:
        text = to_json(value, inf_nan_mode="constants")
    except PydanticSerializationError:  # half of a surrogate pair, which JSON can escape
        return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
    return _finite(text, lambda: value)


def _finite(text: bytes, value: Callable[[], Any]) -> bytes:
    """Return JSON text after making sure that its numbers are finite."""
    if b"NaN" in text or b"Infinity" in text:  # perhaps only as words
        json.dumps(value(), allow_nan=False)
    return text


def _is_ambiguous(field: FieldInfo) -> bool:
    """Tell whether the zero of a field's ROS type is a legal value and not the default."""
    kind = kind_of(field)
    sent = carried(kind)
    if kind.is_list or (sent is not None and sent.is_list):
        return False
    if field.is_required():
        return kind.type is bool
    if kind.type in (bool, int, float) and sent is None:
        return bool(field.default) or field.default is None
    return kind.message is not None or (sent is not None and sent.ros != "string")


def read(model: type[M], message: Any, where: str = "") -> M:
    """Check a request and return it.

    Parameters
    ----------
    where
        Path of the message inside a larger one, ``objects[2].``.

    Raises
    ------
    UsageError
        Naming the field by its path, what came and what was expected.
    """
    try:
        return model.model_validate(message)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    # A misspelt name explains more than the field that is missing because of it.
    unknown = (error_ for error_ in errors if error_["type"] == "extra_forbidden")
    first = min(unknown, key=lambda error_: len(error_["loc"]), default=errors[0])
    path = where + _path(first["loc"])
    raise UsageError(_words(model, first, path), field=path)


def _path(places: tuple[int | str, ...]) -> str:
    parts = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in places)
    return "".join(parts).removeprefix(".")


def _words(model: type[BaseModel], error: ErrorDetails, path: str) -> str:
    kind, places, value, context = error["type"], error["loc"], error["input"], error.get("ctx", {})
    if kind == "extra_forbidden":
        names = getattr(_message_at(model, places[:-1]), "wire_names", {})
        hint = nearest(str(places[-1]), list(names)) or f"; known: {', '.join(sorted(names))}"
        return f"unknown field {path!r}{hint}"
    if kind == "missing":
        owner = _message_at(model, places[:-1])
        meaning = owner.model_fields[str(places[-1])].description
        if not meaning or meaning.casefold() == str(places[-1]).replace("_", " ").casefold():
            return f"{path} is missing"
        return f"{path} is missing: {meaning}"
    if kind == "refused":
        return f"{path}: {context['words']}"
    if kind in _BOUNDS:
        name, side = _BOUNDS[kind]
        return f"{path}: {float(value):g} is {side} {context[name]:g}{_unit(model, places)}"
    if kind in _LENGTHS:
        name, side = _LENGTHS[kind]
        length = len(value) if isinstance(value, list | tuple) else context["actual_length"]
        return f"{path}: length {length} is {side} {context[name]}"
    if kind == "literal_error" and isinstance(value, str):
        choices = [str(choice) for choice in _choices(model, places)]
        hint = nearest(value, choices) or f"; one of {', '.join(choices)}"
        return f"{path}: unknown value {value!r}{hint}"
    if kind == "model_type":
        return f"{path or 'the request'}: expected an object with fields"
    what = context["what"] if kind == "expected" else _EXPECTED.get(kind, error["msg"])
    return f"{path}: expected {what}, got {_shown(value)}"


def _unit(model: type[BaseModel], places: tuple[int | str, ...]) -> str:
    """Return the unit of a field behind a blank: who sent mm learns that m were expected."""
    symbols = [m.symbol for m in _kind_at(model, places).metadata if isinstance(m, Unit)]
    return f" {symbols[0]}" if symbols else ""


_BOUNDS = {
    "greater_than_equal": ("ge", "below"), "less_than_equal": ("le", "above"),
    "greater_than": ("gt", "not above"), "less_than": ("lt", "not below"),
}  # fmt: skip
_LENGTHS = {"too_short": ("min_length", "below"), "too_long": ("max_length", "above")}
_EXPECTED = {"list_type": "a list", "dict_type": "an object with fields", "literal_error": "a text"}


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
