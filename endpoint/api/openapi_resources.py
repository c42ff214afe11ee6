"""The description of `/api/robots` and its like, of the tables that the queries are made of."""

from __future__ import annotations

from endpoint.api.collections import COLLECTIONS, Collection, Kind
from endpoint.api.listing import ADDRESS, CONTEXT_ADDRESS, LIMIT, MAX_LIMIT, TYPES
from endpoint.api.openapi_parts import JsonObject, get, parameter
from endpoint.http.messages import JSON_TYPE
from endpoint.sparql.negotiation import JSON_LD

_IRI: JsonObject = {"type": "string", "format": "iri"}
_SCHEMAS: dict[Kind, JsonObject] = {
    "iri": _IRI,
    "iris": {"type": "array", "items": _IRI},
    "text": {"type": "string"},
    "texts": {"type": "array", "items": {"type": "string"}},
    "number": {"type": "number"},
    "integer": {"type": "integer", "minimum": 0},
    "boolean": {"type": "boolean"},
    "time": {"type": "string", "format": "date-time"},
}
_WHOLE = ("iris", "texts", "integer")


def resource_paths() -> JsonObject:
    """Return the paths of all collections."""
    paths: JsonObject = {CONTEXT_ADDRESS: {"get": get("JSON-LD context of the items", (JSON_LD,))}}
    common = [
        parameter("iri", "query", "only this one", _IRI),
        parameter("fields", "query", "only these members, parted by commas", {"type": "string"}),
        parameter("limit", "query", "items of a page",
                  {"type": "integer", "minimum": 1, "maximum": MAX_LIMIT, "default": LIMIT}),
        parameter("cursor", "query", "from `next` of the page before", {"type": "string"}),
        parameter("total", "query", "count them all too", {"enum": ["0", "1"]}),
    ]  # fmt: skip
    name = parameter("id", "path", "last part of its IRI", {"type": "string"})
    for collection in COLLECTIONS.values():
        filters = [
            parameter(filter_.name, "query", filter_.summary, _SCHEMAS[filter_.kind])
            for filter_ in collection.filters
        ]
        item = _item(collection)
        several = get(collection.summary, TYPES, [*filters, *common])
        several["responses"]["200"]["content"][JSON_TYPE] = {"schema": _page(item)}
        single = get(f"One of {collection.name}", TYPES, [name, common[1]])
        single["responses"]["200"]["content"][JSON_TYPE] = {"schema": item}
        for described in (several, single):
            described["responses"]["304"] = {"description": "as If-None-Match knows it"}
        paths[f"{ADDRESS}{collection.name}"] = {"get": several}
        paths[f"{ADDRESS}{collection.name}/{{id}}"] = {"get": single}
    return paths


def _item(collection: Collection) -> JsonObject:
    members: JsonObject = {"iri": _IRI}
    for member in collection.members:
        schema = _SCHEMAS[member.kind]
        if member.kind not in _WHOLE:
            schema = {**schema, "type": [schema["type"], "null"]}
        members[member.name] = {**schema, "description": member.summary}
    return {"type": "object", "properties": members, "required": ["iri"]}


def _page(item: JsonObject) -> JsonObject:
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
