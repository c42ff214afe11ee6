"""Datasets over HTTP.

::

    GET    /datasets                            those that the caller may read
    PUT    /datasets/<ns>/<name>                create: {"readers": [], "key": "id"};
                                                or fork: {"fork_of": "a/B@3"}
    GET    /datasets/<ns>/<name>[@v]            a version with its files, or the head
    GET    /datasets/<ns>/<name>/diff?from=&to= paths that differ
    POST   /datasets/<ns>/<name>/snapshot       make the head a version
    POST   /datasets/<ns>/<name>/prune          {"paths": [], "where": {"robot": "nao-1"}}: make a
                                                version without these files and records
    POST   /datasets/<ns>/<name>/merge          {"source": "a/B@3", "rules": {"": "ours"}}
    GET    /datasets/<ns>/<name>[@v]/files/<path>   the bytes; the entity tag is their SHA-256
    PUT, DELETE  .../files/<path>               write to the head; If-Match guards against others
    POST   /datasets/<ns>/<name>/files          CBOR {"<path>": bytes}: many files, all or none
"""

from __future__ import annotations

import mimetypes
from typing import Any
from urllib.parse import unquote

from endpoint.access.auth import Caller
from endpoint.api.operations import json_object
from endpoint.http.messages import CBOR_TYPE, RefusedError, Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.routes.addresses import DATASETS
from rtask.errors import UnknownTermError, UsageError
from rtask.services.datasets.store import Datasets
from rtask.services.outward.frames import unpack

_ACTIONS = ("diff", "snapshot", "prune", "merge", "files")
_RULES = ("fail", "ours", "theirs")


def plan_dataset(datasets: Datasets, request: Request, caller: Caller, address: str) -> Plan:
    """Prepare the answer to a request about datasets.

    Raises
    ------
    RefusedError
        404, which a private dataset is to strangers as well.
    """
    parts = address.removeprefix(DATASETS).strip("/").split("/", 3)
    return Plan(lambda: _answer(datasets, request, caller, parts))


def _answer(datasets: Datasets, request: Request, caller: Caller, parts: list[str]) -> Response:
    """Do the work; what does not exist is a matter of HTTP here."""
    name = "/".join(parts[:2])
    try:
        if parts == [""]:
            return json_response({"datasets": datasets.names(caller.access)})
        if len(parts) == 2:
            return _whole(datasets, request, caller, name)
        if len(parts) == 4 and parts[2] == "files":
            return _file(datasets, request, caller, name, unquote(parts[3]))
        if len(parts) == 3 and parts[2] in _ACTIONS:
            return _action(datasets, request, caller, name, parts[2])
        raise UnknownTermError(f"there is nothing at {request.path}; see {DATASETS}")
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", str(error)) from None


def _whole(datasets: Datasets, request: Request, caller: Caller, name: str) -> Response:
    if request.method != "PUT":
        dataset = datasets.find(name, caller.access)
        facts = {"key": datasets.key(name.partition("@")[0])}
        return json_response(
            {**dataset.facts(), **facts, "versions": datasets.numbers(dataset.dataset)}
        )
    fields = json_object(request) if request.body else {}
    source, readers = fields.pop("fork_of", None), fields.pop("readers", None)
    key = fields.pop("key", "")
    if fields:
        raise UsageError(f"unknown field {min(fields)!r}; known: fork_of, readers, key")
    if readers is not None and not _are_texts(readers):
        raise UsageError("readers: expected a list of names", field="readers")
    if not isinstance(key, str):
        raise UsageError("key: expected the name of a field", field="key")
    if source is not None:
        if not isinstance(source, str) or readers is not None or key:
            raise UsageError(
                "fork_of: expected the name of a version; readers and key are those of it"
            )
        datasets.fork(name, source, caller.access)
    else:
        datasets.create(name, caller.access, readers, key)
    return Response(201, headers=(("Location", f"{DATASETS}/{name}"),))


def _action(
    datasets: Datasets, request: Request, caller: Caller, name: str, action: str
) -> Response:
    if action == "diff":
        before, after = (_parameter(request, side) for side in ("from", "to"))
        return json_response(
            datasets.difference(f"{name}@{before}", f"{name}@{after}", caller.access)
        )
    if action == "files":
        return _files(datasets, request, caller, name)
    fields = json_object(request) if request.body else {}
    message = fields.get("message", "")
    if not isinstance(message, str):
        raise UsageError("message: expected a text", field="message")
    if action == "snapshot":
        return json_response(datasets.snapshot(name, message, caller.access).facts())
    if action == "prune":
        paths, where = fields.get("paths", []), fields.get("where", {})
        if not _are_texts(paths):
            raise UsageError("paths: expected a list of texts", field="paths")
        if not isinstance(where, dict):
            raise UsageError("where: expected values by fields", field="where")
        return json_response(datasets.prune(name, paths, where, message, caller.access).facts())
    source, rules = fields.get("source"), fields.get("rules", {})
    if not isinstance(source, str):
        raise UsageError("source: expected the name of a version", field="source")
    if not isinstance(rules, dict) or not all(side in _RULES for side in rules.values()):
        raise UsageError('rules: expected {"<path>": "ours" or "theirs"}', field="rules")
    return json_response(datasets.merge(name, source, rules, message, caller.access).facts())


def _files(datasets: Datasets, request: Request, caller: Caller, name: str) -> Response:
    """Write many files to the head at once."""
    if request.content_type[0] != CBOR_TYPE:
        raise RefusedError(415, "unsupported-media-type", f"expected {CBOR_TYPE}: bytes by path")
    files = unpack(request.body)
    for path, data in files.items():
        if not isinstance(data, bytes):
            raise UsageError(f"{path}: expected bytes, got {type(data).__name__}", field=path)
    datasets.put(_head_of(name), files, caller.access)
    return Response(204)


def _head_of(name: str) -> str:
    """Return the name of a dataset that is written to."""
    plain, _, version = name.partition("@")
    if version not in ("", "head"):
        raise RefusedError(405, "method-not-allowed", f"{name} never changes; write to the head")
    return plain


def _file(datasets: Datasets, request: Request, caller: Caller, name: str, path: str) -> Response:
    if request.method in ("GET", "HEAD"):
        entry, data = datasets.file(name, path, caller.access)
        tag = f'"{entry.sha256}"'
        if request.header("if-none-match") == tag:
            return Response(304, headers=(("ETag", tag),))
        kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
        # What somebody stored is shown by no browser as a page of this server.
        guard = (("Content-Disposition", "attachment"), ("X-Content-Type-Options", "nosniff"))
        return Response(200, data, kind, (("ETag", tag), *guard))
    plain = _head_of(name)
    if request.method == "DELETE":
        datasets.remove(plain, [path], caller.access)
    else:
        match = request.headers.get("if-match")
        datasets.put(plain, {path: request.body}, caller.access, match)
    return Response(204)


def _parameter(request: Request, name: str) -> str:
    values = request.values(name)
    if not values:
        raise UsageError(f"?{name}= is missing: a version, or head", field=name)
    return values[-1]


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
