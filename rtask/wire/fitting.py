"""Type checks between the outputs of one step and the inputs of the next.

Where two declarations say too little to tell, a value fits; the request is checked again when it
is sent.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import BaseModel

from rtask.wire.fields import Kind, kind_of, wire_name
from rtask.wire.types import ArrayOf, Unit, carried

__all__ = ["entry_of", "kind_at", "misfit", "places_in", "words_for"]

MAX_DEPTH = 3
_MEDIA = "contentMediaType"
_NAMES: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "true or false", str: "a text",
    bytes: "bytes", dict: "an object of JSON", np.ndarray: "a list of numbers",
}  # fmt: skip


def misfit(source: Kind, target: Kind) -> str:
    """Return why a value of one kind cannot stand for a field of another; empty if it can.

    Examples
    --------
    >>> from typing import Annotated
    >>> from rtask.wire.types import Cloud, Number
    >>> length = Kind(float, (Unit("m"),))
    >>> misfit(length, Kind(float, (Unit("rad"),)))
    'a number in m is not a number in rad'
    >>> misfit(length, Kind(float))
    ''
    """
    if _fits(source, target):
        return ""
    return f"{words_for(source)} is not {words_for(target)}"


def words_for(kind: Kind) -> str:
    """Say in words what a value of a kind is.

    Examples
    --------
    >>> words_for(Kind(float, (Unit("m"),), is_list=True))
    'a list of: a number in m'
    """
    if kind.is_list and kind.type is not str:
        return f"a list of: {words_for(entry_of(kind))}"
    unit = _unit(kind)
    return _name(kind) + (f" in {unit}" if unit else "")


def entry_of(kind: Kind) -> Kind:
    """Return the kind of one entry of a list."""
    return replace(kind, is_list=False)


def kind_at(root: Kind, path: str) -> Kind | None:
    """Return the kind of what is at a path in a value; None where no declaration says it.

    Parameters
    ----------
    path
        Names as in JSON and numbers of entries, separated by dots: ``objects.0.cloud``; empty for
        the value itself.

    Examples
    --------
    >>> from rtask.wire.message import Answer
    >>> class Cups(Answer):
    ...     heights: list[float]
    >>> kind_at(Kind(Cups), "heights.0").type, kind_at(Kind(Cups), "heights.first")
    (<class 'float'>, None)
    """
    kind: Kind | None = root
    for part in path.split(".") if path else ():
        if kind is None:
            return None
        if kind.is_list:
            kind = entry_of(kind) if part.isdecimal() else None
        else:
            kind = dict(_members(kind.message)).get(part) if kind.message else None
    return kind


def places_in(root: Kind, path: str, depth: int = MAX_DEPTH) -> Iterator[tuple[str, Kind]]:
    """Yield each path in a value with its kind; of a list, the list and its first entry.

    Parameters
    ----------
    path
        Of the value itself.
    depth
        Of messages in messages.
    """
    yield path, root
    if root.is_list:
        yield from places_in(entry_of(root), f"{path}.0", depth)
    elif depth > 0:
        for name, kind in _members(root.message):
            yield from places_in(kind, f"{path}.{name}", depth - 1)


def _members(model: type[BaseModel] | None) -> Iterator[tuple[str, Kind]]:
    for own, field in (model.model_fields if model else {}).items():
        yield wire_name(own, field), kind_of(field)


def _fits(source: Kind, target: Kind) -> bool:
    if target.type is Any or source.type is Any:
        return True
    if source.is_list != target.is_list:
        return False
    units = _unit(source), _unit(target)
    if all(units) and units[0] != units[1]:
        return False
    if source.message or target.message:
        return _takes_message(source, target)
    if typing.get_origin(target.type) is types.UnionType:
        return _plain(source.type) in (str, dict)
    ours, theirs = _plain(source.type), _plain(target.type)
    if typing.get_origin(target.type) is typing.Literal:
        offered = set(typing.get_args(source.type))
        return bool(offered) and offered <= set(typing.get_args(target.type))
    if (ours, theirs) == (int, float):
        return True
    return ours == theirs and _same_form(source, target)


def _takes_message(source: Kind, target: Kind) -> bool:
    """Tell whether one of two kinds, of which one at least is a message, fits the other."""
    if target.message is None:  # free JSON, or a text or JSON
        return dict in (_plain(target.type), *map(_plain, typing.get_args(target.type)))
    if source.message is None:
        return _plain(source.type) is dict
    if source.message is target.message:
        return True
    offered = dict(_members(source.message))
    fields = target.message.model_fields
    return set(offered) <= set(fields) and all(
        name in offered and _fits(offered[name], kind_of(field))
        for name, field in fields.items()
        if field.is_required() or name in offered
    )


def _same_form(source: Kind, target: Kind) -> bool:
    """Tell whether two values of the same Python type are sent in forms that agree."""
    if target.type is bytes:
        media = _media(source), _media(target)
        return not all(media) or media[0] == media[1]
    ours, theirs = carried(source), carried(target)
    if ours is not None and theirs is not None and ours.ros != theirs.ros:
        return False
    return _columns(source) == _columns(target)


def _plain(kind: Any) -> Any:
    """Return the Python type of a value, without what it is made of."""
    origin = typing.get_origin(kind)
    if origin is typing.Literal:
        return type(typing.get_args(kind)[0])
    return origin or kind


def _unit(kind: Kind) -> str:
    named = (marker.symbol if isinstance(marker, Unit) else marker.unit
             for marker in kind.metadata if isinstance(marker, Unit | ArrayOf))  # fmt: skip
    return next((unit for unit in named if unit), "")


def _columns(kind: Kind) -> int | None:
    return next((marker.columns for marker in kind.metadata if isinstance(marker, ArrayOf)), None)


def _media(kind: Kind) -> str:
    form = carried(kind)
    return str((form.schema or {}).get(_MEDIA, "")) if form else ""


def _name(kind: Kind) -> str:
    if kind.message is not None:
        return f"a {kind.message.__name__}"
    columns = _columns(kind)
    if columns is not None:
        return f"rows of {columns} numbers"
    form = carried(kind)
    if form is not None and "/" in form.ros:
        return f"a {form.ros}"
    if kind.type is bytes and _media(kind):
        return "a cloud" if _media(kind).endswith("cloud") else "a picture"
    if typing.get_origin(kind.type) is typing.Literal:
        return f"one of {', '.join(map(str, typing.get_args(kind.type)))}"
    if kind.is_list and kind.type is str:
        return "a list of texts"
    return _NAMES.get(_plain(kind.type), "a value")
