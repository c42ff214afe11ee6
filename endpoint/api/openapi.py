"""The description of the HTTP interface (OpenAPI 3.1.0), made from the table of addresses."""

from __future__ import annotations

import re
from collections.abc import Iterator

from endpoint.api.openapi_declared import collection_paths, operation_paths, service_paths
from endpoint.api.openapi_page import page
from endpoint.http.messages import Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.rosbridge.services import Engine
from endpoint.routes import ROUTES, Route
from endpoint.routes.messages import JsonObject, Messages
from rtask import __version__
from rtask.services.registry import Registry

HTML_TYPE = "text/html; charset=utf-8"
_VARIABLE = re.compile(r"<(?:path:)?(\w+)>")


def plan_openapi(engine: Engine, services: Registry, request: Request) -> Plan:
    """Prepare the description, as JSON or as a page."""
    described = document(engine, services)
    if request.raw_path.rstrip("/").endswith(".json"):
        return Plan.ready(json_response(described))
    return Plan.ready(Response(200, page(described).encode(), HTML_TYPE))


def document(engine: Engine, services: Registry | None = None) -> JsonObject:
    """Return the whole description."""
    schemas: JsonObject = {"Problem": _PROBLEM}
    paths: JsonObject = {}
    for route in ROUTES:
        for path, described in _paths(route, engine, services or Registry(), schemas):
            method = next(name for name in route.methods if name != "HEAD")
            paths.setdefault(path, {})[method.lower()] = described
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
        "paths": paths,
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


def _paths(
    route: Route, engine: Engine, services: Registry, schemas: JsonObject
) -> Iterator[tuple[str, JsonObject]]:
    """Yield what a line of the table describes: itself, or all that its pattern stands for."""
    path = _VARIABLE.sub(r"{\1}", route.pattern)
    if isinstance(route.messages, Messages):
        yield path, {**route.messages.described(route.right), "x-effect": route.effect}
    elif route.messages is not None and route.handler == "operation":
        yield from operation_paths(path, engine, schemas)
    elif route.messages is not None and route.handler == "service":
        yield from service_paths(path, services, schemas)
    elif route.messages is not None:
        for listed, messages in collection_paths(path):
            yield listed, {**messages.described(route.right), "x-effect": route.effect}


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
