"""Definitions of services that live in workers, made from what the workers say of them.

A worker may be written in any language: it describes its methods by JSON Schema, and from that
follow the same classes of request and answer as from the annotations of a Python service.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import Field, create_model

from rtask.errors import UsageError
from rtask.services.definition import Definition, Method, check_name
from rtask.services.description import described
from rtask.services.service import ResourceNeed
from rtask.wire.effect import EFFECTS, Effect
from rtask.wire.message import Answer, Message
from rtask.wire.types import Array, Bytes, Cloud, Flag, Image, Json, Number, Pose, Text, Unit, Whole

__all__ = ["announced", "contract", "contract_of"]

MAX_METHODS = 100
MAX_CHARACTERS = 1 << 20
MAX_WAITING = 10_000
_SCOPES = ("read", "write", "teach")
_NO_DOCS = {"use_attribute_docstrings": False}


def contract_of(definition: Definition) -> str:
    """Return what workers of one version must agree on, as text to be compared."""
    return contract(described(definition, [], ""))


def contract(description: Mapping[str, Any]) -> str:
    """Return requests, answers and data of a description as text to be compared."""
    methods = {
        name: [_names(entry.get("request")), _names(entry.get("answer"))]
        for name, entry in description["methods"].items()
    }
    needs = {
        name: [entry.get("type", "binary"), bool(entry.get("writable"))]
        for name, entry in (description.get("resources") or {}).items()
    }
    return json.dumps([methods, needs], sort_keys=True)


def announced(description: Any) -> Definition:
    """Return the definition of a service that a worker describes.

    Parameters
    ----------
    description
        As ``GET /services/<ns>/<name>`` returns it. Needed are ``name``, ``version`` and
        ``methods``, of which each has ``request`` and ``answer``, JSON Schemas of objects.

    Raises
    ------
    UsageError
        With the place in the description.
    """
    if not isinstance(description, dict):
        raise UsageError("description: expected an object")
    if len(json.dumps(description)) > MAX_CHARACTERS:
        raise UsageError(f"description: more than {MAX_CHARACTERS} characters")
    name, version = _text(description, "name"), _text(description, "version")
    check_name(name, version)
    methods = description.get("methods")
    if not isinstance(methods, dict) or not 0 < len(methods) <= MAX_METHODS:
        raise UsageError(f"description.methods: expected an object of 1 to {MAX_METHODS} methods")
    stem = "".join(part[:1].upper() + part[1:] for part in name.split("/"))
    return Definition(
        name, version, _text(description, "summary", name), _text(description, "description", ""),
        {own: _checked(stem, own, method) for own, method in methods.items()},
        _needs(description.get("resources") or {}), _not_here, "outward",
        max_waiting=_waiting(description), timeout_s=_seconds(description),
    )  # fmt: skip


def _checked(stem: str, name: str, given: Any) -> Method:
    """Return a method; JSON Schema has more mistakes than can be named one by one."""
    try:
        return _method(stem, name, given)
    except (TypeError, ValueError, AttributeError, KeyError) as error:
        raise UsageError(f"description.methods.{name} cannot be read: {error}") from None


def _method(stem: str, name: str, given: Any) -> Method:
    where = f"description.methods.{name}"
    if not name.isidentifier() or not isinstance(given, dict):
        raise UsageError(f"{where}: expected a name with letters, digits and _, and an object")
    scope = given.get("scope", "read")
    if scope not in _SCOPES:
        raise UsageError(f"{where}.scope: expected one of {', '.join(_SCOPES)}")
    title = stem + name[:1].upper() + name[1:]
    summary = _text(given, "summary", name)
    request = _fields(given.get("request", {}), f"{where}.request", Message)
    answer = _fields(given.get("answer", {}), f"{where}.answer", Answer)
    output = given.get("output") or ""
    if output and list(answer) != [output]:
        raise UsageError(f"{where}.output: expected the only field of the answer")
    made = create_model(
        f"{title}Request", __base__=Message, __doc__=summary, __cls_kwargs__=_NO_DOCS, **request
    )
    reply = create_model(
        f"{title}Answer", __base__=Answer, __doc__=summary, __cls_kwargs__=_NO_DOCS, **answer
    )
    return Method(
        name, summary, _text(given, "description", ""), scope, _effect(given, where), made, reply,
        output, _not_here,
    )  # fmt: skip


def _effect(given: Mapping[str, Any], where: str) -> Effect:
    """Return the effect; a worker that does not say may write, so that no call is repeated."""
    effect = given.get("effect", "reads" if given.get("only_reads") is True else "writes")
    if effect not in EFFECTS:
        raise UsageError(f"{where}.effect: expected one of {', '.join(EFFECTS)}")
    declared: Effect = effect
    return declared


def _fields(schema: Any, where: str, base: type[Message | Answer]) -> dict[str, Any]:
    """Return the fields of a message by name, each with its type and default."""
    members = schema.get("properties", {}) if isinstance(schema, dict) else None
    if not isinstance(members, dict):
        raise UsageError(f"{where}: expected the JSON Schema of an object")
    parts = schema.get("$defs") or {}
    fields: dict[str, Any] = {}
    for name, member in members.items():
        if not name.isidentifier() or name.startswith("_") or hasattr(base, name):
            raise UsageError(f"{where}.{name}: a field cannot have this name")
        if not isinstance(member, dict):
            raise UsageError(f"{where}.{name}: expected a JSON Schema")
        type_ = _type(member, parts, f"{where}.{name}")
        words = member.get("description")
        words = _without_unit(words, member) if isinstance(words, str) else None
        if name in schema.get("required", ()):
            fields[name] = (type_, Field(..., description=words))
        elif "default" in member:
            fields[name] = (type_, Field(member["default"], description=words))
        else:
            fields[name] = (type_ | None, Field(None, description=words))
    return fields


def _type(schema: Mapping[str, Any], parts: Mapping[str, Any], where: str) -> Any:
    """Return the type of values that a schema describes; what is nested deeper is free JSON."""
    options = schema.get("anyOf")
    if isinstance(options, list):
        remaining = [option for option in options if option != {"type": "null"}]
        inner = _type(remaining[0], parts, where) if len(remaining) == 1 else Any
        return inner if inner is Any or len(remaining) == len(options) else inner | None
    if "enum" in schema:
        return Literal[tuple(schema["enum"])]
    kind = schema.get("type")
    if kind == "string":
        return _text_type(schema)
    if kind in ("number", "integer"):
        return _bounded(Number if kind == "number" else Whole, schema)
    if kind == "boolean":
        return Flag
    if kind == "array":
        items = schema.get("items") or {}
        numbers = items.get("type") == "number"
        return _united(Array, schema) if numbers else list[_type(items, parts, where)]  # type: ignore[misc]
    if kind == "object" or "$ref" in schema:
        return Pose if set(schema.get("properties", ())) == {"position", "orientation"} else Json
    raise UsageError(
        f"{where}: type {kind!r}; expected string, number, integer, boolean, array or object"
    )


def _text_type(schema: Mapping[str, Any]) -> Any:
    if schema.get("contentEncoding") != "base64":
        return Text if schema.get("pattern") == r"\S" else str
    media = str(schema.get("contentMediaType", ""))
    if media.startswith("image/"):
        return Image
    return Cloud if media == "application/vnd.rtask.cloud" else Bytes


def _bounded(type_: Any, schema: Mapping[str, Any]) -> Any:
    for bound, key in ((Ge, "minimum"), (Le, "maximum")):
        if isinstance(schema.get(key), int | float):
            type_ = Annotated[type_, bound(schema[key])]
    return _united(type_, schema)


def _united(type_: Any, schema: Mapping[str, Any]) -> Any:
    unit = schema.get("x-unit")
    return Annotated[type_, Unit(unit)] if isinstance(unit, str) else type_


def _without_unit(words: str, schema: Mapping[str, Any]) -> str:
    unit = schema.get("x-unit")
    return words.removesuffix(f" ({unit})") if unit else words


def _needs(resources: Any) -> dict[str, ResourceNeed]:
    if not isinstance(resources, dict):
        raise UsageError("description.resources: expected an object")
    needs = {}
    for name, resource in resources.items():
        if not isinstance(resource, dict) or resource.get("type", "binary") != "binary":
            raise UsageError(f"description.resources.{name}: a worker can have type binary only")
        default = resource.get("default")
        if not isinstance(default, str | None):
            raise UsageError(
                f"description.resources.{name}.default: expected the name of a dataset"
            )
        needs[name] = ResourceNeed(
            "binary", writable=resource.get("writable") is True, default=default,
            summary=_text(resource, "summary", ""),
        )  # fmt: skip
    return needs


def _names(schema: Any) -> Any:
    """Return the types of the fields of a schema, without words."""
    if not isinstance(schema, dict):
        return {}
    required = set(schema.get("required", ()))
    return {
        name: [
            member.get("type"),
            member.get("contentEncoding"),
            member.get("x-unit"),
            name in required,
        ]
        for name, member in (schema.get("properties") or {}).items()
    }


def _text(given: Mapping[str, Any], name: str, absent: str | None = None) -> str:
    value = given.get(name, absent)
    if not isinstance(value, str):
        raise UsageError(f"description.{name}: expected a text")
    return value


def _seconds(given: Mapping[str, Any]) -> float:
    value = given.get("timeout_s", 60.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= 3600:
        raise UsageError("description.timeout_s: expected seconds, above 0 and at most 3600")
    return float(value)


def _waiting(given: Mapping[str, Any]) -> int:
    value = given.get("max_waiting", 100)
    if type(value) is not int or not 1 <= value <= MAX_WAITING:
        raise UsageError(
            f"description.max_waiting: expected a whole number from 1 to {MAX_WAITING}"
        )
    return value


def _not_here(*_: object) -> Any:
    raise AssertionError("the code of this service is with its workers")
