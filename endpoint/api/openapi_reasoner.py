"""The description of the reasoner's addresses."""

from __future__ import annotations

from endpoint.api.openapi_parts import JsonObject, get, parameter, problems
from endpoint.api.reasoner import (
    BUDGET,
    CONTRADICTIONS,
    ENTAILS,
    EXPLAIN,
    MAX_BUDGET,
    RULES,
    SPARQL_TYPE,
)
from endpoint.http.messages import JSON_TYPE

_TEXT: JsonObject = {"type": "string"}
_RULE: JsonObject = {
    "type": "object",
    "properties": {
        "label": {"type": "string", "minLength": 1},
        "text": {"type": "string", "description": "SPARQL CONSTRUCT query"},
        "comment": _TEXT,
    },
    "required": ["label", "text"],
}
_DOCUMENT: JsonObject = {
    "type": "object",
    "properties": {"text": {"type": "string", "description": "the statements, as Turtle"}},
    "required": ["text"],
    "additionalProperties": False,
}
_CHANGE_PROBLEMS = (400, 401, 403, 404, 405, 409, 413, 415, 422, 429, 503)


def reasoner_paths() -> JsonObject:
    """Return the paths of the reasoner."""
    name = parameter("name", "path", "label of the rule, or the last part of its IRI", _TEXT)
    single = get("One rule of the user", (JSON_TYPE,), [name])
    single["responses"] |= problems((422,))
    sent = {**_RULE, "properties": {**_RULE["properties"], "replace": {"type": "boolean"}}}
    several: JsonObject = {
        "type": "object",
        "properties": {
            "rules": {"type": "array", "items": _RULE, "minItems": 1},
            "replace": {"type": "boolean"},
        },
        "required": ["rules"],
        "additionalProperties": False,
    }
    labels = parameter("label", "query", "label or IRI of a rule; may be repeated", _TEXT)
    labels["required"] = True
    terms = [
        parameter(
            name,
            "query",
            f"{meaning}: an IRI, a name or a literal",
            _TEXT,
        )
        for name, meaning in (("s", "subject"), ("p", "predicate"), ("o", "object"))
    ]
    for described in terms:
        described["required"] = True
    steps: JsonObject = {"type": "integer", "minimum": 1, "maximum": MAX_BUDGET, "default": BUDGET}
    terms.append(parameter("budget", "query", "steps of the reasoner", steps))
    asked = get("Does a statement follow?", (JSON_TYPE,), terms)
    asked["responses"] |= problems((413, 422, 501))
    explained = get("Why does a statement hold?", (JSON_TYPE,), terms)
    explained["responses"] |= problems((422, 501))
    clashes = get("What the graph contradicts, with the causes", (JSON_TYPE,))
    clashes["responses"] |= problems((501,))
    return {
        EXPLAIN: {"get": explained},
        CONTRADICTIONS: {"get": clashes},
        ENTAILS: {
            "get": asked,
            "post": {
                "summary": "Does everything that a document says follow?",
                "description": "The body may also be the document itself, as `text/turtle` or "
                "`application/n-triples`.",
                "requestBody": {
                    "required": True,
                    "content": {JSON_TYPE: {"schema": _DOCUMENT}},
                },
                "responses": {
                    "200": {"description": "the answer", "content": {JSON_TYPE: {}}},
                    **problems((*_CHANGE_PROBLEMS, 501)),
                },
            },
        },
        RULES: {
            "get": get("Rules of the user", (JSON_TYPE,)),
            "post": {
                "summary": "Add rules",
                "description": "Needs the right `rules`. The body is a rule, or several under "
                "`rules`, which are added as one commit; it may also be the query itself, as "
                f"`{SPARQL_TYPE}` with `?label=`.",
                "requestBody": {
                    "required": True,
                    "content": {JSON_TYPE: {"schema": {"anyOf": [sent, several]}}},
                },
                "responses": {
                    "201": {"description": "added", "content": {JSON_TYPE: {}}},
                    **problems(_CHANGE_PROBLEMS),
                },
            },
            "delete": {
                "summary": "Remove rules",
                "description": "Needs the right `rules`. All are removed as one commit.",
                "parameters": [labels],
                "responses": {
                    "200": {"description": "removed", "content": {JSON_TYPE: {}}},
                    **problems(_CHANGE_PROBLEMS),
                },
            },
        },
        f"{RULES}/{{name}}": {
            "get": single,
            "delete": {
                "summary": "Remove a rule",
                "description": "Needs the right `rules`.",
                "parameters": [name],
                "responses": {
                    "200": {"description": "removed", "content": {JSON_TYPE: {}}},
                    **problems(_CHANGE_PROBLEMS),
                },
            },
        },
    }
