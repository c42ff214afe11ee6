"""Descriptions of addresses that stand for many: operations, methods of services, collections.

Each is made from the declaration of what it stands for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

from pydantic import BaseModel

from endpoint.api.collections import COLLECTIONS, Collection, Kind
from endpoint.api.listing import LIMIT, MAX_LIMIT, TYPES
from endpoint.http.messages import JSON_TYPE
from endpoint.rosbridge.services import Engine, Operation
from endpoint.routes.messages import (
    CHANGING,
    TEXT,
    Answer,
    Body,
    JsonObject,
    Messages,
    parameter,
)
from rtask.services.definition import Definition, Method
from rtask.services.description import schemas as schemas_of
from rtask.services.registry import Registry
from rtask.wire.fields import kind_of
from rtask.wire.openapi import components

__all__ = ["collection_paths", "operation_paths", "service_paths"]

_REF = "#/components/schemas/"
_ENGINE = "rtask/Engine"
_IDEMPOTENCY_KEY: JsonObject = {
    "name": "Idempotency-Key",
    "in": "header",
    "required": False,
    "description": "the same key stores once, however often the request is sent",
    "schema": {"type": "string", "pattern": "^[A-Za-z0-9._:-]{1,200}$"},
}
Described = Iterator[tuple[str, JsonObject]]


def operation_paths(path: str, engine: Engine, schemas: JsonObject) -> Described:
    """Yield the addresses of the operations of the engine; add the schemas of their messages.

    Parameters
    ----------
    path
        Address of an operation ``{name}``.
    schemas
        Components of the description so far.
    """
    declared: dict[str, type[BaseModel]] = {}
    for name, operation in engine.operations.items():
        declared[_request_name(name)] = operation.request
        declared[operation.answer.__name__] = operation.answer
        described = _operation(name, operation).described(operation.scope)
        yield path.replace("{name}", name), {**described, "x-effect": operation.effect}
    schemas.update(components(declared))


def _request_name(operation: str) -> str:
    return "".join(part.title() for part in operation.split("_")) + "Request"


def _operation(name: str, operation: Operation) -> Messages:
    schema: JsonObject = {"$ref": _REF + _request_name(name)}
    entries = operation.request.entries
    if entries:
        entry = kind_of(operation.request.model_fields[entries]).message
        assert entry is not None
        # The fields of one entry may stand at top level.
        schema = {"anyOf": [schema, {"$ref": _REF + entry.__name__}]}
    return Messages(
        operation.summary,
        (_IDEMPOTENCY_KEY,) if operation.effect == "writes" else (),
        Body(schema),
        Answer(words="done", schema={"$ref": _REF + operation.answer.__name__}),
        (*CHANGING, 501),
        "Needs the scope `{right}`.",
        id=name,
        tags=("engine",),
    )


def service_paths(path: str, registry: Registry, schemas: JsonObject) -> Described:
    """Yield the addresses of methods of services; add the schemas of their messages.

    The newest version of each service is described. The operations of the engine are left out,
    because they are described at addresses of their own.

    Parameters
    ----------
    path
        Address of the ``{method}`` of the service ``{name}`` in a ``{namespace}``.
    schemas
        Components of the description so far.
    """
    for definition in registry:
        if definition.name == _ENGINE:
            continue
        service = path.replace("{namespace}/{name}", definition.name)
        for method in definition.methods.values():
            described = _method(definition, method, schemas).described(method.scope)
            yield service.replace("{method}", method.name), {**described, "x-effect": method.effect}


def _method(definition: Definition, method: Method, schemas: JsonObject) -> Messages:
    names = _add(schemas, schemas_of(method), definition)
    data = parameter(
        "data", "query", "dataset of a data resource, <resource>:<namespace>/<name>",
        {"type": "array", "items": TEXT},
    )  # fmt: skip
    prefer = parameter("Prefer", "header", "respond-async makes the call a job", TEXT)
    request, answer = (
        {"$ref": _REF + names[message.__name__]} for message in (method.request, method.answer)
    )
    job = {"description": "a job, whose address is in Location", "content": {JSON_TYPE: {}}}
    return Messages(
        method.summary,
        (prefer, data) if definition.resources else (prefer,),
        Body(request),
        Answer(words="done", schema=answer),
        (*CHANGING, 501, 504),
        f"{method.description}\n\nNeeds the scope `{method.scope}`.".strip(),
        {202: job},
        f"{definition.name}/{method.name}".replace("/", "_"),
        (definition.name,),
    )


def _add(schemas: JsonObject, fragment: JsonObject, definition: Definition) -> dict[str, str]:
    """Add schemas, under other names where another service has taken theirs."""
    stem = definition.name.replace("/", "")
    names = {
        name: f"{stem}{name}" if name in schemas and schemas[name] != schema else name
        for name, schema in fragment.items()
    }
    text = json.dumps(fragment)
    for name, other in names.items():
        text = text.replace(f'"{_REF}{name}"', f'"{_REF}{other}"')
    schemas.update({names[name]: schema for name, schema in json.loads(text).items()})
    return names


_IRI: JsonObject = {"type": "string", "format": "iri"}
_SCHEMAS: dict[Kind, JsonObject] = {
    "iri": _IRI,
    "iris": {"type": "array", "items": _IRI},
    "text": TEXT,
    "texts": {"type": "array", "items": TEXT},
    "number": {"type": "number"},
    "integer": {"type": "integer", "minimum": 0},
    "boolean": {"type": "boolean"},
    "time": {"type": "string", "format": "date-time"},
}
_WHOLE = ("iris", "texts", "integer")
_FIELDS = parameter("fields", "query", "only these members, parted by commas", TEXT)
_LISTED = (
    parameter("iri", "query", "only this one", _IRI),
    _FIELDS,
    parameter("limit", "query", "items of a page",
              {"type": "integer", "minimum": 1, "maximum": MAX_LIMIT, "default": LIMIT}),
    parameter("cursor", "query", "from `next` of the page before", TEXT),
    parameter("total", "query", "count them all too", {"enum": ["0", "1"]}),
)  # fmt: skip
_ID = parameter("id", "path", "last part of its IRI", TEXT)
_UNCHANGED = {304: {"description": "as If-None-Match knows it"}}


def collection_paths(path: str) -> Iterator[tuple[str, Messages]]:
    """Yield the addresses of collections, or of items in them where the path has an ``{id}``.

    They are described by the tables that the queries are made of.

    Parameters
    ----------
    path
        Address of a ``{collection}``.
    """
    for collection in COLLECTIONS.values():
        item = _item(collection)
        if "{id}" in path:
            messages = Messages(
                f"One of {collection.name}",
                (_ID, _FIELDS),
                answer=Answer(types=TYPES, schema=item),
                others=_UNCHANGED,
            )
        else:
            filters = (
                parameter(filter_.name, "query", filter_.summary, _SCHEMAS[filter_.kind])
                for filter_ in collection.filters
            )
            messages = Messages(
                collection.summary,
                (*filters, *_LISTED),
                answer=Answer(types=TYPES, schema=_list_of(item)),
                others=_UNCHANGED,
            )
        yield path.replace("{collection}", collection.name), messages


def _item(collection: Collection) -> JsonObject:
    members: JsonObject = {"iri": _IRI}
    for member in collection.members:
        schema = _SCHEMAS[member.kind]
        if member.kind not in _WHOLE:
            schema = {**schema, "type": [schema["type"], "null"]}
        members[member.name] = {**schema, "description": member.summary}
    return {"type": "object", "properties": members, "required": ["iri"]}


def _list_of(item: JsonObject) -> JsonObject:
    return {
        "type": "object",
        "properties": {
            "items": {"type": "array", "items": item},
            "next": {
                "type": ["string", "null"],
                "description": "address of the next page; null on the last",
            },
            "total": {"type": "integer", "description": "where total=1 asks for it"},
        },
        "required": ["items", "next"],
    }
