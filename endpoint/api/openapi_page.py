"""The description of the HTTP interface as one page for people, without scripts."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from endpoint.routes.messages import JsonObject


def page(document: JsonObject) -> str:
    """Return the page."""
    info = document["info"]
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="/static/icon.svg" type="image/svg+xml">',
        f"<title>{escape(info['title'])} over HTTP</title>",
        '<link rel="stylesheet" href="/static/style.css"></head><body>',
        '<header class="bar"><a class="brand" href="/"><img src="/static/icon.svg" alt="" '
        'width="28" height="28"> RTASK</a><nav aria-label="Pages">'
        '<a href="/operations">Operations</a><a href="/services">Services</a>'
        '<a href="/sparql">SPARQL</a></nav></header><main>',
        f"<h1>{escape(info['title'])} over HTTP</h1><p>{escape(info['description'])}</p>",
        '<p>For programs: <a href="/openapi.json">openapi.json</a> (OpenAPI 3.1).</p>',
    ]
    schemas = document["components"]["schemas"]
    all_of = [
        (path, method, described)
        for path, methods in document["paths"].items()
        for method, described in methods.items()
    ]
    links = [
        f'<li><a href="#{_anchor(*entry)}">{entry[1].upper()} {escape(entry[0])}</a></li>'
        for entry in all_of
    ]
    parts.append(
        f"<details><summary>{len(all_of)} requests</summary><ul>{''.join(links)}</ul></details>"
    )
    parts += [_operation(path, method, described, schemas) for path, method, described in all_of]
    return "\n".join([*parts, "</main></body></html>"])


def _anchor(path: str, method: str, described: JsonObject) -> str:
    """Return the id of a request's section, which no other request has."""
    return escape(described.get("operationId") or f"{method}-{path.strip('/')}")


def _operation(path: str, method: str, described: JsonObject, schemas: JsonObject) -> str:
    parts = [
        f'<section id="{_anchor(path, method, described)}">',
        f"<h2><code>{method.upper()} {escape(path)}</code></h2>",
        f"<p>{escape(described['summary'])}. {_code(described.get('description', ''))}</p>",
    ]
    rows = [
        (response["name"], response["in"], response["description"])
        for response in described.get("parameters", ())
    ]
    if rows:
        parts.append(_table(("parameter", "in", "meaning"), rows))
    body = described.get("requestBody")
    if body:
        schema = _resolved(next(iter(body["content"].values())).get("schema", {}), schemas)
        parts.append(_fields(schema, schemas))
    done = next(response for status, response in described["responses"].items() if status[0] == "2")
    answers: JsonObject = next(iter(done.get("content", {}).values()), {})
    answer = answers.get("schema")
    if answer:
        parts += ["<h3>Answer</h3>", _fields(_resolved(answer, schemas), schemas)]
    return "\n".join([*parts, "</section>"])


def _fields(schema: JsonObject, schemas: JsonObject) -> str:
    if "anyOf" in schema:
        schema = _resolved(schema["anyOf"][0], schemas)
    required = set(schema.get("required", ()))
    rows = []
    for name, member in schema.get("properties", {}).items():
        words = member.get("description", "")
        if "default" in member:
            words += f"; default {member['default']}"
        rows.append((name, _kind(member), words + ("; required" if name in required else "")))
    return _table(("field", "type", "meaning"), rows) if rows else ""


def _kind(schema: JsonObject) -> str:
    if "$ref" in schema:
        return str(schema["$ref"].rsplit("/", 1)[1])
    if "enum" in schema:
        return " or ".join(str(value) for value in schema["enum"] if value is not None)
    if "anyOf" in schema:
        return " or ".join(map(_kind, schema["anyOf"]))
    kinds = schema.get("type", "any")
    words = [kinds] if isinstance(kinds, str) else [kind for kind in kinds if kind != "null"]
    if words[0] == "array" and "items" in schema:
        return f"list of {_kind(schema['items'])}"
    return " or ".join(words)


def _resolved(schema: JsonObject, schemas: JsonObject) -> JsonObject:
    if "$ref" in schema:
        target: JsonObject = schemas[schema["$ref"].rsplit("/", 1)[1]]
        return target
    return schema


def _table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    body = "".join(
        f'<tr><th scope="row"><code>{escape(row[0])}</code></th>'
        + "".join(
            f'<td data-label="{escape(name)}"><span>{escape(str(cell))}</span></td>'
            for name, cell in zip(heads[1:], row[1:], strict=True)
        )
        + "</tr>"
        for row in rows
    )
    table = (
        f'<table class="cards-on-phone"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    )
    return f'<div class="scroll">{table}</div>'


def _code(text: str) -> str:
    """Return a text with its back-quoted words as code."""
    pieces = escape(text).split("`")
    return "".join(f"<code>{p}</code>" if k % 2 else p for k, p in enumerate(pieces))
