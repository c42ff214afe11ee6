"""Forms of requests: the controls that a page shows for a declaration, and reading them back.

A control is named by the path of its field: ``outcome.success``, ``end_effectors.0.name``. What
is left blank is left out of the request.
"""

from __future__ import annotations

import json
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from annotated_types import Ge, Le
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rtask.errors import UsageError
from rtask.wire.fields import Kind, absence, kind_of
from rtask.wire.message import Message
from rtask.wire.types import ArrayOf, Unit, carried

__all__ = ["Control", "controls_of", "filled_form", "read_form"]

Filled = dict[str, str]
Sort = Literal["text", "number", "choice", "flag", "lines", "json", "file", "group"]


@dataclass(frozen=True)
class Control:
    """One control of a form, or a group of them.

    Parameters
    ----------
    name
        Path of the field.
    label
        Name of the field.
    meaning
        Its summary.
    absent
        What leaving it blank means; empty where it must be filled in.
    minimum, maximum, step
        Of a number.
    parts
        Controls of a group.
    adds_to
        Path of the list to which one more such group may be added, at its last group.
    """

    name: str
    label: str
    sort: Sort
    meaning: str
    absent: str = ""
    is_required: bool = False
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    step: str = "any"
    choices: tuple[str, ...] = ()
    parts: tuple[Control, ...] = ()
    adds_to: str = ""


def controls_of(
    model: type[Message], given: Iterable[str] = (), more: str = "", path: str = ""
) -> tuple[Control, ...]:
    """Return the controls for the fields of a request, in their order.

    Parameters
    ----------
    given
        Names of controls that were filled in before, which tell how many groups there are.
    more
        Path of a list that is to have one group more.
    path
        Path of the message in the request, with a dot at its end.

    Examples
    --------
    >>> class Cup(Message):
    ...     height: float
    ...     owner: str = "nobody"
    >>> [(one.name, one.sort, one.absent) for one in controls_of(Cup)]
    [('height', 'number', ''), ('owner', 'text', 'nobody')]
    """
    given = list(given)
    controls: list[Control] = []
    for name, field in model.model_fields.items():
        kind, place = kind_of(field), path + name
        part = kind.message
        if part is None:
            controls.append(_control(place, name, field, kind))
            continue
        assert issubclass(part, Message)
        places = [place]
        if kind.is_list:
            count = max(len(_entries(place, given)), 1) + (more == place)
            places = [f"{place}.{k}" for k in range(count)]
        for k, at in enumerate(places):
            group = Control(
                at, name if at == place else f"{name} {k + 1}", "group", _summary(field),
                absence(field), field.is_required() and k == 0,
                parts=controls_of(part, given, more, f"{at}."),
                adds_to=place if kind.is_list and at == places[-1] else "",
            )  # fmt: skip
            controls.append(group)
    return tuple(controls)


def _control(place: str, label: str, field: FieldInfo, kind: Kind) -> Control:
    bounds = {type(marker): marker for marker in kind.metadata if isinstance(marker, Ge | Le)}
    low, high = bounds.get(Ge), bounds.get(Le)
    unit = next((marker.symbol for marker in kind.metadata if isinstance(marker, Unit)), "")
    return Control(
        place, label, _sort(kind), _summary(field), absence(field), field.is_required(), unit,
        minimum=float(str(low.ge)) if isinstance(low, Ge) else None,
        maximum=float(str(high.le)) if isinstance(high, Le) else None,
        step="1" if kind.type is int else "any",
        choices=_choices(kind),
    )  # fmt: skip


def _choices(kind: Kind) -> tuple[str, ...]:
    if typing.get_origin(kind.type) is Literal:
        return tuple(str(choice) for choice in typing.get_args(kind.type))
    return ("true", "false") if kind.type is bool else ()


def _sort(kind: Kind) -> Sort:
    if kind.type is bytes:
        return "file"
    if kind.type in (int, float) and not kind.is_list:
        return "number"
    if kind.type is bool:
        return "flag"
    if typing.get_origin(kind.type) is Literal:
        return "choice"
    if kind.type is str:
        return "lines" if kind.is_list else "text"
    if any(isinstance(marker, ArrayOf) for marker in kind.metadata):
        return "json"
    sent = carried(kind)
    return "text" if sent is not None and sent.ros == "string" else "json"


def _summary(field: FieldInfo) -> str:
    return (field.description or "").partition("; default: ")[0]


def read_form(
    model: type[Message],
    given: Mapping[str, Sequence[str]],
    files: Mapping[str, bytes] | None = None,
    path: str = "",
) -> dict[str, Any]:
    """Return the request that a filled-in form means, without what is blank; not yet checked.

    Parameters
    ----------
    given
        All values of each control by its name; others are ignored.
    files
        Contents of the files by the names of their controls.

    Raises
    ------
    UsageError
        JSON that cannot be read.
    """
    files = files or {}
    request: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        kind, place = kind_of(field), path + name
        part = kind.message
        if part is not None:
            assert issubclass(part, Message)
            names = [*given, *files]
            places = _entries(place, names) if kind.is_list else [place]
            groups = [read_form(part, given, files, f"{at}.") for at in places]
            filled = [group for group in groups if group]
            if filled:
                request[name] = filled if kind.is_list else filled[0]
            continue
        values = [value for value in (text.strip() for text in given.get(place, ())) if value]
        if files.get(place):
            request[name] = files[place]
        elif values:
            request[name] = _value(_sort(kind), values, place)
    return request


def _value(sort: Sort, values: list[str], place: str) -> Any:
    if sort == "lines":
        lines = (line.strip() for value in values for line in value.splitlines())
        return [line for line in lines if line]
    text = values[0]
    if sort in ("number", "flag"):
        return _number(text)
    if sort != "json" and not (sort == "text" and text.startswith("{")):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise UsageError(f"{place}: not JSON that can be read", field=place) from None


def _number(text: str) -> Any:
    """Return a number or a flag that was typed; other text unchanged, to be refused in words."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def filled_form(model: type[BaseModel], request: Mapping[str, Any], path: str = "") -> Filled:
    """Return what the controls of a form hold for a request, the reverse of :func:`read_form`.

    Bytes are left out: the control of a file cannot be filled in.

    Examples
    --------
    >>> class Cup(Message):
    ...     height: float
    ...     marks: list[str] = []
    >>> filled_form(Cup, {"height": 0.1, "marks": ["a", "b"]})
    {'height': '0.1', 'marks': 'a\\nb'}
    """
    filled: Filled = {}
    for name, field in model.model_fields.items():
        kind, place, value = kind_of(field), path + name, request.get(name)
        if value is None or kind.type is bytes:
            continue
        if kind.message is not None:
            parts = value if kind.is_list and isinstance(value, list) else [value]
            for k, part in enumerate(parts):
                at = f"{place}.{k}." if kind.is_list else f"{place}."
                if isinstance(part, Mapping):
                    filled |= filled_form(kind.message, part, at)
        elif isinstance(value, str):
            filled[place] = value
        elif _sort(kind) == "lines" and isinstance(value, list):
            filled[place] = "\n".join(map(str, value))
        else:
            filled[place] = json.dumps(value, ensure_ascii=False)
    return filled


def _entries(place: str, names: Iterable[str]) -> list[str]:
    """Return the paths of the groups of a list, in order."""
    rest = (name[len(place) + 1 :].partition(".")[0] for name in names if name.startswith(place))
    numbers = sorted({int(index) for index in rest if index.isdecimal() and len(index) < 4})
    return [f"{place}.{number}" for number in numbers]
