"""The methods of a typed client, as Python source made from declarations.

Requests become keyword arguments with a documented meaning each, their parts and the answers
become typed dictionaries: what a program gets is JSON, and needs no package to be read.
"""

from __future__ import annotations

import keyword
import textwrap
import typing
from collections.abc import Iterable, Iterator
from typing import Literal, Protocol

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rtask.wire.fields import Also, Kind, kind_of, parts_of, request_id_of, wire_name
from rtask.wire.message import Answer, Message
from rtask.wire.types import Unit, carried

__all__ = ["Declared", "source_of"]

_WIDTH = 100
_HEAD = '''"""The operations of the engine as methods; made by ``python -m {maker}``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, Required, TypedDict

from rtask.wire.request_id import RequestId

__all__ = [
{names}
]

Bytes = str | bytes
"""Base64 text, or the bytes themselves."""

REPEATABLE = frozenset(
    (
{repeatable}
    )
)
"""Operations whose request may be sent again: it changes nothing, or is stored once."""

DEFERRABLE = frozenset(
    (
{deferrable}
    )
)
"""Operations whose answer a robot need not wait for: an outbox keeps them until they arrive."""

REQUEST_IDS: Mapping[str, RequestId] = {{
{request_ids}
}}
"""Where requests carry the ids by which they are stored once, by operation."""
'''
_TABLES = ("DEFERRABLE", "REPEATABLE", "REQUEST_IDS")
_CLASS = '''class Calls(ABC):
    """One method for each operation; what is left out, or None, is not sent."""

    @abstractmethod
    def _operate(self, operation: str, given: dict[str, Any]) -> Any:
        """Carry out an operation with the local variables of its method."""
'''


class Declared(Protocol):
    """The part of an operation that the generated client needs."""

    @property
    def name(self) -> str:
        """As on the wire."""

    @property
    def summary(self) -> str:
        """One line, without a capital or a full stop."""

    @property
    def request(self) -> type[Message]:
        """Its request."""

    @property
    def answer(self) -> type[Answer]:
        """Its answer."""

    @property
    def repeatable(self) -> bool:
        """Whether a request that arrives twice has the effect of one."""

    @property
    def deferrable(self) -> bool:
        """Whether a robot may work on without the answer."""


def source_of(operations: Iterable[Declared], maker: str) -> str:
    """Return the source of a module with the methods of all operations.

    Parameters
    ----------
    maker
        Module that makes the file, for its first line.
    """
    operations = list(operations)
    held: dict[str, type[BaseModel]] = {}
    for operation in operations:
        held.update(parts_of(operation.request))
    for operation in operations:
        held.update({**parts_of(operation.answer), operation.answer.__name__: operation.answer})
    names = "\n".join(f'    "{name}",' for name in [*_TABLES, *sorted([*held, "Calls"])])
    head = _HEAD.format(
        maker=maker,
        names=names,
        repeatable=_listed(operation.name for operation in operations if operation.repeatable),
        deferrable=_listed(operation.name for operation in operations if operation.deferrable),
        request_ids="\n".join(_request_ids(operations)),
    )
    parts = [head]
    parts += [_typed_dict(model) for model in held.values()]
    methods = [_CLASS, *(_method(operation) for operation in operations)]
    return "\n\n".join([*parts, "\n".join(methods)])


def _listed(names: Iterable[str]) -> str:
    return "\n".join(f"        {_quoted(name)}," for name in names)


def _request_ids(operations: Iterable[Declared]) -> Iterator[str]:
    """Yield a line for each operation whose request carries ids."""
    for operation in operations:
        ids = request_id_of(operation.request)
        if ids is None:
            continue
        arguments = [_quoted(ids.field)]
        arguments += [f"entries={_quoted(ids.entries)}"] if ids.entries else []
        if ids.where is not None:
            arguments.append(f"where=({', '.join(_quoted(part) for part in ids.where)})")
        yield f"    {_quoted(operation.name)}: RequestId({', '.join(arguments)}),"


def _type(kind: Kind) -> str:
    """Return the type of a field as source."""
    sent = carried(kind)
    if sent is not None:
        text = sent.python
    elif kind.message is not None:
        text = kind.message.__name__
        text += " | Mapping[str, Any]" if issubclass(kind.message, Message) else ""
    elif typing.get_origin(kind.type) is Literal:
        text = f"Literal[{', '.join(_quoted(choice) for choice in typing.get_args(kind.type))}]"
    elif typing.get_origin(kind.type) is dict:
        key, value = typing.get_args(kind.type)
        text = f"dict[{key.__name__}, {'Any' if value is typing.Any else value.__name__}]"
    else:
        text = kind.type.__name__
    if kind.is_list and not (sent and sent.is_list):
        is_answer = kind.message is None or issubclass(kind.message, Answer)
        text = f"{'list' if is_answer else 'Sequence'}[{text}]"
    return text


def _quoted(text: object) -> str:
    return f'"{text}"'


def _words(field: FieldInfo, model: type[BaseModel]) -> str:
    """Return what a field means, with its unit and default."""
    kind = kind_of(field)
    unit = next((marker.symbol for marker in kind.metadata if isinstance(marker, Unit)), "")
    words = (field.description or "") + (f" ({unit})" if unit else "")
    default = field.default
    if not field.is_required() and isinstance(default, str | int | float):
        words += f"; default: {default}"
    return words


def _typed_dict(model: type[BaseModel]) -> str:
    is_request = issubclass(model, Message)
    fields = [(wire_name(own, field), own, field) for own, field in model.model_fields.items()]
    if any(keyword.iskeyword(name) for name, _, _ in fields):
        rows = [f'        "{name}": {_answer_type(field)},' for name, _, field in fields]
        lines = [
            f"{model.__name__} = TypedDict(", f'    "{model.__name__}",', "    {", *rows, "    },",
            ")", *_docstring(model.__doc__ or "", 0),
        ]  # fmt: skip
        return "\n".join([*lines, ""])
    total = ", total=False" if is_request else ""
    lines = [f"class {model.__name__}(TypedDict{total}):", *_docstring(model.__doc__ or "", 4), ""]
    for name, own, field in fields:
        text = _request_type(field, own, model) if is_request else _answer_type(field)
        lines.append(f"    {name}: {text}")
        if is_request:
            lines += _docstring(_words(field, model), 4)
            lines += [f"    {other}: {_type(kind_of(field))}" for other in _others(field)]
    return "\n".join([*lines, ""])


def _request_type(field: FieldInfo, name: str, model: type[BaseModel]) -> str:
    text = _type(kind_of(field))
    return f"Required[{text}]" if field.is_required() and not _others(field) else text


def _answer_type(field: FieldInfo) -> str:
    kind = kind_of(field)
    text = _type(kind) + (" | None" if kind.is_nullable else "")
    return text if field.is_required() else f"NotRequired[{text}]"


def _others(field: FieldInfo) -> list[str]:
    return [marker.name for marker in kind_of(field).metadata if isinstance(marker, Also)]


def _method(declared: Declared) -> str:
    whole = declared.request
    fields = [(name, field, whole) for name, field in whole.model_fields.items()]
    if whole.entries:
        entry = kind_of(whole.model_fields[whole.entries]).message
        assert entry is not None
        fields += [(name, field, entry) for name, field in entry.model_fields.items()]
    parameters, meanings = [], []
    for name, field, model in fields:
        text, others = _type(kind_of(field)), _others(field)
        is_needed = field.is_required() and not others and not whole.entries
        for parameter in (name, *others):
            parameters.append(f"{parameter}: {text}" + ("" if is_needed else " | None = None"))
        meanings += [", ".join((name, *others)), *_wrapped(_words(field, model), 4)]
    lines = [
        f"    def {declared.name}(",
        *(_parameter(row) for row in ("self", "*", *parameters)),
        f"    ) -> {declared.answer.__name__}:",
        f'        """{declared.summary[0].upper()}{declared.summary[1:]}.',
        "",
        *(f"        {row}".rstrip() for row in ("Parameters", "----------", *meanings)),
        '        """',
        f'        answer: {declared.answer.__name__} = self._operate("{declared.name}", locals())',
        "        return answer",
        "",
    ]
    return "\n".join(lines)


def _parameter(row: str) -> str:
    """Return a parameter's line; in one that is too long the type's brackets are broken."""
    line = f"        {row},"
    if len(line) <= _WIDTH:
        return line
    head, _, rest = row.partition("[")
    inside, _, tail = rest.rpartition("]")
    rows = [inside] if 12 + len(inside) <= _WIDTH else [f"{part}," for part in inside.split(", ")]
    return "\n".join([f"        {head}[", *(" " * 12 + part for part in rows), f"        ]{tail},"])


def _wrapped(text: str, indent: int) -> list[str]:
    return [
        " " * indent + line for line in textwrap.wrap(" ".join(text.split()), _WIDTH - 8 - indent)
    ]


def _docstring(text: str, indent: int) -> list[str]:
    space = " " * indent
    lines = textwrap.wrap(" ".join(text.split()), _WIDTH - indent - 6)
    if len(lines) < 2:
        return [f'{space}"""{"".join(lines)}"""']
    return [f'{space}"""{lines[0]}', *(space + line for line in lines[1:]), f'{space}"""']
