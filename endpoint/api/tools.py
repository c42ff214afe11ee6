"""Methods of services as tools of agents (Model Context Protocol, 2025-06-18, streamable HTTP).

``POST /mcp`` takes one JSON-RPC 2.0 message and answers with JSON; there are no sessions and no
streams. An agent gets the tools that its token may call.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.api.operations import authorise, json_object
from endpoint.http.messages import JSON_TYPE, Request, Response
from endpoint.http.plan import Elsewhere, Plan
from endpoint.http.problems import details_of
from rtask import __version__
from rtask.engine.context import SCOPES
from rtask.errors import RtaskError
from rtask.services import ServiceHost
from rtask.services.call import Invocation
from rtask.services.definition import Definition, Method
from rtask.services.description import request_schema
from rtask.services.task import Task

ADDRESS = "/mcp"
VERSIONS = ("2025-06-18", "2025-03-26")
"""Versions of the protocol, the newest first."""

_DATA = "data_resources"
_INVALID, _NO_METHOD, _BAD_PARAMS = -32600, -32601, -32602


def plan_tools(host: ServiceHost, auth: Authenticator, request: Request, caller: Caller) -> Plan:
    """Prepare the answer to a message of an agent.

    Raises
    ------
    RefusedError
        405 for anything but POST: there is no stream to open and no session to end.
    """
    auth.check_origin(request, caller)
    message = json_object(request)
    if "id" not in message:  # a notification
        return Plan.ready(Response(202))
    if not isinstance(message["id"], str | int | None):
        message["id"] = None
        return _told(message, _error(_INVALID, "id: expected a text or a whole number"))
    if message.get("jsonrpc") != "2.0" or not isinstance(message.get("method"), str):
        return _told(message, _error(_INVALID, "expected a JSON-RPC 2.0 request"))
    params = message.get("params", {})
    if not isinstance(params, dict):
        return _told(message, _error(_BAD_PARAMS, "params: expected an object"))
    if message["method"] == "tools/call":
        return _plan_call(host, auth, request, caller, message, params)
    return Plan(lambda: _reply(message, _answer(host, caller, message["method"], params)))


def _told(message: dict[str, Any], members: dict[str, Any]) -> Plan:
    return Plan.ready(_reply(message, members))


def _reply(message: dict[str, Any], members: dict[str, Any]) -> Response:
    text = json.dumps({"jsonrpc": "2.0", "id": message["id"], **members}, ensure_ascii=False)
    return Response(200, text.encode(), JSON_TYPE)


def _answer(
    host: ServiceHost, caller: Caller, method: str, params: dict[str, Any]
) -> dict[str, Any]:
    match method:
        case "initialize":
            return {"result": _greeting(params.get("protocolVersion"))}
        case "ping":
            return {"result": {}}
        case "tools/list":
            return {"result": {"tools": [_tool(*one) for one in _tools(host, caller)]}}
        case other:
            return _error(_NO_METHOD, f"no method {other}; known: initialize, ping, tools/list, "
                          "tools/call")  # fmt: skip


def _error(code: int, words: str) -> dict[str, Any]:
    return {"error": {"code": code, "message": words}}


def _greeting(wanted: Any) -> dict[str, Any]:
    return {
        "protocolVersion": wanted if wanted in VERSIONS else VERSIONS[0],
        "capabilities": {"tools": {}},
        "serverInfo": {"name": "rtask", "version": __version__},
        "instructions": "Perception, grasp planning and motion for robots, and what robots "
        "learned about objects. Lengths are in m, angles in rad.",
    }


def _tools(host: ServiceHost, caller: Caller) -> Iterator[tuple[Definition, Method]]:
    """Yield the methods that a caller may call, of the newest version of each service."""
    scopes = SCOPES[caller.access.role]
    for definition in host.registry:
        for method in definition.methods.values():
            if method.scope in scopes:
                yield definition, method


def _name(definition: Definition, method: Method) -> str:
    return f"{definition.name.replace('/', '_')}_{method.name}"


def _tool(definition: Definition, method: Method) -> dict[str, Any]:
    wanted = request_schema(method)
    files = {name: one for name, one in definition.resources.items() if one.type == "binary"}
    if files:
        wanted["properties"] = {**wanted.get("properties", {}), _DATA: {
            "type": "object",
            "description": "names of the datasets to use, <namespace>/<name>",
            "properties": {
                name: {"type": "string", "description": one.summary} for name, one in files.items()
            },
        }}  # fmt: skip
    return {
        "name": _name(definition, method),
        "title": method.summary,
        "description": f"{method.summary}. {method.description}".strip(),
        "inputSchema": {"type": "object", **wanted},
        "annotations": {"readOnlyHint": method.effect == "reads"},
    }


def _plan_call(
    host: ServiceHost,
    auth: Authenticator,
    request: Request,
    caller: Caller,
    message: dict[str, Any],
    params: dict[str, Any],
) -> Plan:
    name, given = params.get("name"), params.get("arguments", {})
    if not isinstance(given, dict):
        return _told(message, _error(_BAD_PARAMS, "arguments: expected an object"))
    known = {_name(*one): one for one in _tools(host, caller)}
    if not isinstance(name, str) or name not in known:
        return _told(message, _error(_BAD_PARAMS, f"no tool {name!r}; ask tools/list"))
    definition, method = known[name]
    args = dict(given)
    data = args.pop(_DATA, None)
    authorise(auth, request, caller, method.scope, name)
    try:
        asked = Invocation(
            definition.exact, method.name, args, caller.access, data, data_form=_DATA
        )
        task = host.prepare(asked)
    except RtaskError as error:
        return _told(message, _refused(error))

    def start() -> Future[Any]:
        try:
            host.start(task)
        except RtaskError as error:  # such as a full queue
            task.fail(error)
        return task.done

    return Plan(
        lambda: _reply(message, _result(task)),
        timeout_s=task.call.timeout_s,
        elsewhere=Elsewhere(start, task.expire, task.cancel),
    )


def _result(task: Task) -> dict[str, Any]:
    """Return what a call that has ended, or whose time is up, brought."""
    try:
        text = task.result().to_json().decode()
    except RtaskError as error:
        return _refused(error)
    content = [{"type": "text", "text": text}]
    return {"result": {"content": content, "structuredContent": json.loads(text), "isError": False}}


def _refused(error: RtaskError) -> dict[str, Any]:
    """Return an error as the result of a tool: the agent reads what was wrong and tries again."""
    words = details_of(error)["detail"]
    return {"result": {"content": [{"type": "text", "text": words}], "isError": True}}
