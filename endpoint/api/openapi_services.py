"""Services and jobs in the description of the HTTP interface."""

from __future__ import annotations

import json
from typing import Any

from endpoint.api.openapi_parts import JsonObject, get, parameter, problems
from endpoint.http.messages import JSON_TYPE
from rtask.services.definition import Definition, Method
from rtask.services.description import schemas as schemas_of
from rtask.services.registry import Registry

_REF = "#/components/schemas/"
_TEXT: JsonObject = {"type": "string"}
_CALL_PROBLEMS = (400, 401, 403, 404, 405, 409, 413, 415, 422, 429, 501, 503, 504)
_ENGINE = "rtask/Engine"
_DATASET = "/datasets/{namespace}/{name}"


def service_paths(registry: Registry, schemas: JsonObject) -> JsonObject:
    """Return the paths of services and jobs; add the schemas of their messages.

    The newest version of each service is described. The operations of the engine are left out,
    because they are described at addresses of their own.

    Parameters
    ----------
    schemas
        Components of the description so far.
    """
    namespace = parameter("namespace", "path", "of the service", _TEXT)
    name = parameter("name", "path", "of the service, perhaps with @version", _TEXT)
    job = parameter("id", "path", "of the job", _TEXT)
    wait = parameter("wait", "query", "wait for the end, s", {"type": "number", "minimum": 0})
    after = parameter(
        "after", "query", "list, or follow, the events after this number", {"type": "integer"}
    )
    cancel = {
        "summary": "Cancel a job",
        "responses": {
            "200": {"description": "the job", "content": {JSON_TYPE: {}}},
            **problems((400, 401, 403, 404, 405, 429, 503)),
        },
        "parameters": [job],
    }
    paths: JsonObject = {
        "/services": {"get": get("List the services", (JSON_TYPE,))},
        "/services/{namespace}/{name}": {
            "get": get("Describe a service", (JSON_TYPE,), [namespace, name])
        },
        "/jobs": {"get": get("List the caller's jobs", (JSON_TYPE,))},
        "/jobs/{id}": {
            "get": get(
                "Read a job, or follow its progress and its end as server-sent events",
                (JSON_TYPE, "text/event-stream"),
                [job, wait, after],
            ),
            "delete": cancel,
        },
    }
    paths.update(_dataset_paths())
    for definition in registry:
        if definition.name == _ENGINE:
            continue
        for method in definition.methods.values():
            path = f"/services/{definition.name}/{method.name}"
            paths[path] = {"post": _operation(definition, method, schemas)}
    return paths


def _dataset_paths() -> JsonObject:
    namespace = parameter("namespace", "path", "of the dataset", _TEXT)
    name = parameter("name", "path", "of the dataset, perhaps with @version", _TEXT)
    path = parameter("path", "path", "of the file", _TEXT)
    match = parameter("If-Match", "header", "SHA-256 that the file has now", _TEXT)
    named = [namespace, name]

    def change(summary: str, status: str, fields: JsonObject | None, *more: JsonObject) -> Any:
        done: JsonObject = {"description": "done"}
        if status == "200":
            done["content"] = {JSON_TYPE: {}}
        described: JsonObject = {
            "summary": summary,
            "parameters": [*named, *more],
            "responses": {
                status: done,
                **problems((400, 401, 403, 404, 405, 409, 412, 413, 415, 422, 429, 503)),
            },
        }
        if fields is not None:
            schema = {"type": "object", "properties": fields, "additionalProperties": False}
            described["requestBody"] = {"content": {JSON_TYPE: {"schema": schema}}}
        return described

    rules = {"type": "object", "additionalProperties": {"enum": ["fail", "ours", "theirs"]}}
    readers = {"type": "array", "items": _TEXT}
    paths = {"type": "array", "items": _TEXT}
    file = f"{_DATASET}/files/{{path}}"
    ends = [parameter(side, "query", "a version, or head", _TEXT) for side in ("from", "to")]
    content = {"schema": {"type": "string", "format": "binary"}}
    binary: JsonObject = {"content": {"application/octet-stream": content}}
    return {
        "/datasets": {"get": get("List the datasets", (JSON_TYPE,))},
        _DATASET: {
            "get": get("Read a version of a dataset", (JSON_TYPE,), named),
            "put": change(
                "Create or fork a dataset", "201",
                {"fork_of": _TEXT, "readers": readers, "key": _TEXT},
            ),
        },
        f"{_DATASET}/diff": {"get": get("Compare two versions", (JSON_TYPE,), [*named, *ends])},
        f"{_DATASET}/snapshot": {
            "post": change("Make the head a version", "200", {"message": _TEXT})
        },
        f"{_DATASET}/prune": {
            "post": change(
                "Make a version without some files and records", "200",
                {"paths": paths, "where": {"type": "object"}, "message": _TEXT},
            )
        },
        f"{_DATASET}/merge": {
            "post": change(
                "Merge a version into the head", "200",
                {"source": _TEXT, "rules": rules, "message": _TEXT},
            )
        },
        file: {
            "get": get("Read a file", ("application/octet-stream",), [*named, path]),
            "put": {**change("Write a file", "204", None, path, match), "requestBody": binary},
            "delete": change("Remove a file or a folder", "204", None, path),
        },
    }  # fmt: skip


def _operation(definition: Definition, method: Method, schemas: JsonObject) -> JsonObject:
    names = _add(schemas, schemas_of(method), definition)
    data = parameter(
        "data", "query", "dataset of a data resource, <resource>:<namespace>/<name>",
        {"type": "array", "items": _TEXT},
    )  # fmt: skip
    prefer = parameter("Prefer", "header", "respond-async makes the call a job", _TEXT)
    request, answer = ({"$ref": _REF + names[message.__name__]} for message in (
        method.request, method.answer
    ))  # fmt: skip
    job = {"description": "a job, whose address is in Location", "content": {JSON_TYPE: {}}}
    return {
        "operationId": f"{definition.name}/{method.name}".replace("/", "_"),
        "summary": method.summary,
        "description": f"{method.description}\n\nNeeds the scope `{method.scope}`.".strip(),
        "tags": [definition.name],
        "x-effect": method.effect,
        "parameters": [prefer, *([data] if definition.resources else [])],
        "requestBody": {"required": True, "content": {JSON_TYPE: {"schema": request}}},
        "responses": {
            "200": {"description": "done", "content": {JSON_TYPE: {"schema": answer}}},
            "202": job,
            **problems(_CALL_PROBLEMS),
        },
    }


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
