"""The description of a service as JSON: for programs, forms, clients and agents."""

from __future__ import annotations

import json
from typing import Any

from rtask.errors import RtaskError
from rtask.services.definition import Definition, Method
from rtask.wire.fields import wire_name
from rtask.wire.openapi import components
from rtask.wire.ros import ros_types

__all__ = [
    "answer_schema",
    "described",
    "listed",
    "request_schema",
    "ros_service",
    "ros_type",
    "schemas",
]

JsonObject = dict[str, Any]
_REF = "#/components/schemas/"
_WORDS = {"title", "description", "default", "examples"}


def listed(
    definition: Definition, versions: list[str], state: str, problem: RtaskError | None = None
) -> JsonObject:
    """Return the entry of a service in lists, with the reason if it cannot be used."""
    words = None if problem is None else {
        "type": f"/errors/{problem.slug}", "detail": str(problem), "transient": problem.is_transient
    }  # fmt: skip
    return {
        "name": definition.name,
        "version": definition.version,
        "versions": versions,
        "state": state,
        **({} if words is None else {"problem": words}),
        "summary": definition.summary,
        "methods": list(definition.methods),
        "href": f"/services/{definition.exact}",
    }


def described(
    definition: Definition, versions: list[str], state: str, problem: RtaskError | None = None
) -> JsonObject:
    """Return the description of one version of a service.

    ``methods`` holds by name: summary, description, scope, ``effect``, ``only_reads`` where that
    is ``reads``, the JSON Schemas ``request`` and ``answer``, each complete in itself, and
    ``output``, the field of an answer that is one value.
    """
    return {
        **listed(definition, versions, state, problem),
        "description": definition.description,
        "executor": definition.executor,
        "timeout_s": definition.timeout_s,
        "max_waiting": definition.max_waiting,
        "resources": {
            name: {
                "type": need.type,
                "writable": need.writable,
                "default": need.default,
                "summary": need.summary,
            }
            for name, need in definition.resources.items()
        },
        "methods": {
            name: _method(definition, method) for name, method in definition.methods.items()
        },
    }


def _method(definition: Definition, method: Method) -> JsonObject:
    schemas_of_method = schemas(method)
    return {
        "summary": method.summary,
        "description": method.description,
        "scope": method.scope,
        "effect": method.effect,
        "only_reads": method.effect == "reads",
        "output": method.output or None,
        "output_type": _output_type(method),
        "request": _whole(schemas_of_method, method.request.__name__),
        "answer": _whole(schemas_of_method, method.answer.__name__),
        "href": f"/services/{definition.exact}/{method.name}",
        "ros_service": ros_service(definition.name, method.name),
        "ros_type": ros_type(definition, method),
    }


def request_schema(method: Method) -> JsonObject:
    """Return the JSON Schema of a request, complete in itself."""
    return _whole(schemas(method), method.request.__name__)


def answer_schema(method: Method) -> JsonObject:
    """Return the JSON Schema of an answer for agents: its fields, and the names of theirs.

    Agents pay for each byte of the list of tools; what a field means, and what is in the parts of
    its parts, is in the description of the service.
    """
    whole = _whole(schemas(method), method.answer.__name__)
    parts = {
        name: {"type": "object", "required": part["required"]} if part.get("required") else
        {"type": "object"} if "properties" in part else part
        for name, part in whole.pop("$defs", {}).items()
    }  # fmt: skip
    text = json.dumps({"schema": whole, "parts": parts})
    needed = {name: part for name, part in parts.items() if f'"#/$defs/{name}"' in text}
    brief: JsonObject = _without_words({**whole, **({"$defs": needed} if needed else {})})
    return brief


def _without_words(schema: Any, *, names_fields: bool = False) -> Any:
    """Return a schema without titles, descriptions, defaults and what only forms and ROS read."""
    if isinstance(schema, list):
        return [_without_words(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        name: _without_words(
            part, names_fields=name in ("properties", "$defs") and not names_fields
        )
        for name, part in schema.items()
        if names_fields or not (name in _WORDS or name.startswith("x-"))
    }


def schemas(method: Method) -> JsonObject:
    """Return the schemas of request and answer with all their parts, as OpenAPI components."""
    return components({model.__name__: model for model in (method.request, method.answer)})


def ros_service(service: str, method: str) -> str:
    """Return the name of a method as a service of rosbridge."""
    return f"/services/{service}/{method}"


def ros_type(definition: Definition, method: Method) -> str:
    """Return the ROS type of a method as a service of rosbridge: ``example/KinematicsForward``."""
    package, _, name = definition.name.partition("/")
    words = "".join(part[:1].upper() + part[1:] for part in method.name.split("_"))
    return f"{package}/{name}{words}"


def _output_type(method: Method) -> str | None:
    """Return the ROS type of the answer's only value, which tells clients how to read it."""
    if not method.output:
        return None
    sent = wire_name(method.output, method.answer.model_fields[method.output])
    members = ros_types("answer", method.answer)["answer"]
    return next(str(member) for member in members if member.name == sent)


def _whole(schemas_of_type: JsonObject, name: str) -> JsonObject:
    """Return one schema with the parts that it refers to."""
    text = json.dumps(schemas_of_type).replace(_REF, "#/$defs/")
    every = json.loads(text)
    whole: JsonObject = every.pop(name)
    needed, todo = {}, [whole]
    while todo:
        words = json.dumps(todo.pop())
        for part, schema in every.items():
            if f'"#/$defs/{part}"' in words and part not in needed:
                needed[part] = schema
                todo.append(schema)
    return {**whole, "$defs": needed} if needed else whole
