"""The description of the HTTP interface (OpenAPI 3.1.0), made from what the engine declares."""

from __future__ import annotations

import json

from pydantic import BaseModel

from endpoint.api.openapi_page import page
from endpoint.api.openapi_parts import JsonObject, get, parameter, problems
from endpoint.api.openapi_proposals import proposal_paths
from endpoint.api.openapi_reasoner import reasoner_paths
from endpoint.api.openapi_resources import resource_paths
from endpoint.api.openapi_services import service_paths
from endpoint.http.messages import JSON_TYPE, Request, Response
from endpoint.http.plan import Plan
from endpoint.http.problems import PROBLEM_TYPE
from endpoint.rosbridge.services import Engine, Operation
from endpoint.routes import find
from rtask import __version__
from rtask.services.registry import Registry
from rtask.wire.effect import Effect
from rtask.wire.fields import kind_of
from rtask.wire.openapi import components

HTML_TYPE = "text/html; charset=utf-8"
_OPERATION_PROBLEMS = (400, 401, 403, 404, 405, 409, 413, 415, 422, 429, 501, 503)


def plan_openapi(engine: Engine, services: Registry, request: Request) -> Plan:
    """Prepare the description, as JSON or as a page.

    Raises
    ------
    RefusedError
        405.
    """
    described = document(engine, services)
    if request.raw_path.rstrip("/").endswith(".json"):
        return Plan.ready(Response(200, json.dumps(described).encode(), JSON_TYPE))
    return Plan.ready(Response(200, page(described).encode(), HTML_TYPE))


def document(engine: Engine, services: Registry | None = None) -> JsonObject:
    """Return the whole description."""
    services = Registry() if services is None else services
    declared: dict[str, type[BaseModel]] = {}
    for name, operation in engine.operations.items():
        declared[_request_name(name)] = operation.request
        declared[operation.answer.__name__] = operation.answer
    schemas = {"Problem": _PROBLEM, **components(declared)}
    offered = service_paths(services, schemas)
    paths = {
        f"/engine/{name}": {"post": _operation(name, operation)}
        for name, operation in engine.operations.items()
    }
    every = {**paths, **offered, **_fixed_paths()}
    for path, methods in every.items():
        for method, described in methods.items():
            described.setdefault("x-effect", _effect(path, method))
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "RTASK",
            "version": __version__,
            "summary": "A knowledge graph that robots share",
            "description": "What robots ask and report, over HTTP with JSON. The same operations "
            "are services of the rosbridge websocket. SPARQL 1.1 is at /sparql.",
            "license": {"name": "Apache-2.0", "identifier": "Apache-2.0"},
        },
        "servers": [{"url": "/"}],
        "security": [{"token": []}, {}],
        "paths": every,
        "components": {
            "schemas": dict(sorted(schemas.items())),
            "securitySchemes": {
                "token": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "made by `rtask token create --robot NAME`",
                }
            },
        },
    }


_PROBLEM: JsonObject = {
    "type": "object",
    "description": "Problem details (RFC 9457)",
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
        "transient": {
            "type": "boolean",
            "description": "whether the same request may succeed later",
        },
    },
    "required": ["type", "title", "status", "detail"],
}

_IDEMPOTENCY_KEY: JsonObject = {
    "name": "Idempotency-Key",
    "in": "header",
    "required": False,
    "description": "the same key stores once, however often the request is sent",
    "schema": {"type": "string", "pattern": "^[A-Za-z0-9._:-]{1,200}$"},
}


def _request_name(operation: str) -> str:
    return "".join(part.title() for part in operation.split("_")) + "Request"


def _operation(name: str, operation: Operation) -> JsonObject:
    reference: JsonObject = {"$ref": f"#/components/schemas/{_request_name(name)}"}
    entries = operation.request.entries
    if entries:
        entry = kind_of(operation.request.model_fields[entries]).message
        assert entry is not None
        # The fields of one entry may stand at top level.
        reference = {"anyOf": [reference, {"$ref": f"#/components/schemas/{entry.__name__}"}]}
    answer = {"$ref": f"#/components/schemas/{operation.answer.__name__}"}
    described: JsonObject = {
        "operationId": name,
        "summary": operation.summary,
        "description": f"Needs the scope `{operation.scope}`.",
        "tags": ["engine"],
        "x-effect": operation.effect,
        "requestBody": {
            "required": True,
            "content": {JSON_TYPE: {"schema": reference}},
        },
        "responses": {
            "200": {
                "description": "done",
                "content": {JSON_TYPE: {"schema": answer}},
            },
            **problems(_OPERATION_PROBLEMS),
        },
    }
    if operation.effect == "writes":
        described["parameters"] = [_IDEMPOTENCY_KEY]
    return described


def _effect(path: str, method: str) -> Effect:
    """Return what a described request does to the graph, from the table of addresses."""
    route = find(path).by(method.upper())
    if route is None:
        raise KeyError(f"{method} {path} is described, but not in the table of addresses")
    # `/sparql` by GET is the only one that is described and says itself what it does.
    return route.effect or "reads"


def _health(summary: str) -> JsonObject:
    described = get(summary, (JSON_TYPE,))
    described["responses"]["503"]["content"] = {JSON_TYPE: {}, PROBLEM_TYPE: {}}
    return described


def _query_options() -> list[JsonObject]:
    """Return the parameters of a query that the SPARQL protocol has, or that are our own."""
    graphs: JsonObject = {"type": "array", "items": {"type": "string", "format": "uri"}}
    return [
        parameter("default-graph-uri", "query", "graphs of the default graph", graphs),
        parameter("named-graph-uri", "query", "graphs for GRAPH", graphs),
        parameter("inferred", "query", "0 leaves derived statements out",
                  {"type": "string", "enum": ["0", "1", "false", "true"]}),
        parameter("timeout", "query", "time limit in seconds",
                  {"type": "number", "exclusiveMinimum": 0}),
        parameter("as_of", "query", "earlier state: the number of its last commit, EPOCH:NUMBER, "
                  "or a time with its zone",
                  {"type": "string"}),
    ]  # fmt: skip


def _fixed_paths() -> JsonObject:
    text: JsonObject = {"type": "string"}
    results = (
        "application/sparql-results+json", "text/csv", "text/turtle", "application/n-triples",
        "text/html", "application/sparql-results+xml", "text/tab-separated-values",
        "application/n-quads", "application/trig", "application/rdf+xml", "application/ld+json",
    )  # fmt: skip
    digest = parameter("sha256", "path", "64 lower-case hex digits",
                        {"type": "string", "pattern": "^[0-9a-f]{64}$"})  # fmt: skip
    query = parameter("query", "query", "SELECT, ASK, CONSTRUCT or DESCRIBE", text)
    sparql = get("Ask in SPARQL 1.1", results, [query, *_query_options()])
    sparql["responses"].update(problems((413, 501, 507)))  # of earlier states
    words = parameter("text", "query", "a question in words", text)
    words["required"] = True
    return {
        "/ask": {"get": get("Answer a question in words", (JSON_TYPE, "text/html"), [words])},
        "/terms": {
            "get": get(
                "Describe a class or property, or list those that have all words",
                (JSON_TYPE, "text/html"),
                [
                    parameter("term", "query", "IRI, prefixed name, name or label", text),
                    parameter("words", "query", "words to look for", text),
                ],
            )
        },
        # POST with SPARQL as the body is the SPARQL protocol's own, which generators do not know.
        "/sparql": {"get": sparql},
        **resource_paths(),
        "/api/blobs/{sha256}": {
            "get": get(
                "Read an image, a cloud or descriptors",
                ("application/octet-stream", "image/png", "image/jpeg", "application/ply"),
                [digest],
            )
        },
        **reasoner_paths(),
        **proposal_paths(),
        "/changes": {"get": _changes(text)},
        "/tokens/ticket": {"post": _ticket()},
        "/health": {"get": _health("Whether the server is healthy")},
        "/health/live": {"get": get("Whether the server is alive", (JSON_TYPE,))},
        "/health/ready": {"get": _health("Whether the server takes requests")},
        "/openapi.json": {"get": get("This description", (JSON_TYPE,))},
    }


def _ticket() -> JsonObject:
    body = {
        "type": "object",
        "properties": {"ticket": {"type": "string"}, "expires_in": {"type": "integer"}},
        "required": ["ticket", "expires_in"],
    }
    return {
        "summary": "Get a value for the ?token= of one websocket; expires_in is in s",
        "responses": {
            "201": {"description": "made", "content": {JSON_TYPE: {"schema": body}}},
            **problems((400, 401, 403, 405, 413, 415, 429, 503)),
        },
    }


def _changes(text: JsonObject) -> JsonObject:
    parameters = [
        parameter(name, "query", f"{meaning}; an IRI, or a term as N-Triples", text)
        for name, meaning in (
            ("s", "subject"), ("p", "predicate"), ("o", "object"), ("graph", "named graph"),
        )
    ]  # fmt: skip
    return get(
        "Follow every commit, as server-sent events",
        ("text/event-stream",),
        [
            *parameters,
            parameter("since", "query", "version to go on from, `<epoch>:<seq>`", text),
            parameter("Last-Event-ID", "header", "the same, as browsers send it", text),
        ],
    )
